"""Paired comparison of two solvers on the same runs.

Every solver meets the same noise, so the ratio of two scores is known better than either score.

- Score: sign flips of the paired losses, p value and all ratios that are not rejected (exact.py).
- Failed runs: McNemar, and the interval of Bonett and Price (2012), doi 10.3102/1076998611411915, also if no run differs.
- Time to alignment: sign test of the paired times; runs in which both are censored, or aligned at the same time, are dropped.
- Probability of the smaller error: Wilson's score interval, which is conservative if runs tie.
- Median time: percentiles over pairs. BCa does not exist, for leaving out one run tells nothing about a median. A
  difference of two censored medians is unknown and widens the interval on both sides.

Ratios of RMS with BCa intervals serve the reproduction of printed tables.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.score import exact, losses, quantities, resampling
from sins_env.evaluation.score.headline import cap_of, error_of_run, headline
from sins_env.evaluation.score.resampling import LEAST_RUNS, NO_INTERVAL, Estimate, Interval
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.score.verdicts import LEAST_INTERVAL, LEAST_VERDICT, Word, word_of


@cache
def _quantile() -> float:
    """Return the quantile of the standard normal distribution at the upper end of the intervals."""
    from scipy import special  # slow to import

    return float(special.ndtri(resampling.TAILS[1]))


@dataclass(frozen=True, repr=False)
class Comparison:
    """Comparison of solver ``a`` with solver ``b`` over their common runs; each estimate has its 95 % interval."""

    task: str
    a: str
    b: str
    runs: int  #: number of common runs
    ratio: Estimate  #: score of a over that of b, for the quantity ``score``; no interval below 20 runs
    ratio_at_end: Estimate  #: the same for the errors at T
    p: float  #: p value of equal scores
    failed: tuple[int, int]  #: number of failed runs of a and of b
    failures: Estimate  #: share of failed runs of a minus that of b
    p_failures: float  #: p value of equal shares of failed runs
    success: Estimate  #: share of aligned runs of a minus that of b
    better: Estimate  #: probability that a has the smaller error over time in a run; ties count half
    median_s: Estimate  #: median time to alignment of a minus that of b, s; NaN if both are censored
    p_time: float  #: p value of equal times to alignment
    word: Word  #: outcome for ``a``
    fragile: bool  #: whether one more run, in which the winner fails, would undo the win
    capped: bool = True  #: whether errors are capped; without a cap nobody wins
    score: str = "azimuth"  #: name of the quantity that ``ratio`` and ``better`` compare

    @property
    def differ(self) -> bool:
        """Whether one of the two wins."""
        return self.word in ("wins", "loses")

    @property
    def verdict(self) -> str:
        """Who wins and how sure that is, in words."""
        if not self.capped:
            return "no verdict (errors have no cap without a bound)"
        if self.runs < LEAST_VERDICT:
            few = f"fewer than {LEAST_VERDICT} runs"
            return f"preliminary ({few})" if self.runs >= LEAST_INTERVAL else f"values alone ({few})"
        if self.word == "equal":
            return "equal within 2 %"
        if not self.differ:
            return f"not told apart (p {self.p:.2g})"
        winner = self.a if self.word == "wins" else self.b
        return f"{winner} wins (p {self.p:.2g}{', fragile: one more failed run would undo it' if self.fragile else ''})"

    def __repr__(self) -> str:
        return f"<Comparison of {self.a} with {self.b} on {self.task}: {self.runs} runs, {self.verdict}>"

    def __str__(self) -> str:
        failed = f"{self.failed[0]} against {self.failed[1]} of {self.runs}, p {self.p_failures:.2g}"
        lines = (
            f"{self.a} against {self.b} on {self.task}, {self.runs} common run{'s' * (self.runs > 1)}: {self.verdict}",
            f"  {f'{self.score} score, ratio':<26} {_text(self.ratio, '.3f')}",
            f"  the same at the end        {_text(self.ratio_at_end, '.3f')}",
            f"  failed runs                {failed}",
            f"  failed runs, difference    {_text(self.failures, '+.1%')}",
            f"  aligned runs, difference   {_text(self.success, '+.1%')}",
            f"  smaller error in a run     {_text(self.better, '.1%')}",
            f"  median time, difference    {_text(self.median_s, '+.1f')} s, p {self.p_time:.2g}",
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
        score: name of the quantity to compare (quantities.py); None takes the score of the task.

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
    name = headline(a.task) if score is None else score
    over_time, at_end = zip(*(quantities.run_errors(r, name) for r in (x, y)), strict=True)
    if score is None:
        over_time = tuple(error_of_run(a.task, r) for r in (x, y))
    cap = cap_of(a.task, x, a.bound or b.bound, score)
    capped = not math.isnan(cap)
    cap = cap if capped else math.inf
    pair = over_time[0][mine], over_time[1][its]
    (ratio, p), (ratio_at_end, _) = (
        _of_losses(*(losses.capped(one, cap) for one in both)) for both in (pair, (at_end[0][mine], at_end[1][its]))
    )
    times = x.aligned_s[mine], y.aligned_s[its]
    failed = a.entry.failed[mine], b.entry.failed[its]
    word: Word = "undecided"
    if capped and len(mine) >= LEAST_VERDICT:
        word = word_of(ratio, p <= exact.LEVEL, *exact.fails_more(*failed))
    mine_lost, its_lost = (losses.capped(one, cap) for one in pair)
    return Comparison(
        task=a.task.name,
        a=a.label,
        b=b.label,
        runs=len(mine),
        ratio=ratio,
        ratio_at_end=ratio_at_end,
        p=p,
        failed=(int(failed[0].sum()), int(failed[1].sum())),
        failures=difference_of_rates(*failed),
        p_failures=exact.mcnemar(*failed),
        success=difference_of_rates(*(np.isfinite(one) for one in times)),
        better=probability_of_less(*pair),
        median_s=difference_of_medians(*times),
        p_time=exact.sign_test(*times),
        word=word,
        fragile=word in ("wins", "loses") and exact.fragile(mine_lost, its_lost, cap),
        capped=capped,
        score=name,
    )


def _of_losses(a: Array, b: Array) -> tuple[Estimate, float]:
    """Return the ratio of the scores of paired losses, and the p value of equal ones."""
    ((p, ratio),) = exact.against(a[:, None], b, exact.LEVEL if len(a) >= LEAST_INTERVAL else None)
    return ratio, p


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
