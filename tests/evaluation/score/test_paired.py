"""Intervals against SciPy, closed forms and simulation; pairs, and the ranks that rest on them."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

from sins_env.evaluation import compare
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.records import score
from sins_env.evaluation.score import exact, losses, paired, ranking, resampling
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.units import ARCSEC, DEG

TASK = get_task("sway-white-v0")
CRITERIA = Criteria(0.1, 1000, 0, TASK.delta, np.ones(3), 60.0)
Z = stats.norm.ppf(0.975)


def solver(name, azimuth, runs=None, times=None, suite="s"):
    """Runs with these constant azimuth errors (R,) in arcsec, aligned at ``times`` s."""
    azimuth = np.asarray(azimuth, dtype=float)
    phi = azimuth[:, None, None] * np.array([0.0, 0.0, ARCSEC]) * np.ones((1, 1000, 1))
    records = score(phi, None, CRITERIA)
    if runs is not None:
        records = dataclasses.replace(records, run=np.asarray(runs))
    if times is not None:
        records = dataclasses.replace(records, t_conv=np.tile(np.asarray(times, dtype=float)[:, None], 3))
    return Results(TASK, name, {}, suite, records)


def common_noise(count, sigma, spread, seed=0):
    """(2, count): errors that share most of their noise; the true ratio of their RMS is that of ``sigma``."""
    rng = np.random.default_rng(seed)
    shared = rng.normal(0, 1, count)
    own = rng.normal(0, spread, (2, count))
    return np.array(sigma)[:, None] * (shared + own) / math.sqrt(1 + spread**2)


# ---- the bootstrap ----


def test_counts_are_resamples():
    counts = resampling.draw_counts(50, 2000)
    assert np.all(counts.sum(axis=1) == 50)
    assert np.all(counts == np.round(counts))
    np.testing.assert_allclose(counts.mean(), 1.0)
    # each count is binomial(50, 1 / 50), counts of a resample have covariance -1 / 50
    variance = counts.var(axis=0).mean()
    assert variance == pytest.approx(49 / 50, rel=0.03)
    assert np.cov(counts[:, 0], counts[:, 1])[0, 1] == pytest.approx(-1 / 50, abs=3 / math.sqrt(2000))


@pytest.mark.parametrize("runs", [12, 80, 700])
def test_rms_interval_is_scipys_bca(runs):
    x = np.abs(np.random.default_rng(runs).standard_t(5, runs))
    value, ends = resampling.rms_interval(x)
    found = stats.bootstrap((x**2,), lambda v, axis: np.sqrt(v.mean(axis=axis)), n_resamples=40_000, method="BCa",
                            vectorized=True, batch=2000, rng=np.random.default_rng(1)).confidence_interval  # fmt: skip
    assert value == pytest.approx(np.sqrt((x**2).mean()))
    # both ends are quantiles of so many draws: a few per cent of the width
    np.testing.assert_allclose(ends, found, atol=0.06 * (found.high - found.low))
    percentile = np.quantile(np.sqrt(resampling.resampled(x[:, None] ** 2)[:, 0] / runs), [0.025, 0.975])
    assert ends[0] > percentile[0]  # what BCa corrects: skewness moves both ends up
    assert ends[1] > percentile[1]


def test_ratio_interval_is_scipys_paired_bca():
    a, b = np.square(common_noise(60, (1.2, 1.0), 0.4))
    _, ends = paired.ratio_of_rms(np.sqrt(a), np.sqrt(b))
    found = stats.bootstrap(
        (a, b), lambda x, y, axis: np.sqrt(x.sum(axis=axis) / y.sum(axis=axis)), paired=True, vectorized=True,
        n_resamples=40_000, batch=2000, method="BCa", rng=np.random.default_rng(1),
    ).confidence_interval  # fmt: skip
    np.testing.assert_allclose(ends, found, atol=0.06 * (found.high - found.low))


@pytest.mark.parametrize("runs", [2 * resampling.MOST_UNITS + 7, 60_000])
def test_many_runs_are_resampled_in_blocks(runs):
    x = np.abs(np.random.default_rng(0).normal(0, 2.0, runs))
    assert resampling.units_of(x[:, None]).shape == (resampling.MOST_UNITS, 1)
    assert resampling.units_of(x[:, None]).sum() == pytest.approx(x.sum())
    _, (low, high) = resampling.rms_interval(x)
    exact = 2 * Z / math.sqrt(2 * runs)  # half an interval of the RMS of normal errors
    assert (high - low) / 2 == pytest.approx(2 * exact / 2, rel=0.08)
    assert low < 2.0 < high


def test_bootstrap_medians_have_their_exact_distribution():
    """P(median* <= k-th smallest) is a binomial tail for odd n; for even n enumeration of all resamples is the oracle."""
    for n in (9, 101):
        drawn = resampling.resampled_medians(np.arange(1.0, n + 1))
        for k in (n // 3, n // 2, 2 * n // 3):
            exact = stats.binom.sf((n + 1) // 2 - 1, n, k / n)
            assert (drawn <= k).mean() == pytest.approx(exact, abs=4 * math.sqrt(0.25 / len(drawn)))
    n = 4
    grid = np.stack(np.meshgrid(*[np.arange(n)] * n), axis=-1).reshape(-1, n)
    every = np.median(np.array([1.0, 2.0, 5.0, 11.0])[grid], axis=1)
    drawn = resampling.resampled_medians(np.array([11.0, 1.0, 5.0, 2.0]))
    for value in np.unique(every):
        assert (drawn == value).mean() == pytest.approx((every == value).mean(), abs=4 * math.sqrt(0.25 / len(drawn)))


# ---- coverage ----


def coverage(inside):
    """Three standard errors of a proportion, over what is claimed."""
    p, trials = np.mean(inside), len(inside)
    return p, 3 * math.sqrt(0.05 * 0.95 / trials)


def test_ratio_interval_covers():
    inside = []
    for seed in range(400):
        a, b = common_noise(80, (1.1, 1.0), 0.5, seed)
        low, high = paired.ratio_of_rms(a, b)[1]
        inside.append(low <= 1.1 <= high)
    p, margin = coverage(inside)
    assert 0.94 - margin < p < 0.95 + margin


def test_success_interval_covers_exactly():
    """All outcomes of 30 pairs, by their multinomial probability: the coverage is known, not simulated."""
    n, only_a, only_b = 30, 0.15, 0.05
    covered = 0.0
    for i in range(n + 1):
        for j in range(n + 1 - i):
            a = np.array([True] * i + [False] * (n - i))
            b = np.array([False] * i + [True] * j + [False] * (n - i - j))
            value, (low, high) = paired.difference_of_rates(a, b)
            assert value == pytest.approx((i - j) / n)
            if low <= only_a - only_b <= high:
                covered += stats.multinomial.pmf([i, j, n - i - j], n, [only_a, only_b, 1 - only_a - only_b])
    assert 0.94 < covered < 0.985
    same = np.ones(20, dtype=bool)
    value, (low, high) = paired.difference_of_rates(same, same)
    assert value == 0
    assert -0.25 < low < 0 < high < 0.25  # no difference seen is not no difference


def test_probability_of_less():
    assert paired.probability_of_less(np.array([1.0, 2, 3, 4]), np.array([2.0, 2, 2, 5]))[0] == (1 + 0.5 + 0 + 1) / 4
    n, p = 40, 0.7
    wilson = [paired.probability_of_less(np.arange(n) >= k, np.full(n, 0.5))[1] for k in range(n + 1)]
    for k, ends in enumerate(wilson):
        np.testing.assert_allclose(ends, stats.binomtest(k, n).proportion_ci(method="wilson"), atol=1e-12)
    covered = sum(stats.binom.pmf(k, n, p) for k, (low, high) in enumerate(wilson) if low <= p <= high)
    assert covered > 0.93


def test_difference_of_medians_with_censored_runs():
    rng = np.random.default_rng(2)
    b = rng.uniform(100, 200, 99)
    value, (low, high) = paired.difference_of_medians(b + 10.0, b)
    assert (value, low, high) == (pytest.approx(10.0),) * 3  # a constant shift has no spread in pairs
    most = np.where(np.arange(99) < 70, np.inf, b)
    value, (low, high) = paired.difference_of_medians(most, b)
    assert (value, low, high) == (math.inf, math.inf, math.inf)
    half = np.where(np.arange(99) < 50, np.inf, b)
    value, (low, high) = paired.difference_of_medians(half, b)
    assert value == math.inf
    assert math.isfinite(low)
    value, (low, high) = paired.difference_of_medians(most, most)
    assert math.isnan(value)
    assert (low, high) == (-math.inf, math.inf)  # nothing is known
    value, ends = paired.difference_of_medians(b[:1], b[:1])
    assert value == 0
    assert all(map(math.isnan, ends))


def test_difference_of_medians_covers():
    inside = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        shared = rng.normal(0, 20, 41)
        a, b = 155 + shared + rng.normal(0, 10, 41), 150 + shared + rng.normal(0, 10, 41)
        a[a > 180] = np.inf  # beyond the horizon
        low, high = paired.difference_of_medians(a, b)[1]
        inside.append(low <= 5.0 <= high)
    p, margin = coverage(inside)
    assert p > 0.95 - margin


# ---- comparing results ----


def test_compare():
    a, b = common_noise(200, (800.0, 1000.0), 0.2)
    times = np.linspace(100, 200, 200)
    found = compare(solver("a", a, times=times), solver("b", b, times=np.where(times > 180, np.inf, times + 5)))
    assert found.runs == 200
    loss, its = (losses.capped(one * ARCSEC, 0.7 * DEG) for one in (a, b))
    assert (found.ratio[0], *found.ratio[1]) == pytest.approx([*flat(exact.ratio_by_flips(loss, its))], rel=1e-6)
    assert flat(found.ratio) == pytest.approx([*flat(found.ratio_at_end)])
    assert found.ratio[1][0] < 0.8 < found.ratio[1][1] < 0.9
    assert found.differ
    assert (found.word, found.fragile, found.p) == ("wins", False, 1 / (1 + exact.FLIPS))
    assert found.better[0] == (np.abs(a) < np.abs(b)).mean()
    assert found.success[0] == pytest.approx((times > 180).mean())
    assert found.median_s[0] == pytest.approx(-5.0)
    text = str(found)
    assert "a against b on sway-white-v0, 200 common runs: a wins (p 0.0001)" in text
    assert "failed runs                0 against 0 of 200, p 1" in text
    assert f"{found.ratio[0]:.3f} [{found.ratio[1][0]:.3f}, {found.ratio[1][1]:.3f}]" in text
    back = compare(solver("b", b), solver("a", a))
    assert "a wins (p 0.0001)" in str(back)
    assert back.ratio[0] == pytest.approx(1 / found.ratio[0])
    np.testing.assert_allclose(back.ratio[1], [1 / found.ratio[1][1], 1 / found.ratio[1][0]], rtol=1e-2)


def flat(estimate):
    return estimate[0], *estimate[1]


def test_compare_pairs_by_run():
    a, b = common_noise(500, (1.0, 1.0), 0.1)
    order = np.sort(np.random.default_rng(0).permutation(500)[:260])
    found = compare(solver("a", a), solver("b", b[order] * 1.2, runs=order))
    assert found.runs == 260
    assert found.differ
    with pytest.raises(ValueError, match="in common"):
        compare(solver("a", a), solver("b", b, runs=range(1000, 1100)))
    with pytest.raises(ValueError, match="allowed: the same task and suite"):
        compare(solver("a", a), solver("b", b, suite="other"))
    few = compare(solver("a", a[:199]), solver("b", 3 * a[:199]))
    assert not few.differ
    assert "199 common runs: preliminary (fewer than 200 runs)" in str(few)
    assert math.isnan(compare(solver("a", a[:19]), solver("b", 3 * a[:19])).ratio[1][0])
    same = compare(solver("a", a), solver("x", a))
    assert (same.p, same.word) == (1.0, "equal")
    assert "equal within 2 %" in str(same)


# ---- ranks ----


def test_pairs_tell_apart_what_single_intervals_cannot():
    a, b = common_noise(200, (1000.0, 1050.0), 0.05)
    one, other = solver("a", a), solver("b", b)
    assert one.summary.rms_ci["U"][1] > other.summary.rms_ci["U"][0]
    assert [(rank, r.solver) for rank, r in ranking.ranked([other, one])] == [(1, "a"), (2, "b")]
    _, alone = common_noise(200, (1.0, 1050.0), 0.05, seed=3)  # nearly the same size on noise of its own
    assert [rank for rank, _ in ranking.ranked([one, solver("c", alone)])] == [1, 1]
    elsewhere = ranking.ranked(
        [one, solver("d", 3 * b, runs=range(500, 700))]
    )  # no common run: no verdict on the second
    assert [rank for rank, _ in elsewhere] == [1, None]


def test_ranks_count_who_beats_a_solver():
    """b ties with a, c with b but not with a: one solver beats c. The rank is one more than their number."""
    rng = np.random.default_rng(5)
    base = rng.normal(0, 700, 300)
    noise = rng.normal(0, 1, (4, 300))
    a, b, c, d = (base * scale * (1 + 0.06 * e) for scale, e in zip((1, 1.005, 1.018, 1.5), noise, strict=True))
    lines = [solver(name, x) for name, x in zip("abcd", (a, b, c, d), strict=True)]
    p = {(x.solver, y.solver): compare(x, y).p / 2 <= 0.05 / 3 for x in lines for y in lines if x is not y}
    assert (p["a", "b"], p["a", "c"], p["b", "c"]) == (False, True, False)
    expected = [(1, "a"), (1, "b"), (2, "c"), (4, "d")]
    for order in ((0, 1, 2, 3), (3, 1, 2, 0), (2, 3, 0, 1)):
        found = ranking.ranked([lines[i] for i in order])
        assert [(rank, one.solver) for rank, one in found] == expected
    assert [rank for rank, _ in ranking.ranked([solver("x", a), solver("y", a)])] == [1, 1]
    perfect = ranking.ranked([solver("a", a), solver("zero", 0 * a)])
    assert [(rank, one.solver) for rank, one in perfect] == [(1, "zero"), (2, "a")]


def test_who_has_fewer_runs_has_no_rank():
    a, _ = common_noise(300, (1000.0, 1050.0), 0.05)
    half = solver("half", 0.5 * a[:150], runs=range(150))
    lines = ranking.ranked([half, solver("a", a), solver("c", a * 1.2)])
    assert [(rank, one.solver) for rank, one in lines] == [(1, "a"), (2, "c"), (None, "half")]


def test_summaries_together_equal_those_alone():
    from sins_env.evaluation.score.results import summarise_together

    sizes = (30, 40, 30, 1)
    data = [np.random.default_rng(i).normal(0, 500, n) for i, n in enumerate(sizes)]
    together, alone = ([solver("x", x) for x in data] for _ in range(2))
    summarise_together(together)
    for one, other in zip(together, alone, strict=True):
        for axis in "ENU":
            np.testing.assert_allclose(one.summary.rms_ci[axis], other.summary.rms_ci[axis], rtol=1e-12)
            assert one.summary.rms[axis] == other.summary.rms[axis]
