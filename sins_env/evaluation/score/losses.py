"""Capped losses: the squared error of a run, but no more than that of a run that is not aligned.

The mean of squares that may be huge cannot be estimated from some hundred runs by any interval: one run in a hundred that is
lost decides it. The loss of a run is therefore min(e, d)^2 of its error e, with d the threshold of alignment. The score S is
the root of its mean. S equals the RMS if no error exceeds d.

Intervals are those of the bootstrap of the studentised logarithm of the mean loss: Efron and Tibshirani (1993), chapter 12.5.
The ratio to the bound takes the squared errors of the oracle (bound/oracle.py), whose mean is known, as a control variate.
Solvers with the same runs share the resamples, so that they are computed together.

See docs/tasks_and_scores.md#verdicts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.score.resampling import (
    CONFIDENCE,
    LEAST_RUNS,
    NO_INTERVAL,
    RESAMPLES,
    Estimate,
    Interval,
    draw_counts,
    units_of,
)

TINY = 1e-300  #: least variance of a resample, which may have drawn one run alone


class Root(NamedTuple):
    """Root of a mean loss, with resamples that give it an interval of any confidence."""

    value: float
    t: Array  #: (B,) resampled logarithms of the mean loss, studentised; none if there is no interval
    error: float  #: standard error of the logarithm of the mean loss

    def interval(self, most: float = math.inf, least: float = 0.0, *, confidence: float = CONFIDENCE) -> Interval:
        """Return the interval; NaN if there is none.

        Args:
            most: largest true value that there can be, as the cap of the errors is for the score.
            least: a value that the true one exceeds with that confidence, known from elsewhere, as from the share of capped errors.
            confidence: probability that it holds the true value.
        """
        if not len(self.t):
            return NO_INTERVAL
        tails = np.percentile(self.t, 50.0 * np.array([1.0 + confidence, 1.0 - confidence]))
        with np.errstate(over="ignore"):  # hardly any variance in a resample without the runs that failed
            low, high = (self.value * np.exp(-0.5 * tails * self.error)).tolist()
        return min(max(low, least), self.value), max(min(high, most), self.value)

    def over(self, scale: float) -> Root:
        """Return the same root in units of ``scale``."""
        return self._replace(value=self.value / scale)


def capped(errors: Array, cap: float) -> Array:
    """Return losses (R,) of errors (R,) of any sign, in the square of their unit; what is not finite counts as the cap."""
    size = np.where(np.isfinite(errors), np.abs(errors), np.inf)
    out: Array = np.minimum(size, cap) ** 2
    return out


def of_time_means(errors: Array, cap: float) -> Array:
    """Return losses (R,) whose score is the ARMSE r of errors (R, S): the mean over time of r_t, the RMS over runs.

    The loss of a run is r times its time mean of e^2 / r_t. The mean loss is r^2, and a run moves the logarithm of r by half of
    what it moves that of the mean, as it does for an RMS. A run whose own RMS over time exceeds ``cap`` is scaled down to it.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        own = np.sqrt(np.square(errors).mean(axis=1, keepdims=True))
        scaled = np.where(np.isfinite(own), errors * np.minimum(cap / own, 1.0), cap)
        scaled = np.where(own == 0.0, 0.0, scaled)
        squares = np.square(scaled)
        curve = np.sqrt(squares.mean(axis=0))
        parts = np.where(curve > 0.0, squares / curve, 0.0)
    out: Array = curve.mean() * parts.mean(axis=1)
    return out


def score(losses: Array, most: float = math.inf) -> Estimate:
    """Return S, the root of the mean loss (R,), with its 95 % interval: a point for equal losses, none below six runs.

    The true value is known to be at most ``most``, such as the cap of the errors.
    """
    (found,) = scores(losses[:, None])
    return found.value, found.interval(most)


def scores(losses: Array) -> list[Root]:
    """Return S of every column of losses (R, k)."""
    units, means = _units(losses), losses.mean(axis=0)
    runs = len(units)
    if runs < LEAST_RUNS:
        return [_without(mean) for mean in means.tolist()]
    counts = draw_counts(runs, RESAMPLES)
    drawn, squares = counts @ units / runs, counts @ np.square(units) / runs
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = units.std(axis=0, ddof=1) / means / math.sqrt(runs)
        variances = np.maximum((squares - drawn * drawn) * runs / (runs - 1), TINY)
        t = (np.log(drawn) - np.log(means)) / (np.sqrt(variances) / drawn / math.sqrt(runs))
    out = []
    for i, (mean, error) in enumerate(zip(means.tolist(), errors.tolist(), strict=True)):
        if not mean > 0.0 or error <= 1e-12:
            out.append(Root(math.sqrt(mean), np.zeros(1), 0.0))
        else:
            out.append(Root(math.sqrt(mean), t[:, i], error))
    return out


def over_bound(losses: Array, oracle: Array, bound: float) -> Estimate:
    """Return S over the bound with its 95 % interval, adjusted by the oracle's luck in the same runs.

    With O the oracle's squared errors and b^2 their known mean, the mean loss L is corrected by beta (mean(O) - b^2),
    beta = cov(L, O) / var(O). There is no interval below six runs.

    Args:
        losses: losses of the solver, (R,).
        oracle: squared errors of the oracle in the same runs, never capped, (R,).
        bound: b, in the unit of the errors.
    """
    (found,) = over_bounds(losses[:, None], oracle, bound)
    return found.value, found.interval()


def over_bounds(losses: Array, oracle: Array, bound: float) -> list[Root]:
    """Return :func:`over_bound` of every column of losses (R, k), each with its resamples."""
    known = bound**2
    units, shared = _units(losses), _units(oracle[:, None])
    runs = len(units)
    L, O = units - units.mean(axis=0), shared - shared.mean(axis=0)
    beta = (O * units).sum(axis=0) / np.square(O).sum() if runs >= LEAST_RUNS and O.any() else np.zeros(L.shape[1])
    means = losses.mean(axis=0) - beta * (oracle.mean() - known)
    if runs < LEAST_RUNS or not O.any():
        return [_without(max(mean, 0.0)).over(bound) for mean in means.tolist()]
    errors = np.sqrt(np.square(L - beta * O).sum(axis=0) / (runs - 2) / runs)
    counts = draw_counts(runs, RESAMPLES)
    l, o = counts @ units / runs, counts @ shared / runs
    s_oo = counts @ np.square(shared) / runs - o * o
    s_lo = counts @ (units * shared) / runs - l * o
    s_ll = counts @ np.square(units) / runs - l * l
    out = []
    for i, (mean, error) in enumerate(zip(means.tolist(), errors.tolist(), strict=True)):
        if not mean > 0.0:
            out.append(_without(max(mean, 0.0)).over(bound))
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(s_oo[:, 0] > 0.0, s_lo[:, i] / s_oo[:, 0], 0.0)
        adjusted = np.maximum(l[:, i] - slope * (o[:, 0] - known), 1e-9 * mean)
        spread = np.sqrt(np.maximum(s_ll[:, i] - slope * s_lo[:, i], 1e-15 * known**2) / (runs - 2))
        t = (np.log(adjusted) - math.log(mean)) / (spread / adjusted)
        out.append(Root(math.sqrt(mean), t, error / mean).over(bound))
    return out


def _without(mean: float) -> Root:
    """Return the root of a mean loss without an interval."""
    return Root(math.sqrt(mean), np.empty(0), math.nan)


def _units(columns: Array) -> Array:
    """Return the means of columns (R, k) over the units that are resampled, which are runs or blocks of runs."""
    return units_of(columns) / units_of(np.ones((len(columns), 1)))
