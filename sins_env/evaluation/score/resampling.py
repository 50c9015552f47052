"""The bootstrap over runs, for every solver at once.

Each statistic here is a function of sums over runs. A resample is how often each run was drawn, so the resampled sums of
any number of scores are one matrix product, and all solvers share the resamples: the paired comparison of two of them is
the quotient of two columns. Within a run errors are one correlated path; runs are independent, so runs are resampled.

BCa intervals: Efron (1987), doi 10.1080/01621459.1987.10478410; Efron and Tibshirani (1993), eq. 14.9, 14.10 and 14.15.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import special

from sins_env.arrays import Array

#: Fewer common runs tell nothing apart: of five, chance puts one solver ahead in all more often than once in twenty.
LEAST_RUNS = 6

Interval = tuple[float, float]
Estimate = tuple[float, Interval]  #: a value with its 95 % interval

CONFIDENCE = 0.95
NO_INTERVAL: Interval = (math.nan, math.nan)
RESAMPLES = 4999
SEED = 20110607  #: a table is the same whenever it is made
MOST_UNITS = 2000  #: more runs are drawn in so many blocks of them: runs are alike, so are the means of blocks
TAILS = np.array([0.5 * (1 - CONFIDENCE), 0.5 * (1 + CONFIDENCE)])


@lru_cache(maxsize=3)
def _counts(units: int, resamples: int) -> Array:
    """(resamples, units) how often each unit was drawn."""
    rng = np.random.default_rng(SEED)
    out = np.empty((resamples, units))
    portion = max(1_000_000 // units, 1)
    for first in range(0, resamples, portion):
        rows = min(portion, resamples - first)
        drawn = rng.integers(units, size=(rows, units)) + units * np.arange(rows)[:, None]
        out[first : first + rows] = np.bincount(drawn.ravel(), minlength=rows * units).reshape(rows, units)
    return out


def units_of(columns: Array) -> Array:
    """Sums over the units that are resampled, runs or blocks of runs: (R, c) -> (units, c)."""
    runs = len(columns)
    if runs <= MOST_UNITS:
        return columns
    return np.add.reduceat(columns, np.arange(MOST_UNITS) * runs // MOST_UNITS, axis=0)


def resampled(units: Array, resamples: int = RESAMPLES) -> Array:
    """Resampled sums of (units, c): (resamples, c), the first of RESAMPLES."""
    return _counts(len(units), RESAMPLES)[:resamples] @ units


@lru_cache(maxsize=8)
def sizes(runs: int) -> tuple[Array, Array]:
    """How many runs are in each unit (units, 1), and in each resample (RESAMPLES, 1)."""
    units = units_of(np.ones((runs, 1)))
    return units, resampled(units)


def root_interval(top: Array, drawn_top: Array, bottom: Array, drawn_bottom: Array) -> Array:
    """BCa intervals of sqrt(sum top / sum bottom): (c, 2); NaN for a single unit, or where nothing is known.

    Args:
        top, bottom: what was resampled, (units, c); not negative.
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
    """Intervals (c, 2) from resampled statistics (B, c), the statistic (c,), and leaving out one unit (units, c).

    The percentile interval stands where the correction does not exist; equal values give a point.
    """
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
    """(2, resamples) ranks, from 0, of the two middle runs of each resample (the same one twice for an odd number).

    The k-th smallest of n draws from ranks 0 to n - 1 is floor(n U), with U the k-th smallest of n uniform values: Beta
    distributed, and the next one is U + (1 - U) times the least of n - k others. So no resample needs to be drawn.
    """
    rng = np.random.default_rng(SEED)
    k = (runs + 1) // 2
    first = rng.beta(k, runs + 1 - k, resamples)
    second = first if runs % 2 else 1 - (1 - first) * rng.random(resamples) ** (1 / (runs - k))
    return np.minimum(np.floor(runs * np.stack([first, second])), runs - 1).astype(np.int64)


def resampled_medians(values: Array) -> Array:
    """Medians of RESAMPLES resamples of (R,); inf where the middle is censored."""
    ordered = np.sort(values)
    first, second = _middles(len(values), RESAMPLES)
    return 0.5 * (ordered[first] + ordered[second])


def percentile_interval(drawn: Array) -> Interval:
    """Without interpolation, which would make inf - inf."""
    low, high = np.percentile(drawn, 100 * TAILS, method="inverted_cdf")
    return float(low), float(high)


def median_interval(values: Array) -> Estimate:
    """Median with its percentile-bootstrap interval; censored times are +inf. (R,).

    Not BCa: its acceleration comes from leaving out one run, which says nothing of a median.
    """
    return float(np.median(values)), percentile_interval(resampled_medians(values))


def rms_interval(rms: Array) -> Estimate:
    """RMS across runs of each run's RMS, with a 95 % BCa interval: none for one run, a point for equal ones. (R,)"""
    return rms_intervals(rms[:, None])[0]


def rms_intervals(rms: Array) -> list[Estimate]:
    """The same for every column of (R, c), in one go."""
    squares = np.square(rms)
    top = units_of(squares)
    ends = root_interval(top, resampled(top), *sizes(len(rms)))
    values = np.sqrt(squares.mean(axis=0))
    return [(float(value), (float(low), float(high))) for value, (low, high) in zip(values, ends, strict=True)]
