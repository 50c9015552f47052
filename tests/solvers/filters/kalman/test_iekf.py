"""The iterated EKF against the maximum of the posterior, found by scipy."""

import numpy as np
import pytest
from oracles.problems import look, spd, swing
from scipy.optimize import minimize

from solvers.blocks.moments import tangent
from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition

RNG = np.random.default_rng(5)
X, P0 = RNG.standard_normal((6, 4)), 0.3 * spd(RNG, 6, 4)
Z, R, Q = RNG.standard_normal((6, 2)), 0.1 * np.eye(2), 0.02 * np.eye(4)
H = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.5]])


def squared(r, S):
    return r @ np.linalg.solve(S, r)


def updated(h, settings, tr):
    flt = make_filter("iekf", tolerance=1e-12, **settings)
    b, _ = flt.step(flt.init(Gaussian(X, P0)), tr, Measurement(Z, h, R))
    return flt.estimate(b)


def test_update_is_the_maximum_of_the_posterior():
    """With a linear f the iterates end where the posterior of x after the fix has its maximum. Bell & Cathey (1993)."""
    mean, cov = updated(look, {"iterations": 100}, Transition(Linear(np.eye(4)), Q))
    for x, P, z, got, got_P in zip(X, P0 + Q, Z, mean, cov, strict=True):
        best = minimize(lambda y, x=x, P=P, z=z: squared(y - x, P) + squared(z - look(y), R), got + 0.01, tol=1e-14)
        np.testing.assert_allclose(got, best.x, atol=1e-5)
        _, J = tangent(look, best.x, np.ones(4))
        np.testing.assert_allclose(np.linalg.inv(got_P), np.linalg.inv(P) + J.T @ np.linalg.solve(R, J), atol=1e-3)


@pytest.mark.parametrize("h", [look, Linear(H)])
def test_smoothed_update_is_the_maximum_over_both_states(h):
    """The pair before and after a transition nearly without noise, where nothing but its tangent counts."""
    small = 1e-6 * np.eye(4)
    mean, _ = updated(h, {"iterations": 200}, Transition(swing, small))
    for x, P, z, got in zip(X, P0, Z, mean, strict=True):
        best = minimize(lambda y, x=x, P=P, z=z: squared(y - x, P) + squared(z - h(swing(y)), R), x, tol=1e-14)
        np.testing.assert_allclose(got, swing(best.x), atol=1e-4)


def test_smoothing_helps_where_only_f_is_curved():
    """With a linear h the textbook's iterations change nothing; with the transition iterated the fit is better."""
    tr = Transition(swing, 1e-6 * np.eye(4))
    plain, smooth = (updated(Linear(H), {"smooth": s, "iterations": 50}, tr).mean for s in (False, True))
    ekf = make_filter("ekf")
    b, _ = ekf.step(ekf.init(Gaussian(X, P0)), tr, Measurement(Z, Linear(H), R))
    np.testing.assert_allclose(plain, ekf.estimate(b).mean, atol=1e-13)
    assert np.abs(smooth - plain).max() > 1e-3


def test_runs_stop_for_themselves():
    """A run that converges at once is not changed by a neighbour that takes longer."""
    tr, me = Transition(swing, Q), Measurement(Z, look, R)
    flt = make_filter("iekf", iterations=30)
    whole = flt.estimate(flt.step(flt.init(Gaussian(X, P0)), tr, me)[0])
    for i in range(6):
        one = flt.step(flt.init(Gaussian(X[i], P0[i])), tr, Measurement(Z[i], look, R))[0]
        np.testing.assert_allclose(flt.estimate(one).mean, whole.mean[i], rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"iterations": 0}, "iterations = 0"), ({"tolerance": -1.0}, "tolerance = -1.0"), ({"smooth": 1}, "smooth = 1")],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        make_filter("iekf", **settings)
