"""Bootstrap over runs, for every solver at once.

Each statistic here is a function of sums over runs, and a resample is the number of times that each run was drawn. The
resampled sums of any number of scores are therefore one matrix product. All solvers share the resamples, so the paired
comparison of two of them is the quotient of two columns. Runs are resampled, not epochs: runs are independent, while the
errors within a run are correlated.

BCa intervals: Efron (1987), doi 10.1080/01621459.1987.10478410; Efron and Tibshirani (1993), eq. 14.9, 14.10 and 14.15.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array

#: Least number of common runs that can tell two solvers apart. With five, chance alone puts one of two equal solvers ahead
#: in all of them in more than 5 % of cases.
LEAST_RUNS = 6

Interval = tuple[float, float]
Estimate = tuple[float, Interval]  #: a value with its 95 % interval

CONFIDENCE = 0.95
NO_INTERVAL: Interval = (math.nan, math.nan)
RESAMPLES = 4999
SEED = 20110607  #: fixed seed of the resamples, so that a table is always the same
MOST_UNITS = 2000  #: most units that are drawn; more runs are drawn in blocks, for blocks of like runs are alike
TAILS = np.array([0.5 * (1 - CONFIDENCE), 0.5 * (1 + CONFIDENCE)])


@lru_cache(maxsize=3)
def draw_counts(units: int, resamples: int) -> Array:
    """Return how often each unit was drawn in each resample, (resamples, units)."""
    rng = np.random.default_rng(SEED)
    out = np.empty((resamples, units))
    portion = max(1_000_000 // units, 1)
    for first in range(0, resamples, portion):
        rows = min(portion, resamples - first)
        drawn = rng.integers(units, size=(rows, units)) + units * np.arange(rows)[:, None]
        out[first : first + rows] = np.bincount(drawn.ravel(), minlength=rows * units).reshape(rows, units)
    return out


def units_of(columns: Array) -> Array:
    """Return sums over the units that are resampled, which are runs or blocks of runs: (R, c) -> (units, c)."""
    runs = len(columns)
    if runs <= MOST_UNITS:
        return columns
    return np.add.reduceat(columns, np.arange(MOST_UNITS) * runs // MOST_UNITS, axis=0)


def resampled(units: Array, resamples: int = RESAMPLES) -> Array:
    """Return the sums of columns (units, c) in the first ``resamples`` resamples: (resamples, c)."""
    return draw_counts(len(units), RESAMPLES)[:resamples] @ units


@lru_cache(maxsize=8)
def sizes(runs: int) -> tuple[Array, Array]:
    """Return the number of runs in each unit (units, 1) and in each resample (RESAMPLES, 1)."""
    units = units_of(np.ones((runs, 1)))
    return units, resampled(units)


def root_interval(top: Array, drawn_top: Array, bottom: Array, drawn_bottom: Array) -> Array:
    """Return BCa intervals (c, 2) of sqrt(sum top / sum bottom); NaN for a single unit or for unknown values.

    Args:
        top, bottom: values that were resampled, (units, c), not negative.
        drawn_top, drawn_bottom: resampled sums, (RESAMPLES, c).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        all_top, all_bottom = top.sum(axis=0), bottom.sum(axis=0)
        value = np.sqrt(all_top / all_bottom)
        drawn = np.sqrt(drawn_top / drawn_bottom)
        without = np.sqrt(np.maximum(all_top - top, 0) / np.maximum(all_bottom - bottom, 0))
    out = bca(drawn, value, without)
    return np.full_like(out, np.nan) if len(top) < 2 else out


def bca(drawn: Array, value: Array, without: Array) -> Array:
    """Return BCa intervals (c, 2) of c statistics.

    If the correction does not exist, the percentile interval takes its place. Equal values give a point.

    Args:
        drawn: resampled statistics, (B, c).
        value: statistics of the sample, (c,).
        without: statistics with one unit left out, (units, c).
    """
    from scipy import special  # slow to import

    size = len(drawn)
    drawn = np.sort(drawn.T, axis=1)  # NaN last: those columns give NaN
    ends = (
        (np.searchsorted(row, v, "left"), np.searchsorted(row, v, "right")) for row, v in zip(drawn, value, strict=True)
    )
    below = np.array([0.5 * (first + last) for first, last in ends])  # ties count half
    away = without.mean(axis=0) - without
    with np.errstate(divide="ignore", invalid="ignore"):
        bias = special.ndtri(below / size)[:, None]
        # products: a power of 3 takes seventy times as long
        acceleration = ((away * away * away).sum(axis=0) / (6 * (away * away).sum(axis=0) ** 1.5))[:, None]
        shifted = bias + special.ndtri(TAILS)
        levels = special.ndtr(bias + shifted / (1 - acceleration * shifted))
    good = np.isfinite(levels).all(axis=1) & (np.ptp(levels, axis=1) > 0)
    at = np.where(good[:, None], levels, TAILS) * (size - 1)
    low = np.floor(at).astype(int)
    rows = np.arange(len(drawn))[:, None]
    start = drawn[rows, low]
    with np.errstate(invalid="ignore"):
        out: Array = start + (at - low) * (drawn[rows, np.minimum(low + 1, size - 1)] - start)
        same = drawn[:, -1] - drawn[:, 0] <= 1e-12 * drawn[:, -1]
    out[same] = value[same, None]
    out[~np.isfinite(drawn[:, -1])] = np.nan
    return out


@lru_cache(maxsize=64)
def _middles(runs: int, resamples: int) -> NDArray[np.int64]:
    """Return the ranks (2, resamples), from 0, of the two middle runs of each resample; both are equal for odd ``runs``.

    The k-th smallest of n draws from the ranks 0 to n - 1 is floor(n U). U is the k-th smallest of n uniform values, which
    is Beta distributed. The next smallest value is U + (1 - U) times the least of n - k other uniform values. No resample
    needs to be drawn.
    """
    rng = np.random.default_rng(SEED)
    k = (runs + 1) // 2
    first = rng.beta(k, runs + 1 - k, resamples)
    second = first if runs % 2 else 1 - (1 - first) * rng.random(resamples) ** (1 / (runs - k))
    return np.minimum(np.floor(runs * np.stack([first, second])), runs - 1).astype(np.int64)


def resampled_medians(values: Array) -> Array:
    """Return the medians (RESAMPLES,) of resamples of values (R,); inf if the middle run is censored."""
    ordered = np.sort(values)
    first, second = _middles(len(values), RESAMPLES)
    return 0.5 * (ordered[first] + ordered[second])


def percentile_interval(drawn: Array) -> Interval:
    """Return the percentile interval of resampled values, without interpolation, which would give inf - inf."""
    low, high = np.percentile(drawn, 100 * TAILS, method="inverted_cdf")
    return float(low), float(high)


def median_interval(values: Array) -> Estimate:
    """Return the median of values (R,) with its percentile-bootstrap interval; censored times are +inf.

    BCa does not apply: its acceleration comes from leaving out one run, which tells nothing about a median.
    """
    return float(np.median(values)), percentile_interval(resampled_medians(values))


def rms_interval(rms: Array) -> Estimate:
    """Return the RMS over runs of each run's RMS (R,) with its 95 % BCa interval.

    The interval is NaN for a single run, and a point for equal values.
    """
    return rms_intervals(rms[:, None])[0]


def rms_intervals(rms: Array) -> list[Estimate]:
    """Return :func:`rms_interval` of every column of (R, c), computed together."""
    squares = np.square(rms)
    top = units_of(squares)
    ends = root_interval(top, resampled(top), *sizes(len(rms)))
    values = np.sqrt(squares.mean(axis=0))
    return [(float(value), (float(low), float(high))) for value, (low, high) in zip(values, ends, strict=True)]
