"""Scores of navigation over runs: pure functions of :class:`Records`. docs/tasks_and_scores.md#navigation-scores.

ARMSE is the mean over time, in the scored span, of the RMS over runs at each time of the 1 Hz history. No run is dropped:
once a run has raised an exception, its errors are the worst possible ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.score import resampling
from sins_env.evaluation.score.consistency import Nees, consistency
from sins_env.evaluation.score.quantities import QUANTITIES, Quantity, length, run_errors
from sins_env.evaluation.score.resampling import Estimate
from sins_env.states import answered

CURVE_RESAMPLES = 1000  #: number of resamples of a curve over time, which costs more than a single number
CURVE_TIMES = 100  #: number of times at which a curve is resampled


@dataclass(frozen=True)
class Navigation:
    """Scores of navigation by name of QUANTITIES, in rad, m/s and m."""

    armse: dict[str, Estimate]
    rms: dict[str, Estimate]  #: RMS over runs and the scored span
    median_azimuth: Estimate  #: median over runs of the absolute heading error at T
    nees: tuple[Nees, ...]  #: NEES of attitude, velocity and position together; 9 is consistent
    from_s: float  #: start of the scored span, s from switch-on


def navigation_scores(records: Records) -> Navigation:
    """Compute the scores of navigation; they are NaN without a reference or a history."""
    c = records.criteria
    errors = {name: run_errors(records, name) for name in QUANTITIES}
    azimuth = errors["azimuth"][1]
    return Navigation(
        armse=dict(zip(QUANTITIES, _time_means(records, list(QUANTITIES.values())), strict=True)),
        rms=dict(zip(errors, resampling.rms_intervals(np.stack([e[0] for e in errors.values()], axis=1)), strict=True)),
        median_azimuth=resampling.median_interval(azimuth) if c.scored else (math.nan, resampling.NO_INTERVAL),
        nees=consistency(c, records.nees_all, dof=answered(navigate=True).size),
        from_s=(c.span_from - 1) * c.epoch_s,
    )


def known_history(records: Records) -> Array:
    """Return the history (R, S, components) with the worst errors after a run has raised; NaN if errors are not scored."""
    if not records.criteria.scored:
        return records.history.astype(float)
    return np.where(np.isnan(records.history), records.criteria.worst, records.history)


def _time_means(records: Records, quantities: list[Quantity]) -> list[Estimate]:
    span = records.criteria.span
    if records.history.shape[1] != len(span) or not span.any():
        return [(math.nan, resampling.NO_INTERVAL)] * len(quantities)
    history = known_history(records)[:, span]
    return [time_mean(length(history, quantity)) for quantity in quantities]


def time_mean(errors: Array) -> Estimate:
    """Return the mean over time of the RMS over runs of errors (R, S), with its BCa interval."""
    return _estimate(_time_mean(errors))


class _Resampled(NamedTuple):
    """A time mean and its resamples, which use only CURVE_TIMES of the times."""

    value: Array  #: () mean over all times
    least: Array  #: () mean over the times that are resampled
    drawn: Array  #: (CURVE_RESAMPLES,) mean of each resample
    without: Array  #: (units,) mean with one unit left out


def _time_mean(errors: Array) -> _Resampled:
    squares = np.square(errors)
    curve = np.sqrt(squares.mean(axis=0))
    picked = np.unique(np.linspace(0, len(curve) - 1, CURVE_TIMES).round().astype(int))
    units, (sizes, drawn_sizes) = resampling.units_of(squares[:, picked]), resampling.sizes(len(squares))
    few = resampling.resampled(units, CURVE_RESAMPLES)
    drawn = np.sqrt(few / drawn_sizes[:CURVE_RESAMPLES]).mean(axis=1)
    total, count = units.sum(axis=0), len(squares)
    with np.errstate(divide="ignore", invalid="ignore"):  # a single run
        without = np.sqrt(np.maximum(total - units, 0) / (count - sizes)).mean(axis=1)
    return _Resampled(curve.mean(), curve[picked].mean(), drawn, without)


def _estimate(found: _Resampled) -> Estimate:
    """Return the mean over all times with the interval of the resampled times, scaled to it."""
    value = float(found.value)
    if len(found.without) < 2 or not math.isfinite(value):
        return value, resampling.NO_INTERVAL
    ((low, high),) = resampling.bca(found.drawn[:, None], np.array([found.least]), found.without[:, None])
    scale = value / float(found.least) if found.least else 1.0
    return value, (float(low) * scale, float(high) * scale)


def bound_means(records: Records, bound: Bound) -> dict[str, float]:
    """Return the bound of each ARMSE by name of QUANTITIES; NaN for components that the bound does not have."""
    sigma = bound.sigma[records.criteria.span]
    return {name: _bound_mean(sigma, quantity) for name, quantity in QUANTITIES.items()}


def _bound_mean(sigma: Array, quantity: Quantity) -> float:
    parts = quantity.bounded
    if not parts or max(parts) >= sigma.shape[1] or not len(sigma):
        return math.nan
    return float(np.sqrt(np.square(sigma[:, parts]).sum(axis=1)).mean())
