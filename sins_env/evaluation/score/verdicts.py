"""Verdicts on the solvers of one task: what each has done, which of them win against the yardstick, and who is beaten by whom.

The runs of each solver come in as errors, failures and times to alignment; a :class:`Verdict` on each goes out. Three figures
say what a solver has done, and none hides another: the share of failed runs, the score (losses.py), and the median error. What
is said of two solvers rests on the runs that both have:

- Against the yardstick: sign flips of the paired losses, adjusted by Holm for all comparisons of the task. A solver wins if the
  adjusted p value is at most 5 %, its score is at least 1 % smaller, and McNemar does not tell that it fails more often.
- Ranks: one more than the number of solvers that beat it, one-sided at 5 % / (k - 1), in the score or in the share of failed
  runs, and in neither the other way. Those that nobody beats share rank 1 and hold the best of k solvers with a probability of
  95 %, although the leader was selected.
- Fewer than 200 common runs give no verdict, and below 20 runs there are values alone.

See docs/tasks_and_scores.md#verdicts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.evaluation.score import exact, losses
from sins_env.evaluation.score.exact import LEVEL
from sins_env.evaluation.score.resampling import NO_INTERVAL, Estimate, Interval

LEAST_VERDICT = 200  #: least number of common runs of a verdict
LEAST_INTERVAL = 20  #: least number of runs of an interval, but for shares, which always have one
WIN = 0.99  #: largest ratio of scores of a win
EQUAL: Interval = (0.98, 1.02)  #: ratios of solvers that count as equal
LOOKS = (200, 400, 800)  #: numbers of runs at which an undecided pair may be looked at, each at LOOK_LEVEL
LOOK_LEVEL = LEVEL / len(LOOKS)
BELOW, BELOW_CONFIDENCE = 0.98, 0.999  #: below the bound: the interval of that confidence lies below that ratio
LEAST_CAP = 2.5  #: least cap over the bound for that verdict; the cap alone takes 1 % off a score at the bound there
UNKNOWN: Estimate = (math.nan, NO_INTERVAL)

Word = Literal["wins", "loses", "equal", "undecided"]


@dataclass(frozen=True)
class Measure:
    """What the errors of a task are measured with, in the unit of the errors: rad, m or m/s."""

    cap: float  #: error at which losses are capped; NaN if there is none, and then there is no verdict
    bound: float = math.nan  #: Cramer-Rao bound of the score; NaN if there is none
    holds: bool = True  #: whether the bound holds; if not, it is only a reference

    @property
    def comparable(self) -> bool:
        """Whether a score may be held against the bound: the bound holds, and the cap is far enough above it."""
        return self.holds and not self.cap < LEAST_CAP * self.bound


@dataclass(frozen=True, eq=False)
class Entry:
    """Runs of one solver, as they are judged."""

    run: NDArray[np.int64]  #: (R,) numbers of the runs, each once
    error: Array  #: (R,) error of each run, not negative; NaN and inf count as the cap; all NaN if errors are not known
    failed: Mask  #: (R,)
    aligned_s: Array  #: (R,) time to alignment, s; inf if the run is not aligned, NaN if errors are not known
    oracle: Array | None = None  #: (R,) squared errors of the oracle in the same runs; None if they are not known


@dataclass(frozen=True)
class Verdict:
    """What a board says of one solver.

    Shares are from 0 to 1, errors in rad, m or m/s, and intervals of 95 %. A value or an interval that is not known is NaN,
    and what is not decided is None.
    """

    runs: int
    failed: float
    failed_ci: Interval
    aligned: float
    aligned_ci: Interval
    median: float  #: median error
    median_ci: Interval
    time_s: float  #: median time to alignment from the start of fine alignment; inf if most runs are not aligned
    time_s_ci: Interval
    rms_raw: float  #: RMS without a cap, which has no interval to be trusted
    preliminary: bool  #: whether the runs, or those in common, are too few for a verdict
    score: float  #: root of the mean capped loss; the uncapped RMS if there is no cap
    score_ci: Interval = NO_INTERVAL
    capped: bool = False  #: whether the score is capped
    x_bound: float = math.nan  #: score over the bound
    x_bound_ci: Interval = NO_INTERVAL
    adjusted: bool = False  #: whether ``x_bound`` is adjusted by the oracle
    below_bound: bool | None = None  #: whether the solver is better than the bound allows; None if the cap hides it
    common: int = 0  #: number of runs in common with the yardstick
    ratio: float = math.nan  #: score over that of the yardstick, in their common runs
    ratio_ci: Interval = NO_INTERVAL
    p: float | None = None  #: two-sided p value of equal scores of the solver and the yardstick
    p_adjusted: float | None = None  #: p value adjusted for all comparisons of the task
    word: Word | None = None  #: outcome of the comparison with the yardstick
    fragile: bool | None = None  #: whether one more run, in which the winner fails, would undo the win
    beaten_by: int | None = None  #: number of solvers that beat it
    rank: int | None = None

    @property
    def failures(self) -> int:
        """Number of failed runs."""
        return round(self.failed * self.runs)


def judge(
    entries: Sequence[Entry], measure: Measure, yardstick: int | None = None, level: float = LEVEL
) -> list[Verdict]:
    """Return the verdict on each solver of one task and suite, in the given order.

    Args:
        entries: runs of each solver.
        measure: cap and bound of the task.
        yardstick: index of the solver that the others are compared with; None for none.
        level: probability of a false win in the task. Each look at 200, 400 and 800 runs takes LOOK_LEVEL.
    """
    out = [_alone(entry, measure) for entry in entries]
    for same in _of_same_runs(entries, [i for i, one in enumerate(out) if one.capped]):
        for i, found in zip(same, _scores([entries[i] for i in same], measure), strict=True):
            out[i] = replace(out[i], **found)
    judged = [i for i, one in enumerate(out) if one.capped]
    if yardstick is not None and yardstick in judged:
        _compare(out, entries, measure.cap, yardstick, level)
    _rank(out, entries, measure.cap, yardstick, level)
    return out


def _of_same_runs(entries: Sequence[Entry], chosen: Sequence[int]) -> list[list[int]]:
    """Return the chosen solvers in groups of the same runs and of the same knowledge of the oracle."""
    groups: dict[tuple[bytes, bool], list[int]] = {}
    for i in chosen:
        groups.setdefault((entries[i].run.tobytes(), entries[i].oracle is None), []).append(i)
    return list(groups.values())


def _alone(entry: Entry, measure: Measure) -> Verdict:
    """Return what needs no resamples: shares, medians, and the RMS without a cap."""
    runs = len(entry.run)
    scored, timed = not np.isnan(entry.error).all(), not np.isnan(entry.aligned_s).all()
    aligned = exact.share(int(np.isfinite(entry.aligned_s).sum()), runs) if timed else UNKNOWN
    median = exact.median(np.where(np.isnan(entry.error), np.inf, entry.error)) if scored else UNKNOWN
    time = exact.median(entry.aligned_s) if timed else UNKNOWN
    if runs < LEAST_INTERVAL:
        median, time = (median[0], NO_INTERVAL), (time[0], NO_INTERVAL)
    with np.errstate(over="ignore"):
        rms = math.sqrt(float(np.square(entry.error).mean()))
    return Verdict(
        runs,
        *exact.share(int(entry.failed.sum()), runs),
        *aligned,
        *median,
        *time,
        rms_raw=rms,
        preliminary=runs < LEAST_VERDICT,
        score=rms,
        capped=scored and measure.cap > 0.0,
        x_bound=rms / measure.bound if measure.bound > 0.0 else math.nan,
    )


def _scores(entries: Sequence[Entry], measure: Measure) -> list[dict[str, Any]]:
    """Return the scores and ratios to the bound of solvers with the same runs."""
    loss = np.stack([losses.capped(one.error, measure.cap) for one in entries], axis=1)
    roots, enough, bounded = losses.scores(loss), len(loss) >= LEAST_INTERVAL, measure.bound > 0.0
    oracle, told = entries[0].oracle, measure.comparable
    if bounded:
        over = (
            [root.over(measure.bound) for root in roots]
            if oracle is None
            else losses.over_bounds(loss, oracle, measure.bound)
        )
    out: list[dict[str, Any]] = []
    for i, root in enumerate(roots):
        at_cap = exact.share(int((loss[:, i] >= measure.cap**2).sum()), len(loss))[1][0]
        least = measure.cap * math.sqrt(at_cap)  # if all other errors were zero
        ends = root.interval(measure.cap, least) if enough else NO_INTERVAL
        found: dict[str, Any] = {"score": root.value, "score_ci": ends}
        if bounded:
            found |= {
                "x_bound": over[i].value,
                "x_bound_ci": over[i].interval(measure.cap / measure.bound, least / measure.bound)
                if enough
                else NO_INTERVAL,
                "adjusted": oracle is not None,
                "below_bound": over[i].interval(confidence=BELOW_CONFIDENCE)[1] < BELOW if told else None,
            }
        out.append(found)
    return out


def _compare(out: list[Verdict], entries: Sequence[Entry], cap: float, yardstick: int, level: float) -> None:
    """Compare every solver with the yardstick in their common runs, in place."""
    reference = entries[yardstick]
    out[yardstick] = replace(out[yardstick], common=len(reference.run))
    rates: dict[int, tuple[bool, bool]] = {}  # whether solver and yardstick fail more often than the other
    plain: dict[int, float] = {}
    fragile: dict[int, bool] = {}
    for same in _of_same_runs(entries, [i for i, one in enumerate(out) if one.capped and i != yardstick]):
        common, mine, its = np.intersect1d(entries[same[0]].run, reference.run, return_indices=True)
        few = out[same[0]].preliminary or len(common) < LEAST_VERDICT
        if len(common):
            theirs = losses.capped(reference.error[its], cap)
            own = np.stack([losses.capped(entries[i].error[mine], cap) for i in same], axis=1)
            pairs = exact.against(own, theirs, level if len(common) >= LEAST_INTERVAL else None)
        for j, i in enumerate(same):
            out[i] = replace(out[i], common=len(common), preliminary=few)
            if not len(common):
                continue
            p, (ratio, ends) = pairs[j]
            out[i] = replace(out[i], ratio=ratio, ratio_ci=ends, p=None if few else p)
            if not few:
                rates[i] = exact.fails_more(entries[i].failed[mine], reference.failed[its])
                plain[i] = p
                fragile[i] = p <= level and exact.fragile(own[:, j], theirs, cap)
    for i, p in zip(plain, exact.holm(list(plain.values())).tolist(), strict=True):
        word = word_of((out[i].ratio, out[i].ratio_ci), p <= level, *rates[i])
        decided = word in ("wins", "loses")
        out[i] = replace(out[i], p_adjusted=p, word=word, fragile=fragile[i] if decided else None)


def word_of(ratio: Estimate, apart: bool, fails_more: bool, fails_less: bool) -> Word:
    """Return the outcome of a comparison from the ratio of the scores, and from who is told to fail more often."""
    value, (low, high) = ratio
    if apart and value < WIN and not fails_more:
        return "wins"
    if apart and value > 1.0 / WIN and not fails_less:
        return "loses"
    return "equal" if EQUAL[0] <= low and high <= EQUAL[1] else "undecided"


def _rank(out: list[Verdict], entries: Sequence[Entry], cap: float, yardstick: int | None, level: float) -> None:
    """Rank the solvers that share enough runs, in place; the yardstick and those with the most runs come in first."""
    members: list[int] = []
    common = np.empty(0, dtype=np.int64)
    for i in sorted(range(len(entries)), key=lambda i: (i != yardstick, -len(entries[i].run))):
        both = np.intersect1d(common, entries[i].run) if members else np.sort(entries[i].run)
        if out[i].capped and not out[i].preliminary and len(both) >= LEAST_VERDICT:
            members.append(i)
            common = both
    if not members:
        return
    rows = [np.intersect1d(entries[i].run, common, return_indices=True)[1] for i in members]
    columns = [losses.capped(entries[i].error[at], cap) for i, at in zip(members, rows, strict=True)]
    failed = [entries[i].failed[at] for i, at in zip(members, rows, strict=True)]
    counts = exact.beaten_by(np.stack(columns, axis=1), np.stack(failed, axis=1), level)
    for i, count in zip(members, counts.tolist(), strict=True):
        out[i] = replace(out[i], beaten_by=count, rank=1 + count)
