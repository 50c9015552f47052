"""Paired comparison of two solvers on the same runs.

Every solver meets the same noise, so the ratio of two scores is known better than either score. The intervals are:

- Ratio of RMS: BCa over pairs.
- Success: Bonett and Price (2012), doi 10.3102/1076998611411915, which also holds if no run differs.
- Probability of improvement: Wilson's score interval, which is conservative if runs tie.
- Median time: percentiles over pairs. BCa does not exist, for leaving out one run tells nothing about a median. A
  difference of two censored medians is unknown and widens the interval on both sides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.score import quantities, resampling
from sins_env.evaluation.score.resampling import LEAST_RUNS, NO_INTERVAL, Estimate, Interval
from sins_env.evaluation.score.results import Results


@cache
def _quantile() -> float:
    """Return the quantile of the standard normal distribution at the upper end of the intervals."""
    from scipy import special  # slow to import

    return float(special.ndtri(resampling.TAILS[1]))


@dataclass(frozen=True, repr=False)
class Comparison:
    """Comparison of solver ``a`` with solver ``b`` over their common runs; each number has its 95 % interval."""

    task: str
    a: str
    b: str
    runs: int  #: number of common runs
    ratio: Estimate  #: RMS of a over RMS of b, for the quantity ``score``
    ratio_at_end: Estimate  #: ratio of the RMS at T
    success: Estimate  #: success rate of a minus that of b
    failures: Estimate  #: share of failed runs of a minus that of b
    better: Estimate  #: probability that a has the smaller error over time in a run; ties count half
    median_s: Estimate  #: median time to alignment of a minus that of b, s; NaN if both are censored
    score: str = "azimuth"  #: name of the quantity that ``ratio`` and ``better`` compare

    @property
    def differ(self) -> bool:
        """Whether the interval of the ratio excludes 1."""
        return apart(self.runs, self.ratio[1])

    def __repr__(self) -> str:
        ratio = f"{self.score} RMS ratio {_text(self.ratio, '.3f')}"
        return f"<Comparison of {self.a} with {self.b} on {self.task}: {self.runs} runs, {ratio}>"

    def __str__(self) -> str:
        verdict = f"{self.a if self.ratio[0] < 1 else self.b} is more accurate" if self.differ else "not told apart"
        if self.runs < LEAST_RUNS:
            verdict += f" (fewer than {LEAST_RUNS} runs)"
        lines = (
            f"{self.a} against {self.b} on {self.task}, {self.runs} common run{'s' * (self.runs > 1)}: {verdict}",
            f"  {f'{self.score} RMS, ratio':<26} {_text(self.ratio, '.3f')}",
            f"  the same at the end        {_text(self.ratio_at_end, '.3f')}",
            f"  success, difference        {_text(self.success, '+.1%')}",
            f"  failed runs, difference    {_text(self.failures, '+.1%')}",
            f"  smaller error in a run     {_text(self.better, '.1%')}",
            f"  median time, difference    {_text(self.median_s, '+.1f')} s",
        )
        return "\n".join(lines)


def _text(estimate: Estimate, form: str) -> str:
    value, (low, high) = estimate
    shown = "unknown" if math.isnan(value) else format(value, form)
    return shown if math.isnan(low) else f"{shown} [{low:{form}}, {high:{form}}]"


def apart(runs: int, ratio: Interval) -> bool:
    """Return whether a paired interval of a ratio excludes 1; False for few runs, or without an interval."""
    return runs >= LEAST_RUNS and (ratio[0] > 1 or ratio[1] < 1)


def compare(a: Results, b: Results, score: str | None = None) -> Comparison:
    """Compare solver ``a`` with solver ``b`` over the runs that both have.

    Args:
        score: name of the quantity to compare (quantities.py); None takes the one that the task ranks by, or azimuth.

    Raises:
        ValueError: no such score, different tasks or suites, no common run, or a task without a truth.
    """
    if (a.task.name, a.suite) != (b.task.name, b.suite):
        given = ", ".join(f"{one.label} on {one.task.name} (suite {one.suite})" for one in (a, b))
        raise ValueError(f"{given}; allowed: the same task and suite")
    if not a.records.criteria.scored:
        raise ValueError(f"{a.task.name} has no truth; allowed: tasks whose errors are scored")
    mine, its = common(a.records, b.records)
    x, y = a.records, b.records
    if score is None:
        score = a.task.rank_by if a.task.rank_by in quantities.allowed(x.criteria.navigates) else "azimuth"
    (errors, at_end), (its_errors, its_end) = (quantities.run_errors(r, score) for r in (x, y))
    pair = errors[mine], its_errors[its]
    times = x.aligned_s[mine], y.aligned_s[its]
    return Comparison(
        task=a.task.name,
        a=a.label,
        b=b.label,
        runs=len(mine),
        ratio=ratio_of_rms(*pair),
        ratio_at_end=ratio_of_rms(at_end[mine], its_end[its]),
        success=difference_of_rates(*(np.isfinite(one) for one in times)),
        failures=difference_of_rates(x.failed[mine], y.failed[its]),
        better=probability_of_less(*pair),
        median_s=difference_of_medians(*times),
        score=score,
    )


def common(a: Records, b: Records) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the rows in ``a`` and in ``b`` of the runs that both have.

    Raises:
        ValueError: no common run.
    """
    _, mine, its = np.intersect1d(a.run, b.run, assume_unique=True, return_indices=True)
    if not len(mine):
        raise ValueError("runs of the two solvers; allowed: at least one in common")
    return mine, its


def ratio_of_rms(a: Array, b: Array) -> Estimate:
    """Return the RMS of a (R,) over that of b (R,) with its BCa interval."""
    top, bottom = (resampling.units_of(np.square(one)[:, None]) for one in (a, b))
    return _ratio(top, bottom, resampling.resampled(top), resampling.resampled(bottom))


def paired_ratio(records: Records, reference: Records, at_end: bool = False, axis: int = 2) -> Estimate:
    """Return the RMS over that of a reference in the common runs, in the steady state or at T.

    If both errors follow the same noise, the interval is several times narrower than that of either RMS.

    Raises:
        ValueError: no common run.
    """
    mine, its = common(records, reference)
    a, b = ((r.final if at_end else r.steady_rms)[rows, axis] for r, rows in ((records, mine), (reference, its)))
    return ratio_of_rms(a, b)


def _ratio(top: Array, bottom: Array, drawn_top: Array, drawn_bottom: Array) -> Estimate:
    """Return the ratio of two RMS from columns of squares (units, 1) and their resampled sums (RESAMPLES, 1)."""
    ((low, high),) = resampling.root_interval(top, drawn_top, bottom, drawn_bottom)
    with np.errstate(divide="ignore", invalid="ignore"):
        value = float(np.sqrt(top.sum() / bottom.sum()))
    return value, (float(low), float(high))


def difference_of_rates(a: Mask, b: Mask) -> Estimate:
    """Return the share of a minus the share of b, two paired proportions (R,), with Bonett and Price's interval."""
    n = len(a)
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    p, q = (only_a + 1) / (n + 2), (only_b + 1) / (n + 2)
    half = _quantile() * math.sqrt((p + q - (p - q) ** 2) / (n + 2))
    return (only_a - only_b) / n, (max(p - q - half, -1.0), min(p - q + half, 1.0))


def probability_of_less(a: Array, b: Array) -> Estimate:
    """Return the share of pairs (R,) in which a is less than b, with Wilson's interval; ties count half."""
    return proportion(float(((a < b) + 0.5 * (a == b)).mean()), len(a))


def proportion(part: float, n: int) -> Estimate:
    """Return a share of n runs with Wilson's score interval."""
    z = _quantile()
    centre, half = part + z**2 / (2 * n), z * math.sqrt(part * (1 - part) / n + z**2 / (4 * n**2))
    scale = 1 + z**2 / n
    return part, (max((centre - half) / scale, 0.0), min((centre + half) / scale, 1.0))


def difference_of_medians(a: Array, b: Array) -> Estimate:
    """Return the median of a (R,) minus that of b (R,); censored times are +inf.

    A single run has an interval of NaN.
    """
    n = len(a)
    value = _minus(np.median(a), np.median(b), np.nan)
    if n < 2:
        return float(value), NO_INTERVAL
    rng = np.random.default_rng(resampling.SEED)
    parts: list[tuple[Array, Array]] = []
    portion = max(1_000_000 // n, 1)
    for done in range(0, resampling.RESAMPLES, portion):
        rows = rng.integers(n, size=(min(portion, resampling.RESAMPLES - done), n))
        parts.append((np.median(a[rows], axis=1), np.median(b[rows], axis=1)))
    drawn_a, drawn_b = (np.concatenate(part) for part in zip(*parts, strict=True))
    low, _ = resampling.percentile_interval(_minus(drawn_a, drawn_b, -np.inf))
    _, high = resampling.percentile_interval(_minus(drawn_a, drawn_b, np.inf))
    return float(value), (low, high)


def _minus(a: Any, b: Any, both_censored: float) -> Any:
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(a) & np.isinf(b), both_censored, np.subtract(a, b))


class Pairing:
    """Pairwise comparison of the solvers of one task, with one resampling for all that have the same runs.

    Args:
        results: results of the solvers.
        errors: for each solver, the RMS of each of its runs (R,).
        intervals: for each solver, the interval of its RMS, used for pairs without a common run.
    """

    def __init__(self, results: Sequence[Results], errors: Sequence[Array], intervals: Sequence[Interval]) -> None:
        self._runs = [one.records.run for one in results]
        self._errors, self._intervals = errors, intervals
        runs = [one.tobytes() for one in self._runs]
        usual = max(runs, key=runs.count, default=b"")
        self._place = {i: j for j, i in enumerate(i for i, one in enumerate(runs) if one == usual)}
        if self._place:
            squares = np.stack([np.square(errors[i]) for i in self._place], axis=1)
            self._units = resampling.units_of(squares)
            self._drawn = resampling.resampled(self._units)

    def apart(self, i: int, j: int) -> bool:
        """Return whether solvers i and j differ in their common runs; without one, whether their intervals are disjoint."""
        if i in self._place and j in self._place:
            p, q = ([self._place[k]] for k in (i, j))
            found = _ratio(self._units[:, p], self._units[:, q], self._drawn[:, p], self._drawn[:, q])
            return apart(len(self._runs[i]), found[1])
        both, mine, its = np.intersect1d(self._runs[i], self._runs[j], assume_unique=True, return_indices=True)
        if len(both):
            return apart(len(both), ratio_of_rms(self._errors[i][mine], self._errors[j][its])[1])
        one, other = self._intervals[i], self._intervals[j]
        return one[1] < other[0] or other[1] < one[0]
