"""Readings of the tables of the swaying base, besides errors at a time: settling, wander, largest error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.reproduction.readings.common import Reader, errors_at
from sins_env.evaluation.reproduction.verdicts import Estimate, capped_rms, median
from sins_env.evaluation.score.resampling import TAILS
from sins_env.evaluation.score.results import Results


def settling(components: int | Sequence[int], within: float, until_s: float) -> Reader:
    """Make a reader of the time from which on errors stay ``within`` (rad) until ``until_s``, median over runs.

    Times are s from switch-on. A run that is outside at the end has an infinite one. Lost runs are left out and counted.
    """
    return lambda results: median(settled_s(results, components, within, until_s))


def settled_s(results: Results, components: int | Sequence[int], within: float, until_s: float) -> Array:
    """Return the times (R,), s, from which on errors stay ``within`` until ``until_s``; NaN for a lost run."""
    records, t = results.records, np.asarray(results.records.criteria.history_t)
    span = t <= until_s + 1e-6
    errors = np.abs(records.history[:, span][:, :, np.atleast_1d(components)]).max(axis=2)
    outside = np.arange(1, span.sum() + 1) * ~(errors <= within)  # a NaN is not within
    times = np.append(t[span], np.inf)[outside.max(axis=1)]
    return np.where(records.unfinished, np.nan, times)


def wander(component: int, unit: float, cap: float, t_s: float, over_s: float) -> Reader:
    """Make a reader of the standard deviation of an error in the ``over_s`` s before a time, RMS over runs."""

    def read(results: Results) -> Estimate:
        records, t = results.records, np.asarray(results.records.criteria.history_t)
        span = (t > t_s - over_s + 1e-6) & (t <= t_s + 1e-6)
        spread = records.history[:, span, component].std(axis=1, ddof=1, dtype=np.float64) / unit
        return capped_rms(np.where(records.unfinished, np.nan, spread), cap / unit)

    return read


def largest(component: int, unit: float, t_s: float, of: int) -> Reader:
    """Make a reader of the largest size of an error at a time among ``of`` runs: its median and its 95 % interval.

    With F the distribution over all runs, the maximum has the distribution F to the power of ``of``.
    """

    def read(results: Results) -> Estimate:
        errors = np.abs(errors_at(results, t_s)[:, component]) / unit
        known = errors[np.isfinite(errors)]
        lost = len(errors) - len(known)
        if len(known) < 2:
            return Estimate(np.nan, np.nan, np.nan, len(known), lost)
        value, low, high = np.quantile(known, np.array([0.5, *TAILS]) ** (1 / of))
        return Estimate(float(value), float(low), float(high), len(known), lost)

    return read
