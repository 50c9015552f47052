"""Capped losses: the squared error of a run, but no more than that of a run that is not aligned.

The mean of squares that may be huge cannot be estimated from some hundred runs by any interval: one run in a hundred that is
lost decides it. The loss of a run is therefore min(e, d)^2 of its error e, with d the threshold of alignment. The score S is
the root of its mean. S equals the RMS if no error exceeds d.

Intervals are those of the bootstrap of the studentised logarithm of the mean loss: Efron and Tibshirani (1993), chapter 12.5.
The ratio to the bound takes the squared errors of the oracle (bound/oracle.py), whose mean is known, as a control variate.

See docs/tasks_and_scores.md#claims.
"""

from __future__ import annotations

import math

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.score.resampling import LEAST_RUNS, NO_INTERVAL, RESAMPLES, TAILS, Estimate, draw_counts

TINY = 1e-300  #: least variance of a resample, which may have drawn one run alone


def capped(errors: Array, cap: float) -> Array:
    """Return losses (R,) of errors (R,) of any sign, in the square of their unit; what is not finite counts as the cap."""
    size = np.where(np.isfinite(errors), np.abs(errors), np.inf)
    out: Array = np.minimum(size, cap) ** 2
    return out


def score(losses: Array) -> Estimate:
    """Return S, the root of the mean loss (R,), with its 95 % interval: a point for equal losses, none below six runs."""
    runs, mean = len(losses), float(losses.mean())
    if runs < LEAST_RUNS or not mean > 0.0:
        return math.sqrt(mean), NO_INTERVAL
    spread = losses.std(ddof=1) / mean / math.sqrt(runs)
    if spread <= 1e-12:
        return math.sqrt(mean), (math.sqrt(mean),) * 2
    counts = draw_counts(runs, RESAMPLES)
    means = counts @ losses / runs
    variances = (counts @ (losses * losses) / runs - means * means) * runs / (runs - 1)
    with np.errstate(divide="ignore"):
        t = (np.log(means) - math.log(mean)) / (np.sqrt(np.maximum(variances, TINY)) / means / math.sqrt(runs))
    return _studentised(mean, t, spread)


def over_bound(losses: Array, oracle: Array, bound: float) -> Estimate:
    """Return S over the bound with its 95 % interval, adjusted by the oracle's luck in the same runs.

    With O the oracle's squared errors and b^2 their known mean, the mean loss L is corrected by beta (mean(O) - b^2),
    beta = cov(L, O) / var(O). There is no interval below six runs.

    Args:
        losses: losses of the solver, (R,).
        oracle: squared errors of the oracle in the same runs, never capped, (R,).
        bound: b, in the unit of the errors.
    """
    runs, known = len(losses), bound**2
    L, O = losses - losses.mean(), oracle - oracle.mean()
    with np.errstate(divide="ignore", invalid="ignore"):
        beta = float((O * losses).sum() / np.square(O).sum()) if runs >= LEAST_RUNS and O.any() else 0.0
    mean = float(losses.mean() - beta * (oracle.mean() - known))
    if runs < LEAST_RUNS or not mean > 0.0:
        return math.sqrt(max(mean, 0.0) / known), NO_INTERVAL
    error = math.sqrt(np.square(L - beta * O).sum() / (runs - 2) / runs)
    counts = draw_counts(runs, RESAMPLES)
    l, o = counts @ losses / runs, counts @ oracle / runs
    s_oo = counts @ (oracle * oracle) / runs - o * o
    s_lo = counts @ (losses * oracle) / runs - l * o
    s_ll = counts @ (losses * losses) / runs - l * l
    slope = s_lo / s_oo
    adjusted = np.maximum(l - slope * (o - known), 1e-9 * mean)
    errors = np.sqrt(np.maximum(s_ll - slope * s_lo, 1e-15 * known**2) / (runs - 2))
    value, (low, high) = _studentised(mean, (np.log(adjusted) - math.log(mean)) / (errors / adjusted), error / mean)
    return value / bound, (low / bound, high / bound)


def _studentised(mean: float, t: Array, error: float) -> Estimate:
    """Return sqrt(mean) with its interval, from resampled t (B,) of log(mean) and the standard error of log(mean)."""
    low, high = np.percentile(t, 100.0 * TAILS)
    root = math.sqrt(mean)
    return root, (root * math.exp(-0.5 * high * error), root * math.exp(-0.5 * low * error))
