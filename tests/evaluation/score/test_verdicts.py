"""Verdicts of the product's path: figures of a solver, wins with Holm, ranks, and too few runs. B8 is in test_exact.py."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from sins_env.arrays import Array
from sins_env.evaluation.score import exact, losses
from sins_env.evaluation.score.verdicts import LOOK_LEVEL, Entry, Measure, Verdict, judge

CAP = 3.0
MEASURE = Measure(CAP, 1.0)


def entry(error: Array, run: Any = None, oracle: Array | None = None) -> Entry:
    """Return a solver's runs; those beyond three caps have failed, and others are aligned after 100 s."""
    runs = np.arange(len(error)) if run is None else np.asarray(run)
    lost = ~(error <= 3.0 * CAP)
    return Entry(runs, error, lost, np.where(lost, math.inf, 100.0), oracle)


def flat(value: float, interval: tuple[float, float]) -> Any:
    """Return an estimate as approximate numbers."""
    return pytest.approx((value, *interval))


def errors(runs: int, *factors: float, spread: float = 0.1, seed: int = 0) -> list[Array]:
    """Return errors of solvers that share most of their noise."""
    rng = np.random.default_rng(seed)
    base = np.abs(rng.normal(size=runs))
    return [base * factor * np.exp(spread * rng.normal(size=runs)) for factor in factors]


def test_figures_of_a_solver_are_those_of_their_formulas() -> None:
    (error,) = errors(300, 1.0)
    error[:6] = [10.0, math.inf, math.nan, 9.5, 20.0, 4.0]
    (found,) = judge([entry(error)], MEASURE)
    loss = losses.capped(error, CAP)
    assert (found.failed, found.failed_ci) == exact.share(5, 300)
    assert (found.aligned, found.aligned_ci) == exact.share(295, 300)
    assert (found.score, *found.score_ci) == flat(*losses.score(loss))
    assert (found.median, found.median_ci) == exact.median(np.where(np.isnan(error), math.inf, error))
    assert (found.time_s, found.time_s_ci) == (100.0, (100.0, 100.0))
    assert found.x_bound == found.score
    assert found.failures == 5
    assert (found.rank, found.word, found.p, found.preliminary) == (1, None, None, False)


def test_the_oracle_adjusts_the_ratio_to_the_bound() -> None:
    """A solver at the bound: the luck of its runs is gone, and a tenth below it is below."""
    rng = np.random.default_rng(4)
    luck = rng.normal(size=250)
    error = np.abs(luck + 0.05 * rng.normal(size=250))
    (with_it,) = judge([entry(error, oracle=luck**2)], MEASURE)
    (without,) = judge([entry(error)], MEASURE)
    assert (with_it.x_bound, *with_it.x_bound_ci) == flat(*losses.over_bound(losses.capped(error, CAP), luck**2, 1.0))
    widths = [high - low for low, high in (with_it.x_bound_ci, without.x_bound_ci)]
    assert widths[0] < 0.2 * widths[1]
    assert abs(with_it.x_bound - 1.0) < 0.01
    assert (with_it.adjusted, without.adjusted, with_it.below_bound) == (True, False, False)
    (below,) = judge([entry(0.9 * error, oracle=luck**2)], MEASURE)
    assert below.below_bound is True
    (reference_only,) = judge([entry(0.9 * error, oracle=luck**2)], dataclasses.replace(MEASURE, holds=False))
    assert reference_only.below_bound is None


def test_no_interval_ends_beyond_the_cap() -> None:
    """Three runs of thirty fail and all others are equal: resamples without the three have no variance."""
    (found,) = judge([entry(np.where(np.arange(30) < 3, 20.0, 0.1))], MEASURE)
    assert found.score_ci[0] < found.score < found.score_ci[1] == CAP
    assert found.x_bound_ci[1] == CAP


def test_an_interval_of_capped_runs_does_not_begin_at_zero() -> None:
    """All runs but one fail: resamples without that one have no variance. At least 97 % are capped (Clopper-Pearson)."""
    (found,) = judge([entry(np.where(np.arange(200) < 1, 0.1, 20.0))], MEASURE)
    assert found.score_ci == (pytest.approx(CAP * np.sqrt(0.97246), rel=1e-4), CAP)
    assert found.x_bound_ci == found.score_ci


def test_wins_are_adjusted_by_holm() -> None:
    entries = [entry(one) for one in errors(200, 1.0, 0.9, 0.99, 1.2, 1.0)]
    found = judge(entries, MEASURE, yardstick=0)
    loss = [losses.capped(one.error, CAP) for one in entries]
    p = [exact.sign_flips(one, loss[0]) for one in loss[1:]]
    assert [one.p for one in found[1:]] == p
    assert [one.p_adjusted for one in found[1:]] == exact.holm(p).tolist()
    assert [one.word for one in found] == [None, "wins", "undecided", "loses", "undecided"]
    for one, its in zip(found[1:], loss[1:], strict=True):
        assert (one.ratio, *one.ratio_ci) == flat(*exact.ratio_by_flips(its, loss[0]))
    ranks = exact.beaten_by(np.stack(loss, axis=1), np.stack([one.failed for one in entries], axis=1))
    assert [(one.beaten_by, one.rank) for one in found] == [(n, n + 1) for n in ranks.tolist()]
    assert found[0].p is None
    strict = judge(entries, MEASURE, yardstick=0, level=LOOK_LEVEL)
    for one, other in zip(found[1:], strict[1:], strict=True):
        assert other.ratio_ci[0] < one.ratio_ci[0] < one.ratio_ci[1] < other.ratio_ci[1]


def test_who_fails_more_often_does_not_win() -> None:
    usual, better = errors(200, 1.0, 0.3)
    better[:8] = 20.0
    found = judge([entry(usual), entry(better)], MEASURE, yardstick=0)[1]
    assert found.ratio < 0.99
    assert found.p_adjusted is not None
    assert found.p_adjusted <= 0.05
    assert found.word == "undecided"
    back = judge([entry(better), entry(usual)], MEASURE, yardstick=0)[1]  # nor does the yardstick against it
    assert (back.word, back.p) == ("undecided", found.p)


def test_a_win_that_one_failure_undoes_is_fragile() -> None:
    usual, better = errors(200, 0.5, 0.45, spread=0.3)
    (_, found) = judge([entry(usual), entry(better)], MEASURE, yardstick=0)
    assert (found.word, found.fragile) == ("wins", True)
    usual, better = errors(200, 2.0, 1.0)
    (_, found) = judge([entry(usual), entry(better)], MEASURE, yardstick=0)
    assert (found.word, found.fragile) == ("wins", False)


def test_equal_within_two_per_cent_and_a_solver_against_itself() -> None:
    one, other = errors(200, 1.0, 1.0, spread=0.01)
    same, near = judge([entry(one), entry(one), entry(other)], MEASURE, yardstick=0)[1:]
    assert (same.p, same.ratio, same.word, same.rank) == (1.0, 1.0, "equal", 1)
    assert near.word == "equal"


@pytest.mark.parametrize(
    ("runs", "common", "word", "interval"), [(200, 200, "wins", True), (199, 199, None, True), (19, 19, None, False)]
)
def test_few_runs_give_no_verdict(runs: int, common: int, word: str | None, interval: bool) -> None:
    usual, better = errors(runs, 1.0, 0.5)
    found = judge([entry(usual), entry(better)], MEASURE, yardstick=0)[1]
    assert (found.common, found.word, found.rank is None) == (common, word, word is None)
    assert found.preliminary == (word is None)
    for ends in (found.score_ci, found.median_ci, found.time_s_ci, found.x_bound_ci, found.ratio_ci):
        assert math.isnan(ends[0]) != interval
    assert not math.isnan(found.failed_ci[0])  # shares always have one
    assert found.ratio == pytest.approx(found.score / judge([entry(usual)], MEASURE)[0].score)


def test_nobody_leads_with_fewer_runs() -> None:
    usual, better, best = errors(300, 1.0, 0.8, 0.5)
    few = entry(best[:150])
    other_runs = entry(best, run=np.arange(300) + 150)  # 150 in common
    found = judge([entry(usual), entry(better), few, other_runs], MEASURE, yardstick=0)
    assert [one.rank for one in found] == [2, 1, None, None]
    assert [one.common for one in found] == [300, 300, 150, 150]
    assert [one.preliminary for one in found] == [False, False, True, True]


def test_without_a_cap_there_is_no_verdict() -> None:
    usual, better = errors(250, 1.0, 0.5)
    found = judge([entry(usual), entry(better)], Measure(math.nan), yardstick=0)
    assert [(one.capped, one.rank, one.word) for one in found] == [(False, None, None)] * 2
    assert found[0].score == found[0].rms_raw == pytest.approx(math.sqrt(np.square(usual).mean()))
    unknown = Entry(np.arange(5), np.full(5, math.nan), np.zeros(5, dtype=bool), np.full(5, math.nan))
    (none,) = judge([unknown], MEASURE)
    assert math.isnan(none.score)
    assert math.isnan(none.aligned)


# ---- properties of B8 on the path of the product ----


def board(*given: Array) -> list[Verdict]:
    return judge([entry(one) for one in given], MEASURE, yardstick=0)


@pytest.mark.parametrize("bad", [4.0, 1e300, math.inf, math.nan])
def test_the_score_is_the_same_whatever_is_beyond_the_cap(bad: float) -> None:
    usual, one = errors(200, 1.0, 0.8)
    other = one.copy()
    one[7], other[7] = 3.5, bad
    before, after = (board(usual, each)[1] for each in (one, other))
    for name in ("score", "score_ci", "x_bound", "x_bound_ci", "ratio", "ratio_ci", "p", "p_adjusted", "rank"):
        assert getattr(before, name) == getattr(after, name), name


def test_p_is_symmetric_and_more_runs_change_no_earlier_loss() -> None:
    one, other = errors(220, 1.0, 0.97)
    assert board(one, other)[1].p == board(other, one)[1].p
    first = board(one[:200], other[:200])
    again = judge([entry(one), entry(other[:200])], MEASURE, yardstick=0)
    assert (again[1].p, again[1].ratio, again[1].score) == (first[1].p, first[1].ratio, first[1].score)
