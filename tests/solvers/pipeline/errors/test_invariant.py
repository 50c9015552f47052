"""Invariant coordinates: exact inverses, the log-linear property, the reset as a product of exponentials, scipy's expm."""

import numpy as np
import pytest
from scipy.linalg import expm, logm

from sins_env import attitude, earth
from sins_env.types import NavState
from solvers.blocks.moments import tangent
from solvers.filters import make_filter
from solvers.pipeline import feedback, strapdown
from solvers.pipeline.aiding.gps import Fix
from solvers.pipeline.errors.group_slopes import right_jacobian
from solvers.pipeline.errors.invariant import Chart, Invariant
from solvers.pipeline.errors.model import Parameter
from solvers.pipeline.errors.navigation import DP, DV, PHI, STATES, WITHOUT_POSITION, NavigationErrors
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Gaussian

RNG = np.random.default_rng(3)
HELD = 20.0 * RNG.standard_normal((4, 2, 3))
MODEL, SITE = earth.get("wgs84"), np.array([0.6, 1.9, 300.0])
SCALE = np.repeat([0.5, 3.0, 30.0, 1.0, 1.0], 3)


def element(C, vel, pos):
    """The matrix (5, 5) of SE_2(3)."""
    X = np.eye(5)
    X[:3, :3], X[:3, 3], X[:3, 4] = C, vel, pos
    return X


def algebra(xi):
    """The matrix of the Lie algebra; the rotation is Exp(-theta x), as C_n^c(phi) is I - phi x."""
    Xi = np.zeros((5, 5))
    Xi[:3, :3], Xi[:3, 3], Xi[:3, 4] = -attitude.skew(xi[:3]), xi[3:6], xi[6:9]
    return Xi


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1.0])
def test_the_coordinates_are_the_logarithm_of_the_right_invariant_error(size):
    """Against scipy's matrix exponential and logarithm of X_hat X^-1."""
    x = size * SCALE * RNG.standard_normal((4, 15))
    xi = Chart(HELD, STATES).invariant(x)
    for row, log, (vel, pos) in zip(x, xi, HELD, strict=True):
        C_hat = attitude.to_dcm(attitude.normalize(RNG.standard_normal(4)))
        C = attitude.misalignment_dcm(row[PHI]).T @ C_hat
        error = element(C_hat, vel, pos) @ np.linalg.inv(element(C, vel - row[DV], pos - row[DP]))
        np.testing.assert_allclose(expm(algebra(log)), error, atol=1e-12 * max(1.0, np.abs(error).max()))
        np.testing.assert_allclose(algebra(log), np.real(logm(error)), atol=1e-10 * max(1.0, np.abs(log).max()))
        np.testing.assert_array_equal(log[9:], row[9:])


@pytest.mark.parametrize("shape", [(4,), (4, 7), (4, 3, 7)])
def test_there_and_back(shape):
    x = SCALE * RNG.standard_normal((*shape, 15))
    chart = Chart(HELD, STATES)
    np.testing.assert_allclose(chart.errors(chart.invariant(x)), x, atol=1e-12)
    one = Chart(HELD[2], STATES).invariant(x[2])
    np.testing.assert_allclose(one, chart.invariant(x)[2], rtol=1e-13, atol=1e-14)
    twelve = np.delete(np.arange(15), DP)
    short = Chart(HELD[:, :1], WITHOUT_POSITION).invariant(x[..., twelve])
    np.testing.assert_array_equal(short, chart.invariant(x)[..., twelve])


def test_half_a_turn_has_coordinates_too():
    for turn in (3.0, np.pi - 1e-6, -3.0):
        x = np.zeros((4, 15))
        x[:, 2], x[:, 3] = turn, 1.0
        chart = Chart(HELD, STATES)
        np.testing.assert_allclose(chart.errors(chart.invariant(x)), x, atol=1e-9)


def test_slope_at_zero():
    chart = Chart(HELD, STATES)
    _, J = tangent(chart.invariant, np.zeros((4, 15)), np.ones((4, 15)))
    np.testing.assert_allclose(chart.slope(), J, atol=1e-5)
    _, back = tangent(chart.errors, np.zeros((4, 15)), np.zeros((4, 15)))
    np.testing.assert_allclose(chart.slope() @ back, np.broadcast_to(np.eye(15), J.shape), atol=1e-7)


@pytest.mark.parametrize("size", [1e-9, 0.02, 1.0])
@pytest.mark.parametrize("shape", [(4,), (4, 3)])
def test_slopes_at_any_errors(size, shape):
    """In closed form, against central differences of the maps; each is the inverse of the other."""
    chart = Chart(HELD, STATES)
    x = size * SCALE * RNG.standard_normal((*shape, 15))
    xi = chart.invariant(x)
    for g, at, slope in ((chart.errors, xi, chart.errors_slope), (chart.invariant, x, chart.invariant_slope)):
        J = slope(xi, x)
        np.testing.assert_allclose(J, differences(g, at, np.full(15, 1e-6)), rtol=1e-7, atol=1e-7 * np.abs(J).max())
    np.testing.assert_allclose(J @ chart.errors_slope(xi, x), np.broadcast_to(np.eye(15), J.shape), atol=1e-11)
    twelve = np.delete(np.arange(15), DP)
    short = Chart(HELD[:, :1], WITHOUT_POSITION).invariant_slope(xi[..., twelve], x[..., twelve])
    np.testing.assert_array_equal(short, J[..., twelve, :][..., twelve])


def flat(C, force, vel, h=0.5):
    """An epoch on a flat earth at rest."""
    zero = np.zeros(3)
    return EpochMotion(h, C, h * force, vel + 0.5 * h * force, zero, zero, np.zeros((3, 3)), np.zeros(()))


@pytest.mark.parametrize("degrees", [1.0, 60.0, 150.0])
def test_large_errors_grow_linearly_and_whatever_the_motion(degrees):
    """The log-linear property (Barrau & Bonnabel 2017, theorem 2): xi' = A xi, the same A in every motion."""
    h, g = 0.5, np.array([0.0, 0.0, -9.8])
    # 1 / R = 1e-30: the earth is flat, and tan L = 0 / 1e-30
    A = np.eye(9)
    A[DV, PHI], A[DP, PHI], A[DP, DV] = -h * attitude.skew(g), -0.5 * h * h * attitude.skew(g), h * np.eye(3)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        C = attitude.to_dcm(attitude.normalize(rng.standard_normal(4)))
        force, vel, pos = 5.0 * rng.standard_normal(3), 50.0 * rng.standard_normal(3), 1e3 * rng.standard_normal(3)
        after = vel + h * (force + g), pos + h * vel + 0.5 * h * h * (force + g)
        motion = flat(C, force, vel)._replace(transport=1e-30 * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0.0]]))
        x = np.concatenate([rng.standard_normal(3), [5, -3, 1, 80, -60, 20.0], np.zeros(6)])
        x[PHI] *= np.radians(degrees) / np.linalg.norm(x[PHI])
        xi = Chart(np.stack([vel, pos]), STATES).invariant(x)
        moved = NavigationErrors().transition(motion, np.zeros((15, 15))).f(x)
        gain = h * earth.FREE_AIR * (x[DP] + 0.5 * h * x[DV])[2]  # gravity would have no gradient on a flat earth
        moved[[5, 8]] -= gain, 0.5 * h * gain
        got = Chart(np.stack(after), STATES).invariant(moved)
        np.testing.assert_allclose(got[:9], A @ xi[:9], rtol=1e-11, atol=1e-9)
    assert (
        np.abs(moved[DV] - (x + h * np.r_[np.zeros(3), np.cross(force, x[PHI]), np.zeros(9)])[DV]).max() > 1e-4
    )  # dv does not


def navs(vel, pos):
    return NavState(np.zeros((*vel.shape[:-1], 4)), vel, pos)


def test_reset_is_the_product_of_exponentials():
    """What remains of xi after the correction by xi_hat is log(Exp(-xi_hat) Exp(xi))."""
    model, site = earth.get("wgs84"), np.array([0.6, 1.9, 300.0])
    xi_hat = SCALE * 0.3 * RNG.standard_normal((4, 15))
    xi = xi_hat + 0.1 * SCALE * RNG.standard_normal((4, 15))
    coordinates = Invariant(model, site, STATES)
    before = navs(HELD[:, 0], earth.displace(model, site, HELD[:, 1]))
    x_hat = coordinates.errors(xi_hat, before)
    after = navs(before.vel - x_hat[:, DV], earth.displace(model, before.pos, -x_hat[:, DP]))
    g, jacobian = coordinates.reset(feedback.reset_maps(x_hat, PHI, slice(3, 15)), before, after)
    for hat, row, left in zip(xi_hat, xi, g(xi), strict=True):
        expected = expm(-algebra(hat)) @ expm(algebra(row))
        np.testing.assert_allclose(expm(algebra(left)), expected, atol=3e-3)  # metres on an ellipsoid over 100 m
        np.testing.assert_allclose(left[9:], row[9:] - hat[9:], atol=1e-12)
    for at in (xi_hat, xi):
        expected = differences(g, at, np.full(15, 5e-7))
        np.testing.assert_allclose(jacobian(at), expected, rtol=1e-4, atol=1e-4)  # metres on an ellipsoid


@pytest.mark.parametrize("size", [1e-6, 1e-3, 0.009, 0.011, 1.0, 3.0])
def test_the_right_jacobian_of_the_group(size):
    """Exp(xi + d) is Exp(xi) Exp(J d), by differences of scipy's exponential."""
    xi = size * SCALE * RNG.standard_normal((4, 15))
    J = right_jacobian(xi, STATES)
    twelve = np.delete(np.arange(15), DP)
    np.testing.assert_array_equal(right_jacobian(xi[:, twelve], WITHOUT_POSITION), J[:, twelve][..., twelve])
    for row, slope in zip(xi, J, strict=True):
        for i in range(9):
            d = 1e-5 * np.eye(15)[i]
            moved = expm(-algebra(row)) @ (expm(algebra(row + d)) - expm(algebra(row - d))) / 2e-5
            np.testing.assert_allclose(algebra(slope[:, i]), moved, atol=1e-7 * max(1.0, np.abs(xi).max()))
        np.testing.assert_array_equal(slope[9:], np.eye(15)[9:])
        np.testing.assert_array_equal(slope[:9, 9:], 0.0)


def differences(g, x, step):
    """The Jacobian of ``g`` at x (..., n) by central differences."""
    columns = [(g(x + one) - g(x - one)) / (2 * one.sum()) for one in np.diag(step)]
    return np.stack(columns, axis=-1)


def epoch(position):
    """States of an INS before and after an epoch of 1 s at high speed, and its motion."""
    ins = strapdown.Strapdown(MODEL, 1.0, 3, SITE, hold_position=not position)
    pos = earth.displace(MODEL, SITE, HELD[:, 1]) if position else np.tile(SITE, (4, 1))
    before = NavState(attitude.normalize(RNG.standard_normal((4, 4))), 10 * HELD[:, 0], pos)
    dtheta, dvel = 0.1 * RNG.standard_normal((4, 3, 3)), 3.0 + RNG.standard_normal((4, 3, 3))
    after, motion = ins.advance(ins.start(before), dtheta, dvel)
    return before, after.nav, motion


@pytest.mark.parametrize("position", [True, False])
def test_the_growth_in_closed_form(position):
    """Slopes at zero of an epoch, of its change of coordinates and of a fix, by differences of the maps themselves."""
    errors = NavigationErrors(position, parameters=(Parameter("odometer.scale", 1, "1", std=0.1),))
    states, n = errors.states, errors.states.size
    before, after, motion = epoch(position)
    tr = errors.transition(motion, np.eye(n))
    sizes = errors.states.values({"phi": 1e-5, "dv": 0.1, "dp": 100.0} if position else {"phi": 1e-5, "dv": 0.1})
    step = np.where(sizes > 0.0, sizes, 1.0)
    zero = np.zeros((4, n))
    expected = differences(tr.f, zero, step)
    same = Chart(np.zeros((4, 2 if position else 1, 3)), states)  # at rest at the site xi is x to first order
    np.testing.assert_allclose(same.growth(same, motion), expected, rtol=1e-8, atol=1e-8)
    coordinates = Invariant(MODEL, SITE, states)
    growth = coordinates.transition(tr, before, after).f
    expected = differences(growth, zero, step)  # these steps are no negligible errors
    np.testing.assert_allclose(growth.jacobian(zero), expected, rtol=2e-7, atol=2e-7 * np.abs(expected).max())
    near = 1e-10 * RNG.standard_normal((4, n))
    np.testing.assert_array_equal(growth(near), (growth.jacobian(zero) @ near[..., None])[..., 0])
    arm = np.broadcast_to([[0.3, 0.2, -0.1], [1.0, -2.0, 0.5]], (4, 2, 3))
    for given in (None, arm):
        me = Fix(states).measurement(np.zeros((4, 6 if position else 3)), np.eye(6 if position else 3), given)
        seen = coordinates.measurement(me, after).h
        expected = differences(seen, zero, step)
        np.testing.assert_allclose(seen.jacobian(zero), expected, atol=1e-6 * np.abs(expected).max())


def test_runs_with_negligible_errors_do_not_depend_on_the_others():
    """The exact map serves the runs whose errors count, the tangent the others."""
    before, after, motion = epoch(position=False)
    tr = NavigationErrors(position=False).transition(motion, np.eye(12))
    growth = Invariant(MODEL, SITE, WITHOUT_POSITION).transition(tr, before, after).f
    xi = 0.1 * RNG.standard_normal((4, 12))
    xi[::2] = 0.0
    np.testing.assert_array_equal(growth(xi)[::2], 0.0)
    np.testing.assert_array_equal(growth.jacobian(xi)[::2], growth.jacobian(np.zeros((4, 12)))[::2])
    assert (np.abs(growth.jacobian(xi) - growth.jacobian(np.zeros((4, 12))))[1::2].max(axis=(1, 2)) > 1e-4).all()
    points = growth(np.repeat(xi[:, None], 3, axis=1))
    np.testing.assert_allclose(points, np.repeat(growth(xi)[:, None], 3, axis=1), atol=1e-12)


@pytest.mark.parametrize("position", [True, False])
def test_for_small_errors_the_filter_is_the_kalman_filter(position):
    """Prediction and update at zero error, mapped back: mean and covariance of kf on the model's own errors."""
    model, site = earth.get("wgs84"), np.array([0.6, 1.9, 300.0])
    errors = NavigationErrors(position)
    states = errors.states
    coordinates, places = Invariant(model, site, states), STATES.places(states)
    n = states.size
    ins = strapdown.Strapdown(model, 1.0, 3, site, hold_position=not position)
    q = attitude.normalize(RNG.standard_normal((4, 4)))
    before = NavState(q, HELD[:, 0], earth.displace(model, site, HELD[:, 1]) if position else np.tile(site, (4, 1)))
    dtheta, dvel = 0.1 * RNG.standard_normal((4, 3, 3)), 3.0 + RNG.standard_normal((4, 3, 3))
    state, motion = ins.advance(ins.start(before), dtheta, dvel)
    P0 = np.broadcast_to(np.diag((0.01 * SCALE[places]) ** 2), (4, n, n))
    Q = np.diag((0.003 * SCALE[places]) ** 2)
    tr = errors.transition(motion, Q)
    m = 6 if position else 3
    arm = np.broadcast_to([[0.3, 0.2, -0.1], [1.0, -2.0, 0.5]], (4, 2, 3))
    me = Fix(states).measurement(1e-5 * RNG.standard_normal((4, m)), 0.01 * np.eye(m), arm)
    kf, inekf = make_filter("kf"), make_filter("inekf")
    x = Gaussian(np.zeros((4, n)), P0)
    expected = kf.estimate(kf.step(kf.init(x), tr, me)[0])
    moved = coordinates.transition(tr, before, state.nav), coordinates.measurement(me, state.nav)
    b, _ = inekf.step(inekf.init(coordinates.prior(x, before)), *moved)
    got = coordinates.gaussian(inekf.estimate(b), state.nav)
    scale = np.sqrt(np.diagonal(expected.cov, axis1=-2, axis2=-1))
    np.testing.assert_allclose(got.mean / scale, expected.mean / scale, atol=1e-6)
    outer = scale[:, :, None] * scale[:, None, :]
    np.testing.assert_allclose(got.cov / outer, expected.cov / outer, atol=1e-5)


def test_covariance_comes_back_as_it_went_in():
    P = np.diag(0.01 * SCALE**2) + 1e-4
    coordinates = Invariant(earth.get("wgs84"), np.array([0.6, 1.9, 300.0]), STATES)
    nav = navs(HELD[:, 0], earth.displace(earth.get("wgs84"), np.array([0.6, 1.9, 300.0]), HELD[:, 1]))
    x = Gaussian(np.zeros((4, 15)), np.broadcast_to(P, (4, 15, 15)))
    back = coordinates.gaussian(coordinates.prior(x, nav), nav)
    np.testing.assert_allclose(back.mean, 0.0, atol=1e-12)
    np.testing.assert_allclose(back.cov, x.cov, rtol=1e-6, atol=1e-6)
    for left in (1e-17, 1e-8):  # what rounding leaves of a mean, and a little more
        near = coordinates.gaussian(coordinates.prior(x, nav)._replace(mean=x.mean + left), nav)
        np.testing.assert_allclose(near.cov, x.cov, rtol=1e-6, atol=1e-6)
