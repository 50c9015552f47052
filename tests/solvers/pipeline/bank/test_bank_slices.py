"""Slices: sums by runs, a view from another INS and the reset against the group and Monte Carlo, mergers against moments."""

import numpy as np
import pytest
from oracles.problems import spd
from scipy.linalg import expm

from sins_env import attitude, earth
from sins_env.types import NavState
from solvers.pipeline.bank import slices
from solvers.pipeline.bank.slices import Frame, Slices
from solvers.pipeline.errors.invariant import Invariant
from solvers.pipeline.errors.model import ACCEL_UNIT, GYRO_UNIT, Parameter
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.strapdown import StrapdownState
from solvers.types import Gaussian

MODEL, SITE = earth.get("wgs84"), np.array([0.6, 1.9, 300.0])
ERRORS = NavigationErrors(True, parameters=(Parameter("fix_offset", 3, "m/s", std=0.0),))
FRAME = Frame(MODEL, Invariant(MODEL, SITE, ERRORS.states), ERRORS, own=15)
SIZES = np.repeat([0.02, 0.3, 2.0, 1.0, 1.0, 0.1], 3)
n = 18


def made(rng, run, models=2, spread=1.0):
    """Slices of these runs, with inertial solutions that are ``spread`` times SIZES apart."""
    N = len(run)
    q = attitude.from_rotvec(spread * SIZES[0] * rng.standard_normal((N, 3)))
    pos = earth.displace(MODEL, SITE, spread * 2.0 * rng.standard_normal((N, 3)))
    nav = NavState(attitude.normalize(q), 30.0 + spread * 0.3 * rng.standard_normal((N, 3)), pos)
    bias = spread * np.repeat([GYRO_UNIT, ACCEL_UNIT], 3) * rng.standard_normal((N, 6))
    weight = rng.random((N, models))
    total = slices.sum_by_run(weight.sum(axis=1), np.array(run), max(run) + 1)
    cov = spd(rng, N, models, n) * np.outer(SIZES, SIZES) / n
    mean = 0.3 * SIZES * rng.standard_normal((N, models, n))
    regimes = rng.dirichlet(np.ones(3), (N, models))
    return Slices(np.array(run), StrapdownState(nav, None), bias, weight / total[run][:, None], mean, cov, regimes)


def element(nav):
    X = np.eye(5)
    X[:3, :3], X[:3, 3], X[:3, 4] = attitude.to_dcm(nav.q_nb), nav.vel, earth.offset(MODEL, SITE, nav.pos)
    return X


def group(xi):
    Xi = np.zeros((5, 5))
    Xi[:3, :3], Xi[:3, 3], Xi[:3, 4] = -attitude.skew(xi[:3]), xi[3:6], xi[6:9]
    return expm(Xi)


def one(s, i):
    return NavState(*(part[i] for part in s.ins.nav))


def test_a_slice_seen_from_another_is_the_same_true_state():
    """Exp(d + K xi) X is X_b, where Exp(xi) X is X_j, for small xi; and both have the same biases."""
    s = made(np.random.default_rng(5), [0, 0, 0, 1, 2, 2], spread=10.0)
    view = FRAME.view(s, 3)
    np.testing.assert_array_equal(
        view.top, [s.weight[:3].sum(axis=1).argmax(), 3, 4 + s.weight[4:].sum(axis=1).argmax()]
    )
    for j, b in enumerate(view.top[s.run]):
        xi = 1e-4 * SIZES
        truth = np.linalg.inv(group(xi)) @ element(one(s, j))
        seen = view.d[j] + view.K[j] @ xi
        np.testing.assert_allclose(group(seen) @ truth, element(one(s, b)), atol=1e-4)  # metres on an ellipsoid
        units = np.repeat([GYRO_UNIT, ACCEL_UNIT], 3)
        np.testing.assert_allclose(s.bias[b] + units * seen[9:15], s.bias[j] + units * xi[9:15], rtol=1e-12, atol=1e-16)
        np.testing.assert_allclose(seen[15:], xi[15:])
        if j == b:
            np.testing.assert_array_equal(view.d[j], 0.0)
            np.testing.assert_array_equal(view.K[j], np.eye(n))


def test_one_slice_in_each_run_is_seen_as_it_is():
    """And so is the best slice beside others, bit for bit."""
    rng = np.random.default_rng(11)
    s = made(rng, [0, 1, 1, 2])
    s.weight[2] *= 1e-3
    alone = s.take(np.array([0, 1, 3]))
    view, own = FRAME.view(s, 3), FRAME.view(alone, 3)
    assert own.d is None
    for found, expected in zip(view.seen(s), alone.x, strict=True):
        np.testing.assert_array_equal(found[[0, 1, 3]], expected)
    np.testing.assert_array_equal(FRAME.mean(s, view, 3)[[0, 2]], FRAME.mean(alone, own, 3)[[0, 2]])


def test_reset_against_monte_carlo():
    """Draws of xi go through log(Exp(-m) Exp(xi)); mean and covariance are those of the reset, within 5 standard errors."""
    rng = np.random.default_rng(6)
    s = made(rng, [0], models=2)
    s = s._replace(mean=s.mean * 30.0, cov=s.cov * 1e-4)  # a mean of half a radian
    after = FRAME.reset(s)
    m = slices.conditional_mean(s.weight, s.mean)
    np.testing.assert_allclose(slices.conditional_mean(after.weight, after.mean)[:, :15], 0.0, atol=1e-13)
    np.testing.assert_array_equal(after.mean[..., 15:], s.mean[..., 15:])
    left = np.linalg.inv(group(m[0])) @ element(one(s, 0))
    np.testing.assert_allclose(element(one(after, 0)), left, rtol=2e-5, atol=2e-3)  # metres on an ellipsoid
    units = np.repeat([GYRO_UNIT, ACCEL_UNIT], 3)
    np.testing.assert_allclose(after.bias, s.bias + units * m[:, 9:15])
    draws = 4000
    s0 = s._replace(mean=np.repeat(m[:, None], 2, axis=1))  # about the mean, where the reset is exact to second order
    cov = FRAME.reset(s0).cov[0, 0]
    e = rng.multivariate_normal(np.zeros(n), s.cov[0, 0], draws)
    chart = FRAME.coordinates.at(NavState(*(np.repeat(part, draws, axis=0) for part in s.ins.nav)))
    x = chart.errors(m + e)
    nav = FRAME.errors.corrected(MODEL, NavState(*(np.repeat(part, draws, axis=0) for part in s.ins.nav)), x)
    here = NavState(*(np.repeat(part, draws, axis=0) for part in after.ins.nav))
    rest = np.zeros((draws, n))
    rest[:, :3] = attitude.misalignment(here.q_nb, nav.q_nb)
    rest[:, 3:6], rest[:, 6:9] = here.vel - nav.vel, -earth.offset(MODEL, here.pos, nav.pos)
    rest[:, 9:] = (e + m)[:, 9:] - np.concatenate([m[:, 9:15], np.zeros((1, 3))], axis=1)
    left = FRAME.coordinates.at(here).invariant(rest)
    sigma = np.sqrt(np.diag(cov))
    found = np.cov(left.T) / np.outer(sigma, sigma)
    np.testing.assert_allclose(found, cov / np.outer(sigma, sigma), atol=5 * np.sqrt(2 / draws))


def test_the_estimate_is_the_mixture_of_all_slices():
    """With one INS for all slices of a run it is the plain mixture, model by model."""
    rng = np.random.default_rng(7)
    run = [0, 0, 1, 1, 1]
    s = made(rng, run, spread=0.0)
    view = FRAME.view(s, 2)
    found = FRAME.gaussian(s, view, 2)
    np.testing.assert_allclose(FRAME.mean(s, view, 2), found.mean, atol=1e-14)
    for k in range(2):
        here = s.run == k
        w, x, P = s.weight[here].ravel(), s.mean[here].reshape(-1, n), s.cov[here].reshape(-1, n, n)
        mean = w @ x
        cov = sum(a * (C + np.outer(m - mean, m - mean)) for a, m, C in zip(w, x, P, strict=True))
        np.testing.assert_allclose(found.mean[k], mean, atol=1e-13)
        np.testing.assert_allclose(found.cov[k], cov, atol=1e-13)


def test_slices_that_agree_are_merged_with_the_moments_of_their_mixture():
    rng = np.random.default_rng(8)
    s = made(rng, [0, 0, 0, 0, 1], spread=0.0)
    s.mean[...] *= 0.1
    s.mean[2] += 5.0 * SIZES  # disagrees
    s.weight[3] = 1e-10  # counts for nothing
    s.weight[0] += 1.0
    s = s._replace(weight=s.weight / slices.sum_by_run(s.weight.sum(axis=1), s.run, 2)[s.run][:, None])
    after = FRAME.tidy(s, 2)
    np.testing.assert_array_equal(after.run, [0, 0, 1])
    kept = s.weight[:3].sum()
    for model in range(2):
        w = s.weight[:2, model]
        share = w / w.sum()
        mean = share @ s.mean[:2, model]
        apart = s.mean[:2, model] - mean
        cov = np.einsum("j,jab->ab", share, s.cov[:2, model] + apart[:, :, None] * apart[:, None, :])
        np.testing.assert_allclose(after.weight[0, model], w.sum() / kept)
        np.testing.assert_allclose(after.mean[0, model], mean, atol=1e-14)
        np.testing.assert_allclose(after.cov[0, model], cov, atol=1e-14)
        np.testing.assert_allclose(after.regimes[0, model], share @ s.regimes[:2, model])
    np.testing.assert_allclose(after.weight[1], s.weight[2] / kept)
    for part, whole in zip(after.take(np.array([2])), s.take(np.array([4])), strict=True):
        np.testing.assert_equal(part, whole)  # the other run keeps its bits


@pytest.mark.parametrize("runs", [1, 4])
def test_weights_of_each_run(runs):
    rng = np.random.default_rng(9)
    run = np.sort(np.append(np.arange(runs), rng.integers(0, runs, 10)))
    logs = 500.0 * rng.standard_normal((len(run), 3))
    weight = slices.normalised(logs, run, runs)
    for k in range(runs):
        ratio = logs[run == k] - logs[run == k].max()
        expected = np.exp(ratio) / np.exp(ratio).sum()
        np.testing.assert_allclose(weight[run == k], expected, atol=1e-15)
        assert slices.best(weight, run, runs)[k] == np.flatnonzero(run == k)[weight[run == k].sum(axis=1).argmax()]
    assert slices.best(weight[:1], run[:1], runs + 1)[runs] == -1


def test_runs_join_in_their_order():
    rng = np.random.default_rng(10)
    a, b = made(rng, [0, 0, 3]), made(rng, [1, 2, 2])
    together = slices.join(a, b)
    np.testing.assert_array_equal(together.run, [0, 0, 1, 2, 2, 3])
    np.testing.assert_array_equal(together.mean[[0, 1, 5]], a.mean)
    np.testing.assert_array_equal(together.ins.nav.vel[2:5], b.ins.nav.vel)
    assert together.ins.last is None
    np.testing.assert_array_equal(together.put(np.array([2]), b.take(np.array([1]))).cov[2], b.cov[1])
    assert isinstance(together.x, Gaussian)
