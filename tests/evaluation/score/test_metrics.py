"""Scores against hand-made error histories with closed-form answers."""

import dataclasses
import math

import numpy as np
import pytest

from sins_env.evaluation import get_task
from sins_env.evaluation.play import errors
from sins_env.evaluation.play.criteria import MAX_HISTORY, Criteria
from sins_env.evaluation.play.records import Records, Scorer, score
from sins_env.evaluation.score import consistency, metrics, resampling
from sins_env.units import ARCSEC

EPOCH, K, COARSE, HOLD = 0.1, 1000, 200, 30.0
T = K * EPOCH
t = (1 + np.arange(K)) * EPOCH
CRITERIA = Criteria(EPOCH, K, COARSE, np.array([1e-3, 1e-3, 1e-2]), np.array([0.5, 0.5, 1.5]), HOLD, known_start=True)


def histories(*azimuths):
    """Runs with these azimuth errors (K,) and perfect levels."""
    phi = np.zeros((len(azimuths), K, 3))
    phi[:, :, 2] = azimuths
    return phi


def decay(tau, scale=1.0, from_s=COARSE * EPOCH):
    return scale * np.exp(-(t - from_s) / tau)


def test_convergence_time_of_a_decay():
    taus = np.array([2.0, 5.0, 10.0])
    found = score(histories(*(decay(tau) for tau in taus)), None, CRITERIA).t_conv[:, 2]
    exact = taus * np.log(1.0 / 1e-2)
    assert np.all((found - exact >= -1e-9) & (found - exact < EPOCH + 1e-9))


def test_a_late_excursion_restarts_the_clock_and_may_censor():
    good = np.zeros(K)
    for last, expected in ((500, 30.1), (699, 50.0), (700, math.inf), (999, math.inf)):
        e = good.copy()
        e[last - 1] = 0.02  # epoch `last`: within from epoch last + 1 on, for K - last - 1 epochs more
        records = score(histories(e), None, CRITERIA)
        assert records.t_conv[0, 2] == pytest.approx(expected)
        held = math.isfinite(expected)
        assert records.hold_max[0, 2] == (0.0 if held else 0.02)
    assert score(histories(good), None, CRITERIA).t_conv[0, 2] == pytest.approx(EPOCH)


def test_coarse_errors_do_not_count():
    e = np.where(t <= COARSE * EPOCH, 3.0, 0.0)
    records = score(histories(e), None, CRITERIA)
    assert records.t_conv[0, 2] == pytest.approx(EPOCH)
    assert records.status[0] == "ok"


def test_threshold_is_inclusive():
    assert score(histories(np.full(K, 1e-2)), None, CRITERIA).t_conv[0, 2] < math.inf
    assert score(histories(np.full(K, np.nextafter(1e-2, 1))), None, CRITERIA).t_conv[0, 2] == math.inf


def test_aligned_needs_every_axis():
    phi = histories(np.zeros(K))
    phi[0, :, 0] = 2e-3
    records = score(phi, None, CRITERIA)
    assert records.aligned_s[0] == math.inf
    (summary,) = metrics.summaries([records])
    assert summary.success == 0
    assert summary.success_by_axis == {"E": 0.0, "N": 1.0, "U": 1.0}


def test_steady_state_is_the_last_minute_or_fifth():
    for num_epochs, coarse, expected in ((1000, 200, 60.0), (1000, 600, 40.0), (4000, 0, 80.0)):
        c = dataclasses.replace(CRITERIA, num_epochs=num_epochs, coarse_epochs=coarse)
        assert (num_epochs - c.steady_from + 1) * EPOCH == pytest.approx(expected)
    phi = np.full((1, K, 3), 9.0)
    phi[0, -600:] = 0.3 + 0.04 * np.where(np.arange(600) % 2, 1, -1)[:, None]
    records = score(phi, None, CRITERIA)
    np.testing.assert_allclose(records.steady_mean, 0.3, rtol=1e-12)
    np.testing.assert_allclose(records.steady_std, 0.04, rtol=1e-12)
    np.testing.assert_allclose(records.steady_rms, math.hypot(0.3, 0.04), rtol=1e-12)


def test_blocks_equal_the_whole():
    rng = np.random.default_rng(1)
    phi = rng.normal(0, [1e-3, 1e-3, 8e-3], (6, K, 3)) * np.exp(-t / 30)[:, None]
    phi[5, 600] = 2.0
    failed = rng.random((6, K)) < 1e-3
    whole = score(phi, failed, CRITERIA)
    scorer = Scorer(CRITERIA, 6)
    for a in range(0, K, 70):
        scorer.add(phi[:, a : a + 70], failed[:, a : a + 70])
    parts = scorer.records(range(6))
    for field in dataclasses.fields(Records):
        one, other = getattr(whole, field.name), getattr(parts, field.name)
        if field.name.startswith("steady"):
            np.testing.assert_allclose(one, other, rtol=1e-12)
        elif isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
        else:
            assert one == other


def test_history_is_one_hertz_and_bounded():
    records = score(histories(t), None, CRITERIA)
    np.testing.assert_allclose(records.history[0, :, 2], np.arange(1.0, T + 1), rtol=1e-6)
    day = dataclasses.replace(CRITERIA, num_epochs=30 * 864_000)
    assert len(day.history_t) <= MAX_HISTORY
    assert len(dataclasses.replace(CRITERIA, num_epochs=216_000).history_t) == MAX_HISTORY


def test_divergence():
    e = np.zeros((3, K))
    e[0, 499] = -1.51
    e[1, 499] = 1.49
    failed = np.zeros((3, K), dtype=bool)
    failed[2, 5] = True
    records = score(histories(*e), failed, CRITERIA)
    assert list(records.status) == ["diverged", "ok", "diverged"]
    assert records.reason[0] == "azimuth error beyond 85.9 deg at 50.0 s"
    assert records.reason[2] == "non-finite or zero action at 0.6 s"
    assert metrics.failure_counts(records) == {
        "diverged": 2, "frozen": 0, "raised": 0, "lost": 0, "repaired": 0, "any": 2,
    }  # fmt: skip


def test_a_heading_that_may_be_anything_is_judged_in_the_steady_state():
    """The start may be 180 deg off; level errors and a lost heading at the end still count."""
    lost = dataclasses.replace(CRITERIA, lost_heading=True)
    e = np.zeros((4, K, 3))
    e[0, :400, 2] = 3.0
    e[1, :, 2] = 3.0
    e[2, CRITERIA.coarse_epochs + 50, 0] = 0.6
    e[3, CRITERIA.steady_from - 1, 2] = 1.6
    assert list(score(e, None, lost).status) == ["ok", "diverged", "diverged", "diverged"]
    assert list(score(e, None, CRITERIA).status) == ["diverged"] * 4


def test_an_attitude_unknown_in_motion_is_judged_in_the_steady_state():
    """What is lost at the end still counts, and all counts after a coarse phase."""
    moving = dataclasses.replace(CRITERIA, known_start=False, navigates=True, coarse_epochs=0, limit=np.full(9, 0.5))
    e = np.zeros((2, K, 12))
    e[0, :400, :9] = 3.0
    e[1, moving.steady_from - 1, 1] = 0.6
    assert list(score(e, None, moving).status) == ["ok", "diverged"]
    assert list(score(e, None, dataclasses.replace(moving, coarse_epochs=100)).status) == ["diverged"] * 2


def test_the_limits_follow_from_what_is_told():
    for kwargs, limit, lost in (({}, (10, 10, 150), False), ({"any_heading": True}, (10, 10, 90), True)):
        task = dataclasses.replace(get_task("sway-white-v0"), kwargs={"duration": 100.0, **kwargs})
        env = task.make(1)
        env.reset(seed=0)
        criteria = Criteria.of(task, env.unwrapped.task)
        np.testing.assert_allclose(np.degrees(criteria.limit), limit)
        assert criteria.lost_heading is lost


def test_a_run_that_ends_early_has_the_worst_errors_and_no_history():
    scorer = Scorer(CRITERIA, 1)
    scorer.add(np.zeros((1, 900, 3)), np.zeros((1, 900), dtype=bool))
    with pytest.raises(ValueError, match="900 epochs"):
        scorer.records([0])
    scorer.fill()
    records = scorer.records([0])
    assert records.t_conv[0, 2] == math.inf
    np.testing.assert_allclose(records.final[0], [math.pi / 2, math.pi, math.pi])
    np.testing.assert_allclose(records.steady_rms[0, 2], math.pi * math.sqrt(100 / 600))
    assert np.isnan(records.history[0, 90:]).all()
    assert not np.isnan(records.history[0, :90]).any()


def test_median_with_censored_runs():
    assert resampling.median_interval(np.full(9, math.inf)) == (math.inf, (math.inf, math.inf))
    assert resampling.median_interval(np.full(9, 12.0)) == (12.0, (12.0, 12.0))
    assert resampling.median_interval(np.array([5.0])) == (5.0, (5.0, 5.0))
    times = np.array([10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, math.inf, math.inf])
    median, (low, high) = resampling.median_interval(times)
    assert median == 50.0
    # the percentile interval of a median of 9 is from the 2nd or 3rd to the 7th or 8th: exact binomial tails
    assert low in (20.0, 30.0)
    assert high in (70.0, math.inf)
    assert resampling.median_interval(np.array([1.0, math.inf]))[0] == math.inf


def test_restricted_mean():
    assert metrics.restricted_mean(np.array([10.0, 20.0, math.inf]), 50.0) == pytest.approx(80 / 3)
    assert CRITERIA.horizon_s == pytest.approx(50.0)


def test_profile_passes_through_the_success_rate():
    rng = np.random.default_rng(2)
    phi = rng.normal(0, 1, (200, 1, 3)) * np.array([1e-3, 1e-3, 8e-3]) * np.ones((1, K, 1))
    records = score(phi, None, CRITERIA)
    deltas, azimuth, _, _ = metrics.success_profile(records, points=400)
    at = np.searchsorted(deltas, CRITERIA.delta[2])
    success = metrics.summaries([records])[0].success_by_axis["U"]
    assert azimuth[at - 1] <= success <= azimuth[at]
    assert 0 < success < 1
    expected = np.array([(np.abs(phi[:, 0, 2]) <= delta).mean() for delta in deltas])
    np.testing.assert_array_equal(azimuth, expected)
    assert np.all(np.diff(azimuth) >= 0)


def test_rms_interval_degenerate():
    assert resampling.rms_interval(np.array([3.0]))[0] == 3.0
    assert all(math.isnan(end) for end in resampling.rms_interval(np.array([3.0]))[1])
    assert resampling.rms_interval(np.full(5, 2.0)) == (2.0, (2.0, 2.0))
    value, (low, high) = resampling.rms_interval(np.array([3.0, 4.0]))
    assert value == pytest.approx(math.sqrt(12.5))
    assert 3.0 - 1e-9 <= low <= value <= high <= 4.0 + 1e-9


def test_bca_interval_covers():
    """Normal errors of sigma 2: the interval holds 2 in 95 % of trials; BCa at 60 runs in about 94 %."""
    rng = np.random.default_rng(3)
    trials = 1000
    found = resampling.rms_intervals(np.abs(rng.normal(0, 2.0, (60, trials))))
    inside = sum(low <= 2.0 <= high for _, (low, high) in found)
    standard_error = math.sqrt(0.94 * 0.06 / trials)
    assert abs(inside / trials - 0.94) < 3 * standard_error


def test_nees_against_a_dense_inverse():
    rng = np.random.default_rng(4)
    A = rng.normal(size=(500, 3, 3))
    P = A @ np.swapaxes(A, -1, -2) + 0.1 * np.eye(3)
    e = rng.normal(size=(500, 3))
    dense = np.array([x @ np.linalg.inv(C) @ x for x, C in zip(e, P, strict=True)])
    np.testing.assert_allclose(errors.nees(e, P), dense, rtol=1e-9)
    bad = np.stack([np.zeros((3, 3)), -np.eye(3), np.full((3, 3), np.nan), np.eye(3)])
    np.testing.assert_array_equal(errors.nees(np.ones((4, 3)), bad), [np.inf, np.inf, np.inf, 3.0])


def test_nees_band_holds_95_percent():
    assert consistency.nees_band(1) == pytest.approx((0.2158, 9.3484), abs=1e-4)  # from printed tables
    rng = np.random.default_rng(5)
    trials, runs = 2000, 40
    low, high = consistency.nees_band(runs)
    mean = rng.chisquare(3, (trials, runs)).mean(axis=1)
    inside = ((low <= mean) & (mean <= high)).mean()
    assert abs(inside - 0.95) < 3 * math.sqrt(0.95 * 0.05 / trials)


def test_consistency_counts_what_is_known():
    records = score(histories(*np.zeros((3, K))), None, CRITERIA)
    assert consistency.consistency(CRITERIA, records.nees) == ()
    nees = np.array([[1.0, 2.0, 3.0, 4.0], [3.0, 2.0, 1.0, 6.0], [np.nan] * 4])
    found = consistency.consistency(CRITERIA, nees)
    assert [one.mean for one in found] == [2.0, 2.0, 2.0, 5.0]
    assert [one.t_s for one in found] == pytest.approx([40.0, 60.0, 80.0, 100.0])
    assert found[0].runs == 2
    assert found[0].inside
    assert not consistency.consistency(CRITERIA, np.full((3, 4), np.inf))[-1].inside


def test_heading_spread_across_north():
    degrees = np.array([359.0, 1.0, 0.0, 2.0, 358.0])
    assert math.degrees(metrics.heading_spread(np.radians(degrees))) == pytest.approx(math.sqrt(2.5))
    opposite = np.radians([359.0, 1.0])  # whose plain mean is south
    assert math.degrees(metrics.heading_spread(opposite)) == pytest.approx(math.sqrt(2.0))
    assert math.isnan(metrics.heading_spread(np.array([1.0, np.nan])))


def test_summary_in_arcsec():
    phi = np.ones((4, K, 3)) * ARCSEC * np.array([10.0, 20.0, 30.0])
    (s,) = metrics.summaries([score(phi * np.array([1, -1, 1, -1])[:, None, None], None, CRITERIA)])
    assert s.rms == pytest.approx({"E": 10.0, "N": 20.0, "U": 30.0})
    assert s.rms_final == pytest.approx({"E": 10.0, "N": 20.0, "U": 30.0})
    assert s.mean == pytest.approx({"E": 0.0, "N": 0.0, "U": 0.0}, abs=1e-9)
    assert s.t_conv_from_switch_on_s == pytest.approx(EPOCH + COARSE * EPOCH)
    assert s.failures == 0


def test_rms_band():
    rng = np.random.default_rng(6)
    history = rng.normal(0, 3.0, (400, 50)).astype(np.float32)
    value, low, high = metrics.rms_band(history)
    np.testing.assert_allclose(value, np.sqrt((history.astype(float) ** 2).mean(axis=0)))
    # an RMS of 400 normal values has a standard error of sigma / sqrt(800); the band is +-1.96 of them
    np.testing.assert_allclose((high - low).mean(), 2 * 1.96 * 3.0 / math.sqrt(800), rtol=0.1)
    history[:, 10:] = np.nan
    history[0, :] = 1.0
    assert np.isfinite(metrics.rms_band(history)[2]).all()


def test_rows_sorted_and_joined():
    records = score(histories(*np.zeros((4, K))), None, CRITERIA)
    parts = [Records.of_rows(CRITERIA, [records.row(i) for i in some]) for some in ((3, 1), (2, 0))]
    joined = Records.concat(parts)
    np.testing.assert_array_equal(joined.run, [0, 1, 2, 3])
    assert joined.t_conv.shape == (4, 3)
