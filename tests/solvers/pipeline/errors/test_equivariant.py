"""Equivariant coordinates against matrix exponentials, and against differences of the exact propagation."""

import numpy as np
import pytest
from scipy.linalg import expm

from sins_env import attitude, earth
from sins_env.types import NavState
from solvers.pipeline import feedback, strapdown
from solvers.pipeline.aiding.gps import Fix
from solvers.pipeline.errors.equivariant import UNIT, Equivariant, left_jacobian
from solvers.pipeline.errors.group_slopes import right_jacobian
from solvers.pipeline.errors.invariant import Invariant
from solvers.pipeline.errors.model import Parameter
from solvers.pipeline.errors.navigation import PHI, STATES, WITHOUT_POSITION, NavigationErrors
from solvers.types import Gaussian

RNG = np.random.default_rng(8)
MODEL, SITE = earth.get("wgs84"), np.array([0.6, 1.9, 300.0])
SCALE = np.array([0.3] * 3 + [2.0] * 3 + [30.0] * 3 + [5.0] * 3 + [2.0] * 3)
NAV = NavState(
    attitude.normalize(RNG.standard_normal((4, 4))),
    40 * RNG.standard_normal((4, 3)),
    earth.displace(MODEL, np.tile(SITE, (4, 1)), 200 * RNG.standard_normal((4, 3))),
)


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def se3(xi):
    """The adjoint of the Lie algebra of SE(3) at xi, whose rotation vector is -theta, gyro first, in deg/h and mg."""
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = skew(-xi[:3])
    out[3:, :3] = UNIT * skew(xi[3:6])
    return out


def mean_of(A):
    """The sum of A^k / (k + 1)!, out of an exponential."""
    n = len(A)
    return expm(np.block([[A, np.eye(n)], [np.zeros((n, 2 * n))]]))[:n, n:]


def differences(g, x, step):
    return np.stack([(g(x + one) - g(x - one)) / (2 * one.sum()) for one in np.diag(step)], axis=-1)


def test_biases_are_those_of_the_group():
    """Ad delta = J_l(xi) beta, with Ad that of (C_hat, v_hat)."""
    coordinates = Equivariant(MODEL, SITE, STATES)
    xi = SCALE * RNG.standard_normal((4, 15))
    x = coordinates.errors(xi, NAV)
    np.testing.assert_array_equal(x[:, :9], Invariant(MODEL, SITE, STATES).errors(xi, NAV)[:, :9])
    for i, C in enumerate(attitude.to_dcm(NAV.q_nb)):
        Ad = np.block([[C, np.zeros((3, 3))], [UNIT * skew(NAV.vel[i]) @ C, C]])
        np.testing.assert_allclose(left_jacobian(xi)[i], mean_of(se3(xi[i])), atol=1e-12)
        np.testing.assert_allclose(Ad @ x[i, 9:], mean_of(se3(xi[i])) @ xi[i, 9:], atol=1e-11)
    chart = coordinates.at(NAV)
    np.testing.assert_allclose(chart.invariant(x), xi, rtol=1e-9, atol=1e-9)
    expected = differences(chart.errors, xi, np.full(15, 1e-5))
    np.testing.assert_allclose(chart.errors_slope(xi, x), expected, rtol=1e-7, atol=1e-6)
    inverse = np.eye(15) + 0 * expected
    np.testing.assert_allclose(chart.invariant_slope(xi, x) @ chart.errors_slope(xi, x), inverse, atol=1e-9)
    points = chart.errors(np.repeat(xi[:, None], 3, axis=1))
    np.testing.assert_allclose(points, np.repeat(x[:, None], 3, axis=1), rtol=1e-13)


def flat(chi, eta, b, h):
    """(C, v) after h with constant gyro rate and force, on a flat earth at rest, with the biases b added to the input."""
    C, v = chi
    steps = 200
    for _ in range(steps):
        rate, force = eta[:3] + b[:3], eta[3:] + b[3:]
        half = C @ expm(skew(rate) * h / steps / 2)
        v = v + half @ force * h / steps + np.array([0, 0, -9.8]) * h / steps
        C = C @ expm(skew(rate) * h / steps)
    return C, v


def test_navigation_errors_are_driven_linearly():
    """On a flat earth log(X_hat X^-1) changes at the rate A xi + beta, whatever its size: differences of two integrations."""
    h, eta, b = 2e-4, np.array([0.4, -0.3, 0.5, 1.0, 2.0, 10.0]), np.array([0.02, 0.03, -0.04, 0.5, -0.2, 0.3])
    xi = np.array([0.8, -0.5, 1.1, 4.0, 3.0, -2.0])
    C_hat, v_hat = attitude.to_dcm(NAV.q_nb[0]), np.array([30.0, -20.0, 5.0])
    error = expm(np.block([[skew(-xi[:3]), xi[3:, None]], [np.zeros((1, 4))]]))
    truth = error[:3, :3].T @ C_hat, error[:3, :3].T @ (v_hat - error[:3, 3])
    one, other = flat((C_hat, v_hat), eta, b, h), flat(truth, eta, np.zeros(6), h)
    C = one[0] @ other[0].T
    theta = -np.array([(C[2, 1] - C[1, 2]), (C[0, 2] - C[2, 0]), (C[1, 0] - C[0, 1])])
    theta *= np.arccos((np.trace(C) - 1) / 2) / np.linalg.norm(theta)
    nu = np.linalg.solve(mean_of(skew(-theta)), one[1] - C @ other[1])
    Ad = np.block([[C_hat, np.zeros((3, 3))], [skew(v_hat) @ C_hat, C_hat]])
    minus = np.array([-1, -1, -1, 1, 1, 1])
    unscaled = mean_of(np.block([[skew(-xi[:3]), np.zeros((3, 3))], [skew(xi[3:]), skew(-xi[:3])]]))
    beta = np.linalg.solve(unscaled, Ad @ b)
    A_xi = np.concatenate([np.zeros(3), np.cross(xi[:3], [0, 0, -9.8])])
    rate = (np.concatenate([theta, nu]) - xi) / h
    np.testing.assert_allclose(rate, minus * beta + A_xi, rtol=0, atol=5e-3)


@pytest.mark.parametrize("position", [True, False])
def test_growth_fix_and_noise_at_zero(position):
    """Slopes in closed form, by central differences of the exact propagation between the charts."""
    errors = NavigationErrors(position, parameters=(Parameter("odometer.scale", 1, "1", std=0.1),))
    states, n = errors.states, errors.states.size
    ins = strapdown.Strapdown(MODEL, 1.0, 3, SITE, hold_position=not position)
    before = NAV if position else NAV._replace(pos=np.tile(SITE, (4, 1)))
    increments = 0.1 * RNG.standard_normal((4, 3, 3)), 3.0 + RNG.standard_normal((4, 3, 3))
    after, motion = ins.advance(ins.start(before), *increments)
    Q = np.diag(RNG.random(n))
    tr = errors.transition(motion, Q)
    coordinates = Equivariant(MODEL, SITE, states)
    moved = coordinates.transition(tr, before, after.nav)
    sizes = {"phi": 1e-5, "dv": 0.1, "dp": 100.0} if position else {"phi": 1e-5, "dv": 0.1}
    step, zero = states.values(sizes), np.zeros((4, n))
    expected = differences(moved.f, zero, np.where(step > 0.0, step, 1.0))
    np.testing.assert_allclose(moved.f.jacobian(zero), expected, rtol=2e-7, atol=2e-7 * np.abs(expected).max())
    D = coordinates.at(after.nav).slope()
    np.testing.assert_allclose(moved.Q, D @ Q @ D.mT, atol=1e-11 * np.abs(moved.Q).max())
    arm = np.broadcast_to([[0.3, 0.2, -0.1], [1.0, -2.0, 0.5]], (4, 2, 3))
    m = 6 if position else 3
    seen = coordinates.measurement(Fix(states).measurement(np.zeros((4, m)), np.eye(m), arm), after.nav).h
    expected = differences(seen, zero, np.where(step > 0.0, step, 1.0))
    np.testing.assert_allclose(seen.jacobian(zero), expected, atol=1e-6 * np.abs(expected).max())


def test_reset_is_the_product_in_the_group():
    """After the feedback of its mean nothing is left of it, and the covariance goes by the right Jacobian of the group."""
    coordinates = Equivariant(MODEL, SITE, STATES)
    xi_hat = 0.5 * SCALE * RNG.standard_normal((4, 15))
    x_hat = coordinates.errors(xi_hat, NAV)
    after = NavigationErrors().corrected(MODEL, NAV, x_hat)
    g, jacobian = coordinates.reset(feedback.reset_maps(x_hat, PHI, slice(3, 15)), NAV, after)
    np.testing.assert_allclose(g(xi_hat)[:, [*range(6), *range(9, 15)]], 0.0, atol=1e-9)
    np.testing.assert_allclose(g(xi_hat)[:, 6:9], 0.0, atol=1e-2)  # metres on an ellipsoid
    for at in (xi_hat, xi_hat + 0.05 * SCALE * RNG.standard_normal((4, 15))):
        expected = differences(g, at, np.full(15, 1e-6))
        np.testing.assert_allclose(jacobian(at), expected, rtol=1e-3, atol=1e-4)  # metres on an ellipsoid
    twelve = np.delete(np.arange(15), range(6, 9))
    level = Equivariant(MODEL, SITE, WITHOUT_POSITION).at(NAV).right_jacobian(xi_hat[:, twelve])
    J = coordinates.at(NAV).right_jacobian(xi_hat)
    np.testing.assert_allclose(level, J[:, twelve][..., twelve], atol=1e-13)
    np.testing.assert_allclose(J[:, :9, :9], right_jacobian(xi_hat, STATES)[:, :9, :9], atol=1e-11)


def test_covariance_comes_back_as_it_went_in():
    coordinates, P = Equivariant(MODEL, SITE, STATES), np.diag(0.01 * SCALE**2) + 1e-4
    x = Gaussian(np.zeros((4, 15)), np.broadcast_to(P, (4, 15, 15)))
    back = coordinates.gaussian(coordinates.prior(x, NAV), NAV)
    np.testing.assert_allclose(back.cov, x.cov, rtol=1e-9, atol=1e-9)
