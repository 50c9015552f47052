"""The bank of extended Kalman filters: its slices, the angle it finds, and Bayes' rule on a grid."""

import math

import numpy as np
import pytest
from oracles.problems import spd, swing

import solvers
from sins_env import attitude
from sins_env.evaluation import get_task
from solvers.blocks.mixtures import collapse
from solvers.filters import make_filter
from solvers.filters.mixtures.angles import least_known_angle, slices
from solvers.filters.mixtures.gsf_ekf import Bank
from solvers.pipeline.feedback import reset_maps
from solvers.types import Gaussian, Linear, Measurement, Transition

DEG = math.pi / 180.0
TURN = 2.0 * math.pi


def turning(x):
    """(..., 3): an angle and two states that feel it; the angle is the SECOND state."""
    y = 0.9 * x
    y[..., 1] = x[..., 1] + 0.02 * np.sin(x[..., 1]) + 0.01 * x[..., 2]
    y[..., 0] += 0.3 * np.cos(x[..., 1])
    y[..., 2] += 0.3 * np.sin(x[..., 1])
    return y


def prior(sigma_deg, batch=()):
    """N(0, P) of the three states, correlated, with this spread of the angle."""
    P = spd(np.random.default_rng(3), 3)
    scale = np.array([0.3, sigma_deg * DEG, 0.2]) / np.sqrt(np.diagonal(P))
    P = P * np.outer(scale, scale)
    return Gaussian(np.zeros((*batch, 3)), np.broadcast_to(P, (*batch, 3, 3)))


@pytest.mark.parametrize(
    ("sigma", "off"), [(6.5, 0.1), (8.0, 0.1), (10.0, 0.1), (15.0, 0.05), (30.0, 0.03), (59.0, 0.03)]
)
def test_slices_are_the_gaussian(sigma, off):
    """Same mean and variance, no slice wider than asked, and the density off by no more than ``off`` of its peak."""
    offset, weight, variance = slices(np.array((sigma * DEG) ** 2), 12.0 * DEG, 100)
    assert weight.sum() == pytest.approx(1.0)
    assert weight @ offset == pytest.approx(0.0, abs=1e-14)
    assert weight @ offset**2 + variance == pytest.approx((sigma * DEG) ** 2)
    assert math.sqrt(variance) <= 6.0001 * DEG
    assert np.diff(offset).max() < 12.3 * DEG
    x = np.linspace(-4.0, 4.0, 2001) * sigma * DEG
    sum_of = (weight * np.exp(-0.5 * (x[:, None] - offset) ** 2 / variance)).sum(axis=1) / math.sqrt(variance)
    peak = 1.0 / (sigma * DEG)
    assert np.abs(sum_of - np.exp(-0.5 * (x / (sigma * DEG)) ** 2) * peak).max() < off * peak


@pytest.mark.parametrize("sigma", [61.0, 180.0 / math.sqrt(3.0), 400.0])
def test_a_broad_gaussian_is_wound_around_the_circle(sigma):
    offset, weight, variance = slices(np.array((sigma * DEG) ** 2), 12.0 * DEG, 100)
    np.testing.assert_allclose(offset / DEG, np.arange(-174.0, 175.0, 12.0))
    assert math.sqrt(variance) == pytest.approx(6.0 * DEG)
    x = np.linspace(-math.pi, math.pi, 721)

    def wound(centre, var):
        turns = TURN * np.arange(-8, 9)
        return np.exp(-0.5 * (x[:, None] - centre + turns) ** 2 / var).sum(axis=1) / math.sqrt(var)

    density = sum(w * wound(m, variance) for w, m in zip(weight, offset, strict=True))
    exact = wound(0.0, (sigma * DEG) ** 2)
    # three turns are wound up; more only where the density is flat, to 10 %, anyway
    assert np.abs(density / exact - 1.0).max() < (0.05 if sigma < 150.0 else 0.1)


def test_few_slices_are_wider_ones_and_runs_differ():
    offset, weight, variance = slices(np.array([0.0, 4.0, 30.0, 104.0]) ** 2 * DEG**2, 12.0 * DEG, 8)
    assert offset.shape == weight.shape == (4, 8)
    np.testing.assert_array_equal((weight > 0.0).sum(axis=-1), [1, 1, 8, 8])
    np.testing.assert_allclose(variance[:2], np.array([0.0, 16.0]) * DEG**2)
    np.testing.assert_allclose(np.diff(offset[3]) / DEG, 45.0)
    three = slices(np.array(900.0) * DEG**2, 12.0 * DEG, 3)
    assert three[1] @ three[0] ** 2 + three[2] == pytest.approx(900.0 * DEG**2)
    alone = slices(np.array(900.0) * DEG**2, 12.0 * DEG, 8)
    np.testing.assert_allclose(offset[2], alone[0])


def test_the_angle_is_found_by_what_f_does():
    x, P = np.array([0.1, 0.2, -0.1]), np.diag([9.0, 1.0, 9.0])
    assert least_known_angle(turning, x, P) == 1
    assert least_known_angle(swing, x, P) == -1  # nonlinear without a period
    assert least_known_angle(lambda x: x @ np.diag([1.0, 1.0, 1.0]), x, P) == -1
    assert least_known_angle(lambda x: x + 1e-9 * x[..., :1], x, P) == -1  # nearly constant is no angle
    assert least_known_angle(Linear(np.eye(3)), x, P) == -1

    def two(x):
        return x + np.stack([np.sin(x[..., 1]), np.cos(x[..., 0]), 0.0 * x[..., 2]], axis=-1)

    def principal(x):  # as of a rotation vector
        y = turning(x)
        y[..., 1] = attitude.wrap(y[..., 1])
        return y

    assert least_known_angle(principal, x, P) == 1

    both = np.stack([np.diag([1.0, 4.0, 9.0]), np.diag([4.0, 1.0, 9.0]), np.zeros((3, 3))])
    np.testing.assert_array_equal(least_known_angle(two, np.zeros((3, 3)), both), [1, 0, -1])


@pytest.mark.parametrize("sigma", [2.0, 15.0, 40.0])
def test_the_cut_keeps_mean_and_covariance(sigma):
    x = prior(sigma, (2,))
    flt = make_filter("gsf_ekf")
    b = flt.cut(flt.init(x), turning)
    again = collapse(b.weights, Gaussian(b.mean, b.cov))
    np.testing.assert_allclose(again.mean, x.mean, atol=1e-15)
    np.testing.assert_allclose(again.cov, x.cov, atol=1e-13)
    np.testing.assert_array_equal(b.axis, -1 if sigma == 2.0 else 1)
    assert np.linalg.eigvalsh(b.cov).min() > 0.0
    if sigma == 40.0:
        slope = x.cov[0][:, 1] / x.cov[0][1, 1]
        step = b.mean[0, 1:] - b.mean[0, :-1]
        np.testing.assert_allclose(step, np.outer(step[:, 1], slope), atol=1e-14)


def test_an_angle_may_be_named():
    narrow = Gaussian(np.zeros(3), np.diag([1.0, 1.0, 0.01]))
    b = make_filter("gsf_ekf", axis=2).cut(make_filter("gsf_ekf").init(narrow), Linear(np.eye(3)))
    assert b.axis == -1  # known to 6 degrees: one slice
    wide = Gaussian(np.zeros(3), np.eye(3))
    b = make_filter("gsf_ekf", axis=2).cut(make_filter("gsf_ekf").init(wide), Linear(np.eye(3)))
    assert b.axis == 2
    assert (np.ptp(b.mean, axis=0) > 0.0).tolist() == [False, False, True]


def on_a_grid(sigma, sight, z, f, R):
    """Bayes' rule for one angle that f moves without noise: weighted points (points,) after each measurement."""
    x = np.linspace(-math.pi, math.pi, 20001)[:-1]
    log_p = np.log(sum(np.exp(-0.5 * ((x + TURN * k) / sigma) ** 2) for k in range(-4, 5)))
    for z_k in z:
        x = f(x[:, None])[:, 0]
        log_p = log_p - 0.5 * np.square(z_k - sight(x[:, None])).sum(axis=-1) / R
        p = np.exp(log_p - log_p.max())
        yield x, p / p.sum()


@pytest.mark.parametrize("truth_deg", [5.0, -70.0, 120.0, 178.0])
def test_it_is_bayes_rule_on_the_circle(truth_deg):
    """Against a grid of 20,000 points: circular mean and spread, from nothing known to a few degrees."""

    def f(x):
        return x + 0.05 * np.sin(x)

    def sight(x):
        return np.concatenate([np.cos(x), np.sin(x)], axis=-1)

    rng, R, sigma = np.random.default_rng(8), 0.5**2, 180.0 * DEG / math.sqrt(3.0)
    x, z = np.array([truth_deg * DEG]), []
    for _ in range(61):
        x = f(x)
        z.append(sight(x) + math.sqrt(R) * rng.standard_normal(2))
    flt, ekf = make_filter("gsf_ekf"), make_filter("ekf")
    b, e = (each.init(Gaussian(np.zeros(1), np.array([[sigma**2]]))) for each in (flt, ekf))
    worst = 0.0
    for k, (points, p) in enumerate(on_a_grid(sigma, sight, z, f, R)):
        tr, me = Transition(f, np.zeros((1, 1))), Measurement(z[k], sight, R * np.eye(2))
        (b, _), (e, _) = flt.step(b, tr, me), ekf.step(e, tr, me)
        mean = np.angle((p * np.exp(1j * points)).sum())
        spread = math.sqrt((p * attitude.wrap(points - mean) ** 2).sum())
        got, P = flt.estimate(b)
        assert abs(attitude.wrap(got[0] - mean)) < 0.15 * spread
        assert math.sqrt(P[0, 0]) == pytest.approx(spread, rel=0.12)
        worst = max(worst, abs(attitude.wrap(e.mean[0] - mean)) / spread)
    assert spread < 8.0 * DEG
    assert worst > 0.5
    assert b.weights.shape[0] < 15


def two_modes(**settings):
    weights = np.array([0.6, 0.4])
    mean, cov = np.array([[1.0, 170.0 * DEG, 0.0], [2.0, -170.0 * DEG, 0.0]]), np.stack([0.01 * np.eye(3)] * 2)
    flt = make_filter("gsf_ekf", **settings)
    health = flt.init(Gaussian(np.zeros(3), np.eye(3))).health
    return flt, Bank(weights, mean, cov, health._replace(epoch=5), np.array(1))


def test_modes_across_the_half_turn_are_neighbours():
    flt, b = two_modes()
    x = flt.estimate(b)
    np.testing.assert_allclose(x.mean, [1.4, 178.0 * DEG, 0.0])
    d = np.array([1.0, 20.0 * DEG, 0.0])
    np.testing.assert_allclose(x.cov, 0.01 * np.eye(3) + 0.24 * np.outer(d, d), atol=1e-15)
    best = two_modes(estimate_by="best")[0].estimate(b)
    np.testing.assert_allclose(best.mean, b.mean[0])
    np.testing.assert_allclose(best.cov, b.cov[0])


def test_like_slices_are_merged_and_hopeless_ones_dropped():
    health = make_filter("gsf_ekf").init(Gaussian(np.zeros((2, 1)), np.eye(1))).health._replace(epoch=5)
    weights = np.array([[0.5, 0.2, 1e-9, 0.3 - 1e-9], [0.1, 0.2, 0.6, 0.1]])
    mean = np.array([[3.0, 3.0 + TURN, 3.0, 0.0], [0.0, 2.0, 4.0, -2.0]])[..., None]
    cov = np.full((2, 4, 1, 1), 0.25)
    flt = make_filter("gsf_ekf", merge_within=0.5)
    b = Bank(weights, mean, cov, health, np.zeros(2, dtype=int))
    tidy = flt.tidy(b)
    np.testing.assert_allclose(tidy.weights, [[0.7, 0.3, 0.0, 0.0], [0.1, 0.2, 0.6, 0.1]], atol=1e-8)
    np.testing.assert_allclose(tidy.mean[0, :, 0], [3.0, 0.0, 3.0, 3.0], atol=1e-12)
    np.testing.assert_array_equal(tidy.mean[1], mean[1])
    one = flt.tidy(Bank(*(part[:1] for part in b[:3]), health._replace(failed_at=np.array([-1])), np.zeros(1, int)))
    assert one.weights.shape == (1, 2)
    for before, after in zip(flt.estimate(b), flt.estimate(tidy), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-7)  # merging keeps the moments, dropping 1e-9 of them
    frozen = flt.tidy(b._replace(health=health._replace(failed_at=np.array([3, -1]))))
    np.testing.assert_array_equal(frozen.weights[0], weights[0])
    np.testing.assert_array_equal(frozen.mean[0], mean[0])


def play(flt, x, z, at=None):
    b = flt.init(x)
    history = []
    for z_k in z:
        b, innovation = flt.step(b, Transition(turning, 1e-4 * np.eye(3)), Measurement(z_k, Linear(H), 0.5 * np.eye(2)))
        history.append((flt.estimate(b), innovation, b))
    return history


H = np.eye(3)[[0, 2]]


def test_every_run_of_a_batch_is_the_run_alone():
    """Runs that need 1, 9 and 30 slices, and one that is lost on the way, which goes on showing what it knew."""
    rng = np.random.default_rng(1)
    each = [prior(sigma) for sigma in (3.0, 15.0, 104.0, 40.0)]
    x = Gaussian(np.stack([p.mean for p in each]), np.stack([p.cov for p in each]))
    z = rng.standard_normal((60, 4, 2)) + np.array([1.0, 2.0])
    z[20, 3] = np.inf
    flt = make_filter("gsf_ekf")
    whole = play(flt, x, z)
    assert whole[0][2].weights.shape == (4, 30)
    for i in range(4):
        alone = play(flt, each[i], z[:, i])
        for (a, inn_a, _), (b, inn_b, belief) in zip(alone, whole, strict=True):
            for one, many in zip((*a, *inn_a), (*b, *inn_b), strict=True):
                np.testing.assert_array_equal(many[i], one)
            assert belief.weights.shape[-1] >= int((belief.weights[i] > 0.0).sum())
        if i == 3:
            np.testing.assert_array_equal(whole[19][0].mean[3], whole[-1][0].mean[3])
            np.testing.assert_array_equal(whole[19][0].cov[3], whole[-1][0].cov[3])
    np.testing.assert_array_equal(whole[-1][2].health.failed_at, [-1, -1, -1, 21])
    assert whole[-1][2].weights.shape[-1] < 30


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_a_reset_moves_every_slice(batch):
    """The alignment's own reset: each slice keeps its attitude, though it is far from the one fed back."""
    rng = np.random.default_rng(2)
    n, G, phi = 10, 6, slice(2, 5)
    mean = 0.02 * rng.standard_normal((*batch, G, n))
    mean[..., 4] = np.linspace(-3.0, 3.0, G)
    flt = make_filter("gsf_ekf")
    start = flt.init(Gaussian(np.zeros((*batch, n)), np.eye(n)))
    b = Bank(np.full((*batch, G), 1.0 / G), mean, spd(rng, *batch, G, n), start.health, np.full(batch, 4))
    x_hat = flt.estimate(b).mean
    g, jac = reset_maps(x_hat, phi, fed=slice(0, 2))
    after = flt.relocate(b, g, jac)
    C, C_hat = attitude.misalignment_dcm(mean[..., phi]), attitude.misalignment_dcm(x_hat[..., phi])
    left = attitude.misalignment_dcm(after.mean[..., phi])
    np.testing.assert_allclose(left, C_hat[..., None, :, :].mT @ C, atol=1e-12)
    np.testing.assert_allclose(after.mean[..., :2], mean[..., :2] - x_hat[..., None, :2], atol=1e-15)
    np.testing.assert_array_equal(after.mean[..., 5:], mean[..., 5:])
    J = jac(mean)
    np.testing.assert_allclose(after.cov, J @ b.cov @ J.mT, atol=1e-12)


def align(name, seconds, **settings):
    """Eight runs of the task with any heading: attitude errors (epochs, 8, 3) in degrees, and the estimator."""
    task = get_task("sway-anyheading-v0")
    env = task.make(8, duration=seconds, epoch=0.2, gps={"rate_hz": 5.0})
    obs, _ = task.reset(env, range(8))
    estimator, errors = solvers.make(name, **settings), []
    estimator.reset(env.unwrapped.task, np.random.default_rng(0), 8)
    for _ in range(round(seconds / 0.2) - 1):
        obs, _, _, _, info = env.step(estimator.step(obs))
        errors.append(info["errors"]["phi"] / DEG)
    return np.array(errors), estimator


def test_it_finds_a_heading_that_nobody_told():
    """All within 3 deg after two minutes, where an EKF alone has lost some; the bank is down to a few by then."""
    errors, estimator = align("gsf_ekf", 120.0)
    assert np.abs(errors[0, :, 2]).max() > 90.0
    assert np.abs(errors[-1, :, 2]).max() < 3.0
    assert np.abs(errors[-1, :, :2]).max() < 0.1
    assert (estimator.health().failed_at == -1).all()
    assert (np.linalg.eigvalsh(estimator.covariance()) > 0.0).all()
    shown = estimator.diagnostics()
    assert shown["components"].max() <= 8
    assert (shown["effective_components"] <= shown["components"] + 1e-12).all()
    assert np.abs(align("ekf", 120.0)[0][-1, :, 2]).max() > 10.0


def test_an_open_and_a_closed_loop_agree():
    """Though a closed one turns every slice by up to half a turn at each fix."""
    opened, closed = (align("gsf_ekf", 40.0, feedback=feedback)[0][-1] for feedback in ("open", "closed"))
    np.testing.assert_allclose(closed, opened, atol=0.5)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"spacing_deg": 0.0}, "spacing_deg = 0.0; allowed: a number > 0 and <= 360"),
        ({"components": 2}, "components = 2; allowed: a whole number >= 3"),
        ({"prune": 0.5}, "prune = 0.5; allowed: a number >= 0 and < 0.01"),
        ({"merge_within": -1.0}, "merge_within = -1.0; allowed: a finite number >= 0"),
        ({"axis": -1}, "axis = -1; allowed: None, or 0, 1, ... below the number"),
        ({"estimate_by": "mode"}, "unknown estimate_by 'mode'; did you mean|unknown estimate_by 'mode'"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        make_filter("gsf_ekf", **settings)
