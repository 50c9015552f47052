"""Readings that all tables share: errors at a time and over time, quotients with another filter, and cost.

A function whose docstring begins with "Make a reader" returns a function from results to an estimate. A ``cap`` is the error
that a failed run counts with, in SI units; no run counts with more. See docs/tasks_and_scores.md#reproduction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.evaluation.play.criteria import AZIMUTH, PHI, Criteria
from sins_env.evaluation.reproduction.verdicts import NOTHING, Estimate, capped_rms, mean, of_losses, ratio
from sins_env.evaluation.score import exact, losses, paired, quantities
from sins_env.evaluation.score.headline import CAPS
from sins_env.evaluation.score.navigation import bound_means, known_history
from sins_env.evaluation.score.results import Results

Reader = Callable[..., Estimate]
COST_REPEATS = 0.1  #: relative error of a measured cost; UKF over CKF, the same code, gave 0.98 and 1.05
TIME_OF_A_STEP = f"time of a step, ± {100 * COST_REPEATS:g} %"  #: title of a group of costs
FAILED = CAPS  #: thresholds of alignment beyond which a run has failed


def end_errors(results: Results, points: int = 0) -> Array:
    """Return the misalignment E, N, U at the end, or its mean over the last ``points`` seconds.

    It is (R, 3), in rad; NaN for lost runs.
    """
    records = results.records
    phi = records.history[:, -points:, :3].mean(axis=1, dtype=np.float64) if points else records.final
    return np.where(records.unfinished[:, None], np.nan, phi)


def errors_at(results: Results, t_s: float, over_s: float = 0.0) -> Array:
    """Return the errors at a time from switch-on, or their mean over the ``over_s`` s before it.

    They are (R, components); NaN for lost runs.
    """
    records, t = results.records, np.asarray(results.records.criteria.history_t)
    last = int(np.argmin(np.abs(t - t_s)))
    first = int(np.searchsorted(t, t_s - over_s + 1e-6)) if over_s else last
    errors = records.history[:, first : last + 1].mean(axis=1, dtype=np.float64)
    return np.where(records.unfinished[:, None], np.nan, errors)


def bound_at(results: Results, component: int, t_s: float) -> float:
    """Return the 1-sigma error of the bound at a time; NaN if there is no bound, or one for reference only."""
    bound = results.bound
    if bound is None or not bound.holds:
        return math.nan
    return float(np.interp(t_s, bound.t, bound.sigma[:, component]))


def error(component: int, unit: float, cap: float, t_s: float, over_s: float = 0.0, about_mean: bool = False) -> Reader:
    """Make a reader of the RMS over runs of an error component at a time, or of its standard deviation, with its bound."""

    def read(results: Results) -> Estimate:
        bound = bound_at(results, component, t_s) / unit
        return capped_rms(errors_at(results, t_s, over_s)[:, component] / unit, cap / unit, about_mean, bound)

    return read


def mean_error(component: int, unit: float, t_s: float) -> Reader:
    """Make a reader of the mean over runs of an error component at a time."""
    return lambda results: mean(errors_at(results, t_s)[:, component] / unit)


def apart(component: int, unit: float, cap: float, t_s: float, over_s: float = 0.0) -> Reader:
    """Make a reader of the RMS over runs of the difference between the errors of two filters in the same run."""

    def read(one: Results, other: Results) -> Estimate:
        mine, its = paired.common(one.records, other.records)
        a, b = (errors_at(r, t_s, over_s)[rows, component] / unit for r, rows in ((one, mine), (other, its)))
        return capped_rms(a - b, cap / unit)

    return read


def quotient(component: int | Sequence[int], cap: float, t_s: float, over_s: float = 0.0) -> Reader:
    """Make a reader of the RMS of error components, taken together, over that of another filter in the same runs."""
    parts = np.atleast_1d(component)

    def read(one: Results, other: Results) -> Estimate:
        mine, its = paired.common(one.records, other.records)
        pairs = ((one, mine), (other, its))
        a, b = (np.linalg.norm(errors_at(r, t_s, over_s)[rows][:, parts], axis=1) for r, rows in pairs)
        return ratio(losses.capped(a, cap), losses.capped(b, cap), int((~np.isfinite(a + b)).sum()))

    return read


def limit(criteria: Criteria, quantity: quantities.Quantity) -> float:
    """Return the length of a quantity's limits of divergence; heading, pitch and roll have those of azimuth and level."""
    east, north, *_ = range(PHI.start, PHI.stop)
    limits = np.append(criteria.limit, criteria.limit[[AZIMUTH, east, north]])
    return float(np.linalg.norm(limits[list(quantity.parts)]))


def time_losses(results: Results, name: str) -> Array:
    """Return the losses (R,) whose score is the ARMSE of a quantity of navigation, capped at its limit of divergence, SI."""
    quantity = quantities.quantity(name, True)
    return losses.of_time_means(lengths(results, name), limit(results.records.criteria, quantity))


def armse(name: str) -> Reader:
    """Make a reader of the ARMSE of a quantity of navigation, in its unit, with its bound.

    The ARMSE is the mean over time of the RMS over runs. See docs/tasks_and_scores.md#navigation-scores.
    """

    def read(results: Results) -> Estimate:
        unit, bound = quantities.quantity(name, True).unit, results.bound
        value, low, high, *_ = of_losses(time_losses(results, name))
        least = bound_means(results.records, bound)[name] if bound and bound.holds else math.nan
        return Estimate(value / unit, low / unit, high / unit, len(results.records), 0, least / unit)

    return read


def ratio_of_armse(name: str) -> Reader:
    """Make a reader of the ARMSE of a quantity over that of another filter in the same runs."""

    def read(one: Results, other: Results) -> Estimate:
        mine, its = paired.common(one.records, other.records)
        return ratio(time_losses(one, name)[mine], time_losses(other, name)[its])

    return read


def lengths(results: Results, name: str) -> Array:
    """Return a quantity of navigation over the scored span, (R, seconds), in rad, m/s or m.

    A run that raised has the worst error from there on.
    """
    records = results.records
    return quantities.length(known_history(records)[:, records.criteria.span], quantities.quantity(name, True))


def failed(results: Results) -> Estimate:
    """Read the share of failed runs, %."""
    return percentage(results.records.failed)


def percentage(flags: Mask) -> Estimate:
    """Compute the share of runs with a flag (R,), %; there is none without a run."""
    if not len(flags):
        return NOTHING
    value, (low, high) = exact.share(int(flags.sum()), len(flags))
    return Estimate(100 * value, 100 * low, 100 * high, len(flags))


def cost(results: Results) -> Estimate:
    """Read the cost of a step, relative to ckf in the same process; a measurement has no interval over runs."""
    found = results.cost.ratio if results.cost else None
    return Estimate(found, found, found, 0) if found is not None else NOTHING


def cost_against(one: Results, other: Results) -> Estimate:
    """Read the cost of a step, relative to that of another filter; another measurement may differ by COST_REPEATS."""
    found = cost(one).value / cost(other).value
    return Estimate(found, found * (1 - COST_REPEATS), found * (1 + COST_REPEATS), 0)


def batch_cost_against(one: Results, other: Results) -> Estimate:
    """Read the median cost of a run in its batch, relative to that of another filter."""
    a, b = (float(np.median(results.records.step_s)) for results in (one, other))
    return Estimate(a / b, a / b, a / b, len(one.records))
