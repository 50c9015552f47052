"""Exact tests and intervals against enumeration, scipy.stats and reference values that were computed elsewhere."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from sins_env.evaluation.score import exact, losses

A = np.array([0.31, 1.20, 0.05, 2.10, 0.88, 0.47, 1.65, 0.12, 0.73, 1.02, 0.29, 2.60])
B = np.array([0.35, 1.52, 0.11, 2.45, 0.80, 0.61, 1.90, 0.20, 0.95, 1.31, 0.22, 45.0])
ORACLE = np.array([0.30, 1.10, 0.10, 2.00, 0.80, 0.50, 1.60, 0.10, 0.70, 1.00, 0.30, 1.90])
CAP = 3.0
LA, LB = (losses.capped(errors, CAP) for errors in (A, B))


@pytest.mark.parametrize(
    ("part", "runs", "interval"),
    [
        (0, 40, (0.0, 0.088097)),
        (3, 100, (0.006230, 0.085176)),
        (25, 400, (0.040851, 0.090882)),
        (7, 7, (0.590384, 1.0)),
    ],
)
def test_share(part: int, runs: int, interval: tuple[float, float]) -> None:
    value, found = exact.share(part, runs)
    assert value == part / runs
    assert found == pytest.approx(interval, abs=1e-6)
    theirs = stats.binomtest(part, runs).proportion_ci(method="exact")
    assert found == pytest.approx((theirs.low, theirs.high), abs=1e-12)


@pytest.mark.parametrize(
    ("runs", "ranks"),
    [(5, None), (6, (1, 6)), (20, (6, 15)), (40, (14, 27)), (100, (40, 61)), (200, (86, 115)), (400, (180, 221))],
)
def test_ranks_of_a_median(runs: int, ranks: tuple[int, int] | None) -> None:
    assert exact.median_ranks(runs) == ranks


@pytest.mark.parametrize("runs", range(6, 60))
def test_coverage_of_a_median_is_the_least_above_95_percent(runs: int) -> None:
    ranks = exact.median_ranks(runs)
    assert ranks is not None
    low, high = ranks
    covers = stats.binom.cdf(high - 1, runs, 0.5) - stats.binom.cdf(low - 1, runs, 0.5)
    narrower = stats.binom.cdf(high - 2, runs, 0.5) - stats.binom.cdf(low, runs, 0.5)
    assert narrower < 0.95 <= covers


@pytest.mark.parametrize(
    ("values", "median", "interval"),
    [
        (A, 0.805, (0.29, 1.65)),
        (B, 0.875, (0.22, 1.90)),
        ([110, 95, 130, math.inf, 101, math.inf, 150, math.inf], 140.0, (95.0, math.inf)),
        ([1, 2, 3, math.inf, math.inf, math.inf, math.inf, math.inf], math.inf, (1.0, math.inf)),
        ([1, 2, 3, 4, math.inf, math.inf, math.inf, math.inf], math.inf, (1.0, math.inf)),
        ([3.0, 1.0, 2.0, 5.0], 2.5, (math.nan, math.nan)),
    ],
)
def test_median(values: np.ndarray, median: float, interval: tuple[float, float]) -> None:
    value, found = exact.median(np.asarray(values, dtype=float))
    assert value == pytest.approx(median)
    assert found == pytest.approx(interval, nan_ok=True)


def test_sign_flips_count_all_patterns_of_few_runs() -> None:
    assert exact.sign_flips(LA, LB) == 48 / 4096
    assert exact.sign_flips(LA[:-1], LB[:-1]) == 48 / 2048
    assert exact.sign_flips(LB, LA) == exact.sign_flips(LA, LB)
    assert exact.sign_flips(LA, LA) == 1.0
    d = (LA - LB)[:8]
    sums = [abs(sum(s * x for s, x in zip(signs, d, strict=True))) for signs in itertools.product((1, -1), repeat=8)]
    assert exact.sign_flips(LA[:8], LB[:8]) == np.mean([one >= abs(d.sum()) - 1e-12 for one in sums])


def test_sign_flips_of_many_runs_agree_with_the_normal_limit() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 400)) ** 2
    z = (a - b).sum() / math.sqrt(np.square(a - b).sum())
    p = 2 * stats.norm.sf(abs(z))
    assert exact.sign_flips(a, b) == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / exact.FLIPS) + 0.005)


def test_ratio_by_flips() -> None:
    value, (low, high) = exact.ratio_by_flips(LA, LB)
    assert (value, low, high) == pytest.approx((0.854667, 0.785690, 0.889296), abs=1e-6)
    other, (low_other, high_other) = exact.ratio_by_flips(LB, LA)
    assert (other, low_other, high_other) == pytest.approx((1 / value, 1 / high, 1 / low), rel=1e-9)
    assert exact.ratio_by_flips(LA, LA) == (1.0, (1.0, 1.0))
    assert math.isnan(exact.ratio_by_flips(LA, np.zeros_like(LA))[0])


def test_mcnemar() -> None:
    def pair(only_a: int, only_b: int) -> float:
        a = np.array([True] * only_a + [False] * only_b + [True, False])
        b = np.array([False] * only_a + [True] * only_b + [True, False])
        return exact.mcnemar(a, b)

    assert [pair(1, 7), pair(0, 6), pair(0, 0), pair(3, 3)] == [0.0703125, 0.03125, 1.0, 1.0]
    assert pair(2, 9) == pytest.approx(stats.binomtest(2, 11).pvalue)


def test_holm() -> None:
    assert exact.holm([0.012, 0.0004, 0.03, 0.2]) == pytest.approx([0.036, 0.0016, 0.06, 0.2])
    assert exact.holm([0.5, 0.04, 0.03]) == pytest.approx([0.5, 0.09, 0.09])


def test_fragile() -> None:
    assert exact.fragile(LA, LB, CAP)
    assert exact.fragile(LB, LA, CAP)
    rng = np.random.default_rng(7)
    b = rng.normal(size=60) ** 2
    assert not exact.fragile(0.25 * b, b, 3.0)


def test_who_is_beaten() -> None:
    rng = np.random.default_rng(3)
    base = rng.normal(size=(200, 1)) ** 2
    columns = base * np.array([1.0, 1.0, 1.3, 1.6]) * rng.uniform(0.95, 1.05, (200, 4))
    failed = np.zeros(columns.shape, dtype=bool)
    assert exact.beaten_by(columns, failed).tolist() == [0, 0, 2, 3]
    for j, i in itertools.permutations(range(4), 2):  # the same as pair by pair
        wins = (
            columns[:, i].mean() < columns[:, j].mean()
            and exact.sign_flips(columns[:, i], columns[:, j]) / 2 <= 0.05 / 3
        )
        assert wins == (i < j and j >= 2)
    failed[:40, 0] = True  # as errors of the level do, which the score does not have
    assert exact.beaten_by(columns, failed).tolist() == [1, 0, 1, 2]  # nor does the first beat the others now


def test_score() -> None:
    assert math.sqrt(np.mean(B**2)) == pytest.approx(13.0409, abs=1e-4)
    value, interval = losses.score(LA)
    assert (value, *interval) == pytest.approx((1.228081, 0.790749, 2.520999), abs=1e-6)
    value, interval = losses.score(LB)
    assert (value, *interval) == pytest.approx((1.436912, 0.931229, 2.614579), abs=1e-6)
    assert losses.score(np.full(9, 4.0)) == (2.0, (2.0, 2.0))
    assert math.isnan(losses.score(LA[:5])[1][0])


def test_what_is_beyond_the_cap_changes_nothing() -> None:
    worse = [losses.capped(np.array([0.1, -0.2, bad]), 1.0) for bad in (-1.5, 1e300, math.inf, math.nan)]
    for one in worse:
        assert one.tolist() == pytest.approx([0.01, 0.04, 1.0])


def test_over_bound() -> None:
    b = math.sqrt(1.2)
    value, interval = losses.over_bound(LA, ORACLE**2, b)
    assert (value, *interval) == pytest.approx((1.140009, 0.783931, 5.844364), abs=1e-6)
    assert losses.over_bound(ORACLE**2, ORACLE**2, b)[0] == pytest.approx(1.0)


def test_intervals_of_the_score_cover() -> None:
    """Misses in 400 samples of 100 runs: Gaussian errors, and 3 % of the runs a thousand times as far off."""
    rng = np.random.default_rng(11)
    x = rng.normal(size=(400, 100))
    lost = x * np.where(rng.random(x.shape) < 0.03, 1000.0, 1.0)
    size = rng.normal(size=400_000)
    for errors, factor in ((x, 1.0), (lost, 1000.0)):
        law = np.minimum(np.abs(size), 3.18) ** 2
        true = math.sqrt(law.mean() if factor == 1.0 else 0.97 * law.mean() + 0.03 * 3.18**2)
        columns = np.stack([losses.capped(one, 3.18) for one in errors], axis=1)
        found = [one.interval() for one in losses.scores(columns)]  # all with the same resamples
        misses = np.mean([not low <= true <= high for low, high in found])
        assert misses == pytest.approx(0.052, abs=3 * math.sqrt(0.052 * 0.948 / 400))


def test_the_mean_has_all_centres_that_sign_flips_keep() -> None:
    """Just inside an end no more than 95 % of all patterns are as far from zero, just outside fewer than 5 % are as far."""
    value, (low, high) = exact.mean(B)
    assert value == pytest.approx(B.mean())
    signs = np.array(list(itertools.product((-1, 1), repeat=len(B))))
    for end, outwards in ((low, -1), (high, 1)):
        p = [
            np.mean(np.abs(signs @ (B - c)) >= abs((B - c).sum()) * (1 - 1e-12))
            for c in (end - outwards * 1e-6, end + outwards * 1e-6)
        ]
        assert p[0] > exact.LEVEL >= p[1]
    assert exact.mean(np.full(8, 2.0)) == (2.0, (2.0, 2.0))
    assert np.isnan(exact.mean(B[:5])[1]).all()


def test_losses_of_time_means() -> None:
    """Their score is the mean over time of the RMS over runs, and a run moves it as one that is left out does."""
    rng = np.random.default_rng(5)
    errors = np.exp(0.5 * rng.standard_normal((400, 1))) * rng.standard_normal((400, 50))

    def armse(e: np.ndarray) -> float:
        return float(np.sqrt(np.square(e).mean(axis=0)).mean())

    found = losses.of_time_means(errors, math.inf)
    assert losses.score(found)[0] == pytest.approx(armse(errors), rel=1e-12)
    without = np.array([armse(np.delete(errors, i, axis=0)) for i in range(50)])
    moved = math.sqrt(found.mean()) - np.sqrt((found.sum() - found[:50]) / 399)
    np.testing.assert_allclose(armse(errors) - without, moved, rtol=0.02, atol=2e-5)
    np.testing.assert_allclose(losses.of_time_means(0.9 * errors, math.inf), 0.81 * found)


def test_a_run_counts_in_a_time_mean_with_no_more_than_the_cap() -> None:
    errors = np.ones((8, 5))
    for lost in (10.0, math.inf, math.nan, np.array([0, 0, 0, 0, 1e200])):
        errors[3] = lost
        some = losses.of_time_means(errors, 2.0)
        assert math.sqrt(some.mean()) <= math.sqrt((7 + 4) / 8) + 1e-12
        assert np.isfinite(some).all()
    errors[3] = 0.0
    assert losses.score(losses.of_time_means(errors, 2.0))[0] == pytest.approx(math.sqrt(7 / 8))
