"""Tests and intervals that hold for any law of the errors: shares, medians, and paired comparisons by sign flips.

- Share of runs: Clopper and Pearson (1934), doi 10.1093/biomet/26.4.404.
- Median: order statistics, so that censored times need no further care.
- Two solvers of equal mean loss: signs of the paired differences are exchangeable if both have one law, so every pattern of
  signs is as probable as the observed one. Fisher (1935), The Design of Experiments, section 21.
- Two shares of failed runs: McNemar (1947), doi 10.1007/BF02295996, exact by the binomial law.
- Many comparisons: Holm (1979), https://www.jstor.org/stable/4615733.

See docs/tasks_and_scores.md#verdicts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from sins_env.arrays import Array, Mask
from sins_env.evaluation.score.resampling import CONFIDENCE, LEAST_RUNS, NO_INTERVAL, SEED, Estimate, units_of

LEVEL = 1.0 - CONFIDENCE  #: probability of a false verdict
FLIPS = 9999  #: number of random patterns of signs; the observed one is counted with them
ALL_PATTERNS = 12  #: most runs for which all patterns are taken
ROUNDING = 1e-12  #: sums that differ by less, relatively, count as equal
WIDEST = 40.0  #: largest logarithm of a ratio of mean losses that an interval can end at; beyond, it is open


def share(part: int, runs: int) -> Estimate:
    """Return the share of ``runs`` runs with the interval of Clopper and Pearson, which covers at least 95 %."""
    from scipy import special  # slow to import

    tail = 0.5 * LEVEL
    low = float(special.betaincinv(part, runs - part + 1, tail)) if part else 0.0
    high = float(special.betaincinv(part + 1, runs - part, 1.0 - tail)) if part < runs else 1.0
    return part / runs, (low, high)


@lru_cache(maxsize=64)
def median_ranks(runs: int) -> tuple[int, int] | None:
    """Return the ranks, from 1, of the ends of the interval of a median; None for fewer than six runs."""
    from scipy import special  # slow to import

    below = special.bdtr(np.arange(runs), runs, 0.5)  # probability that at most so many runs lie below the median
    low = int(np.searchsorted(below, 0.5 * LEVEL, side="right"))
    return (low, runs + 1 - low) if low else None


def median(values: Array) -> Estimate:
    """Return the median of values (R,) with the interval of order statistics; +inf are values beyond the end, as of censored times.

    The median is +inf if either of the two middle values is.
    """
    ordered = np.sort(values)
    runs = len(ordered)
    middle = ordered[[(runs - 1) // 2, runs // 2]]
    ranks = median_ranks(runs)
    interval = NO_INTERVAL if ranks is None else (float(ordered[ranks[0] - 1]), float(ordered[ranks[1] - 1]))
    return float(0.5 * (middle[0] + middle[1])), interval


def mean(values: Array) -> Estimate:
    """Return the mean of values (R,) with all centres of symmetry that sign flips do not reject; none below six runs."""
    runs, centre = len(values), float(values.mean())
    away = values - centre
    scale = float(np.sqrt(np.square(away).mean()))
    if runs < LEAST_RUNS or not scale > 0.0:
        return centre, NO_INTERVAL if runs < LEAST_RUNS else (centre, centre)
    drawn, count = flipped(np.stack([away / scale, np.ones(runs)], axis=1))

    def kept(shift: float) -> bool:
        return float((np.abs(drawn - shift * count) >= abs(shift) * runs * (1.0 - ROUNDING)).mean()) > LEVEL

    return centre, (centre - scale * _edge(kept, -1), centre + scale * _edge(kept, 1))


@lru_cache(maxsize=2)
def patterns(units: int) -> Array:
    """Return patterns of signs (N, units): all of them for few units, else the observed one and FLIPS random ones."""
    if units <= ALL_PATTERNS:
        bits = np.arange(2**units)[:, None] >> np.arange(units) & 1
        return np.where(bits, -1.0, 1.0)
    out = np.empty((1 + FLIPS, units))
    out[0] = 1.0
    out[1:] = np.random.default_rng(SEED).integers(0, 2, (FLIPS, units))
    out[1:] *= -2.0
    out[1:] += 1.0
    return out


def flipped(columns: Array) -> Array:
    """Return the sums of columns (R, k) under each pattern of signs, (k, N); the first pattern is the observed one.

    Runs beyond some thousand share signs in blocks, which are as exchangeable as runs are.
    """
    units = units_of(columns)
    return np.ascontiguousarray(units.T) @ patterns(len(units)).T


def sign_flips(a: Array, b: Array) -> float:
    """Return the two-sided p value of equal mean losses of two solvers in the same runs, (R,) each."""
    ((p, _),) = against(a[:, None], b, level=None)
    return p


def ratio_by_flips(a: Array, b: Array, level: float = LEVEL) -> Estimate:
    """Return the ratio of RMS of two solvers in the same runs, with all ratios that :func:`sign_flips` does not reject.

    Args:
        a, b: losses, squared errors of each run (R,).
        level: probability that the interval misses the true ratio.
    """
    ((_, ratio),) = against(a[:, None], b, level)
    return ratio


def against(losses: Array, reference: Array, level: float | None = LEVEL) -> list[tuple[float, Estimate]]:
    """Return :func:`sign_flips` and :func:`ratio_by_flips` of each column of losses (R, k) and one reference (R,).

    The patterns of signs are applied once to all. Without a level there are no intervals.
    """
    differences = losses - reference[:, None]
    drawn, (drawn_b,) = flipped(differences), flipped(reference[:, None])
    sum_b = float(reference.sum())
    out = []
    for own, difference in zip(drawn, differences.sum(axis=0).tolist(), strict=True):
        p = float((np.abs(own) >= abs(difference) * (1.0 - ROUNDING)).mean())
        sums = difference + sum_b, sum_b
        out.append((p, _ratio(own + drawn_b, drawn_b, *sums, level)))
    return out


def _ratio(drawn_a: Array, drawn_b: Array, sum_a: float, sum_b: float, level: float | None) -> Estimate:
    """Return the ratio of RMS from flipped sums (N,) and the observed ones, with its interval if there is a level."""
    if not sum_b > 0.0:
        return math.nan, NO_INTERVAL
    ratio = sum_a / sum_b
    if level is None or not ratio > 0.0:
        return math.sqrt(max(ratio, 0.0)), NO_INTERVAL

    def kept(log: float) -> bool:
        r = ratio * math.exp(log)
        return float((np.abs(drawn_a - r * drawn_b) >= abs(sum_a - r * sum_b) * (1.0 - ROUNDING)).mean()) > level

    ends = [ratio * math.exp(sign * _edge(kept, sign)) for sign in (-1, 1)]
    return math.sqrt(ratio), (math.sqrt(ends[0]), math.sqrt(ends[1]))


def _edge(kept: Callable[[float], bool], sign: int) -> float:
    """Return how far from zero ``kept`` holds, by doubling and halving; inf beyond WIDEST."""
    low, high = 0.0, 0.02
    while kept(sign * high):
        low, high = high, 2.0 * high
        if high > WIDEST:
            return math.inf
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if kept(sign * middle) else (low, middle)
    return low


def mcnemar(a: Mask, b: Mask) -> float:
    """Return the two-sided p value of equal shares of failed runs (R,); runs in which just one solver fails decide."""
    from scipy import special  # slow to import

    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    runs = only_a + only_b
    return min(1.0, 2.0 * float(special.bdtr(min(only_a, only_b), runs, 0.5))) if runs else 1.0


def fails_more(a: Mask, b: Mask, level: float = LEVEL) -> tuple[bool, bool]:
    """Return whether a is told to fail more often than b in the same runs (R,), and b more often than a, two-sided."""
    told, more = mcnemar(a, b) <= level, int(a.sum()) - int(b.sum())
    return told and more > 0, told and more < 0


def sign_test(a: Array, b: Array) -> float:
    """Return the two-sided p value of a being as often above b as below it (R,); ties and two infinite values are dropped."""
    return mcnemar(a < b, b < a)


def holm(p: ArrayLike) -> Array:
    """Return p values (k,) that are adjusted for k comparisons, in the order given."""
    values = np.asarray(p, dtype=float)
    order = np.argsort(values, kind="stable")
    steps = np.minimum(np.arange(len(values), 0, -1) * values[order], 1.0)
    out = np.empty_like(values)
    out[order] = np.maximum.accumulate(steps)
    return out


def fragile(a: Array, b: Array, cap: float) -> bool:
    """Return whether one more run would undo the win of one solver over another.

    In that run the winner fails, with the loss ``cap`` squared, and the loser does as on average.
    """
    wins = a.mean() < b.mean()
    more_a, more_b = (cap**2, b.mean()) if wins else (a.mean(), cap**2)
    longer_a, longer_b = np.append(a, more_a), np.append(b, more_b)
    return bool((longer_a.mean() < longer_b.mean()) != wins) or sign_flips(longer_a, longer_b) > LEVEL


def beaten_by(losses: Array, failed: Mask, level: float = LEVEL) -> Array:
    """Return by how many others each solver is beaten, one-sided at ``level`` / (k - 1), (k,).

    One solver beats another if its score is told to be smaller or its failures to be fewer (McNemar), and neither the opposite.

    Args:
        losses: losses of k solvers in the same runs, (R, k).
        failed: whether the runs failed, (R, k).
        level: probability that the best solver is called beaten.
    """
    count, sums = losses.shape[1], losses.sum(axis=0)
    least = level / max(count - 1, 1)
    drawn = flipped(losses)
    gap = sums[:, None] - sums  # of j over i; sums that are equal tell nothing
    apart = np.stack(
        [
            (np.abs(drawn - one) >= np.abs(row)[:, None] * (1.0 - ROUNDING)).mean(axis=1)
            for one, row in zip(drawn, gap, strict=True)
        ]
    )
    scores = np.where(0.5 * apart <= least, np.sign(gap), 0.0)
    fails = np.zeros_like(gap)
    for i, j in combinations(range(count), 2):
        more, less = fails_more(failed[:, i], failed[:, j], 2.0 * least)
        fails[i, j], fails[j, i] = more - less, less - more
    worse = (scores + fails > 0.0) & (scores >= 0.0) & (fails >= 0.0)
    out: Array = worse.sum(axis=1)
    return out
