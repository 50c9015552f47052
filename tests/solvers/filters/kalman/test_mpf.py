"""The predictive filter: the double integrator by hand (docs/mathematics/filters.md#predictive-filter), its
covariance, its constraint, and the EKF it drives."""

import math

import numpy as np
import pytest
from oracles.problems import look, spd, swing
from scipy.stats import chi2

from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition

DT, R = 0.1, 1e-4
F = np.array([[1.0, DT], [0.0, 1.0]])
Q = np.diag([0.0, 0.04])  #: (0.2 m/s)^2 per epoch on the velocity
H = np.array([[1.0, 0.0]])
ONE = Transition(Linear(F), Q, np.array([[0.0], [1.0]]), DT)


def fix(z, R=R):
    return Measurement(np.atleast_1d(np.asarray(z, dtype=float)), Linear(H), R * np.eye(1))


def positions(rng, runs, steps, force):
    """Truth (steps, runs, 2) of x'' = force(t), integrated exactly for constant force, and fixes (steps, runs)."""
    x, truth = np.zeros((runs, 2)), []
    for k in range(steps):
        a = force(k * DT)
        x = np.stack([x[:, 0] + DT * x[:, 1] + 0.5 * DT**2 * a, x[:, 1] + DT * a], axis=-1)
        truth.append(x)
    truth = np.array(truth)
    return truth, truth[..., 0] + math.sqrt(R) * rng.standard_normal((steps, runs))


@pytest.mark.parametrize("W", [0.1, 1.0])
def test_the_double_integrator_by_hand(W):
    """x1' = x2, x2' = d, y = x1: Lambda S = dt^2 / 2, z(x) = dt x2; d is held over the epoch."""
    flt = make_filter("mpf", weight=W * Q[1, 1] / DT**2, rate=0.0)  # d in standard deviations of the told noise
    b = flt.init(Gaussian(np.array([0.3, -0.2]), np.eye(2)))
    x1, x2 = 0.3, -0.2
    for z in np.random.default_rng(0).standard_normal(30):
        reach = DT**2 / 2
        d = -(reach / R) * (DT * x2 - z + x1) / (reach**2 / R + W)
        x1, x2 = x1 + DT * x2 + DT**2 / 2 * d, x2 + DT * d
        b, _ = flt.step(b, ONE, fix(z))
        np.testing.assert_allclose(b.mean, [x1, x2], rtol=1e-10)


def dense(x, P, K, F, Q, H, R, fixes):
    """A filter of constant gain K under the model: its covariance by Joseph's form."""
    for z in fixes:
        x, P = F @ x, F @ P @ F.T + Q
        A = np.eye(len(x)) - K @ H
        x, P = x + K @ (z - H @ x), A @ P @ A.T + K @ R @ K.T
    return x, P


def test_a_random_system_densely():
    rng = np.random.default_rng(3)
    F, H, Q, R = 0.8 * rng.standard_normal((4, 4)) / 2, rng.standard_normal((2, 4)), spd(rng, 4), spd(rng, 2)
    P, fixes, W = spd(rng, 4), rng.standard_normal((20, 2)), 3.0
    L = np.linalg.cholesky(Q)
    B = 0.5 * (L + F @ L)
    S = H @ B
    K = B @ np.linalg.inv(S.T @ np.linalg.inv(R) @ S + W * np.eye(4)) @ S.T @ np.linalg.inv(R)
    x, P_end = dense(np.ones(4), P, K, F, Q, H, R, fixes)
    flt = make_filter("mpf", weight=W, rate=0.0)
    b = flt.init(Gaussian(np.ones(4), P))
    for z in fixes:
        b, _ = flt.step(b, Transition(Linear(F), Q), Measurement(z, Linear(H), R))
    np.testing.assert_allclose(b.mean, x, atol=1e-12)
    np.testing.assert_allclose(b.cov, P_end, atol=1e-12)


@pytest.mark.parametrize("name", ["mpf", "mpf_ekf"])
def test_the_reported_covariance_is_that_of_the_errors(name):
    """Truth from the told model, constant W: mean NEES over 400 runs within the 99.9 % band."""
    rng, runs = np.random.default_rng(5), 400
    flt = make_filter(name, weight=0.3, rate=0.0)
    x = 0.1 * rng.standard_normal((runs, 2))
    b = flt.init(Gaussian(np.zeros((runs, 2)), 0.01 * np.eye(2)))
    for _ in range(40):
        x = x @ F.T + rng.standard_normal((runs, 2)) * np.sqrt(np.diag(Q))
        b, _ = flt.step(b, ONE, fix(x[:, :1] + math.sqrt(R) * rng.standard_normal((runs, 1))))
    e = (b.mean - x)[..., None]
    nees = (e.mT @ np.linalg.solve(b.cov, e)).sum()
    assert chi2.ppf(0.0005, 2 * runs) < nees < chi2.ppf(0.9995, 2 * runs)


@pytest.mark.parametrize("weight", [1e-4, 1e3])
def test_the_constraint_finds_the_weight(weight):
    """A force that the model does not know: wherever W starts, residuals come to have the variance of the fixes."""
    runs, steps = 20, 3000
    _, z = positions(np.random.default_rng(1), runs, steps, lambda t: 0.5 * math.sin(t))
    squares = {}
    for rate in (0.0, 0.01):
        flt = make_filter("mpf", weight=weight, rate=rate)
        b = flt.init(Gaussian(np.zeros((runs, 2)), 1e-4 * np.eye(2)))
        left = []
        for z_k in z:
            b, _ = flt.step(b, ONE, fix(z_k[:, None]))
            left.append(np.square(z_k - b.mean[:, 0]) / R)
        squares[rate] = np.mean(left[-1000:])
    assert squares[0.01] == pytest.approx(1.0, abs=0.05)
    assert abs(squares[0.0] - 1.0) > 0.2
    assert flt.diagnostics(b)["trust"].shape == (runs,)


def test_the_model_error_is_found():
    """The velocity follows a force that the model does not know; without d (W = inf) it does not."""
    truth, z = positions(np.random.default_rng(2), 20, 1000, lambda t: 0.5 * math.sin(t))
    errors = {}
    for weight in (1.0, math.inf):
        flt = make_filter("mpf", weight=weight)
        b = flt.init(Gaussian(np.zeros((20, 2)), 1e-4 * np.eye(2)))
        for z_k in z:
            b, _ = flt.step(b, ONE, fix(z_k[:, None]))
        errors[weight] = np.abs(b.mean - truth[-1])[:, 0].mean()
    assert errors[1.0] < 0.02
    assert errors[math.inf] > 0.1


def test_it_moves_only_what_the_noise_drives():
    """No bias is learnt: a state without process noise keeps its mean, and its variance does not fall."""
    F3 = np.array([[1.0, DT, 0.0], [0.0, 1.0, DT], [0.0, 0.0, 1.0]])  # position, velocity, constant acceleration
    flt = make_filter("mpf")
    b = flt.init(Gaussian(np.array([0.0, 0.0, 0.7]), np.eye(3)))
    for z in np.random.default_rng(4).standard_normal(50):
        me = Measurement(np.array([z]), Linear(np.eye(1, 3)), 0.01 * np.eye(1))
        b, _ = flt.step(b, Transition(Linear(F3), np.diag([0.0, 0.04, 0.0])), me)
    assert b.mean[2] == 0.7
    assert b.cov[2, 2] == pytest.approx(1.0, abs=1e-12)


def test_the_driven_ekf_is_two_updates_in_turn():
    """x- = f(x) + B d by the predictive filter, then the EKF's gain on what is left of the innovation."""
    rng = np.random.default_rng(6)
    x, P, z, R2 = rng.standard_normal((5, 4)), spd(rng, 5, 4), rng.standard_normal((5, 2)), 0.5 * np.eye(2)
    tr, me = Transition(swing, 0.3 * np.eye(4)), Measurement(z, look, R2)
    b, _ = make_filter("mpf_ekf", weight=0.2).step(make_filter("mpf_ekf", weight=0.2).init(Gaussian(x, P)), tr, me)
    driven, _ = make_filter("mpf", weight=0.2).step(make_filter("mpf", weight=0.2).init(Gaussian(x, P)), tr, me)
    ekf = make_filter("ekf")
    prior = ekf.predict(ekf.init(Gaussian(x, P)), tr)
    for i in range(5):
        J = np.stack([(look(prior.mean[i] + h) - look(prior.mean[i] - h)) / 2e-6 for h in 1e-6 * np.eye(4)], axis=-1)
        K = prior.cov[i] @ J.T @ np.linalg.inv(J @ prior.cov[i] @ J.T + R2)
        left = z[i] - look(prior.mean[i]) - J @ (driven.mean[i] - prior.mean[i])
        np.testing.assert_allclose(b.mean[i], driven.mean[i] + K @ left, atol=1e-7)
    assert np.abs(b.mean - ekf.correct(prior, me)[0].mean).max() > 0.01


def test_the_driven_ekf_is_never_more_certain_than_the_ekf():
    rng = np.random.default_rng(7)
    x, P = Gaussian(np.zeros((6, 2)), spd(rng, 6, 2)), fix(rng.standard_normal((6, 1)))
    more, less = (make_filter(n).step(make_filter(n).init(x), ONE, P)[0].cov for n in ("mpf_ekf", "ekf"))
    assert np.linalg.eigvalsh(more - less).min() > -1e-15


def test_relocation_moves_the_reach():
    flt = make_filter("mpf")
    b, _ = flt.step(flt.init(Gaussian(np.zeros(2), np.eye(2))), ONE, None)
    J = np.array([[2.0, 0.0], [1.0, 1.0]])
    moved = flt.relocate(b, Linear(J), lambda x: J)
    np.testing.assert_allclose(moved.reach, J @ b.reach @ J.T)
    assert b.reach[0, 0] == pytest.approx((0.2 * DT / 2) ** 2)  # dt / 2 of the velocity that the noise adds


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"weight": 0.0}, "weight = 0.0"), ({"rate": -0.1}, "rate = -0.1"), ({"rate": 2}, "rate = 2")],
)
def test_settings_are_checked(settings, message):
    for name in ("mpf", "mpf_ekf"):
        with pytest.raises(ValueError, match=message):
            make_filter(name, **settings)
