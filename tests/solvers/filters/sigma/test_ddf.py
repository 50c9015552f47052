import math

import numpy as np
import pytest
from oracles.problems import linear, look, spd, swing
from oracles.zoo import generators

from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition

H = math.sqrt(3.0)


def differences(g, mean, P, h, second):
    """Mean, covariance and cross covariance of g(x) by Norgaard, Poulsen & Ravn (2000), one run, by loops."""
    S, n, y0 = np.linalg.cholesky(P), len(mean), g(mean)
    y, P_yy, P_xy = np.array(y0), np.zeros((len(y0), len(y0))), np.zeros((n, len(y0)))
    for p in range(n):
        up, down = g(mean + h * S[:, p]), g(mean - h * S[:, p])
        P_yy += np.outer(up - down, up - down) / (4 * h**2)
        P_xy += np.outer(S[:, p], up - down) / (2 * h)
        if second:
            bend = up + down - 2 * y0
            y += bend / (2 * h**2)
            P_yy += (h**2 - 1) / (4 * h**4) * np.outer(bend, bend)
    return y, P_yy, P_xy


def textbook(x, P, Q, R, measurements, h, second):
    """The filter in covariance form, one run."""
    for z in measurements:
        x, P, _ = differences(swing, x, P, h, second)
        P = P + Q
        residual = S = None
        if z is not None:
            y, S, P_xy = differences(look, x, P, h, second)
            S = S + R
            residual = z - y
            K = P_xy @ np.linalg.inv(S)
            x, P = x + K @ residual, P - K @ S @ K.T
        yield x, P, residual, S


@pytest.mark.parametrize(("name", "second"), [("ddf1", False), ("ddf2", True)])
@pytest.mark.parametrize("h", [1.0, H, 2.0])
@pytest.mark.parametrize("dead", [[], [2, 3]])
def test_the_filter_is_the_textbooks_in_covariance_form(name, second, h, dead):
    """Also with zero rows in Q, as biases have."""
    rng = np.random.default_rng(5)
    x, P, Q, R = rng.standard_normal((3, 4)), spd(rng, 3, 4), 0.05 * spd(rng, 4), 0.5 * spd(rng, 2)
    Q[dead] = Q[:, dead] = 0.0
    z = [None if k % 5 == 3 else 0.5 * rng.standard_normal((3, 2)) for k in range(40)]
    flt = make_filter(name, interval=h)
    b = flt.init(Gaussian(x, P))
    each = [textbook(x[i], P[i], Q, R, [None if u is None else u[i] for u in z], h, second) for i in range(3)]
    for z_k, *expected in zip(z, *each, strict=True):
        b, innovation = flt.step(b, Transition(swing, Q), None if z_k is None else Measurement(z_k, look, R))
        got = flt.estimate(b)
        for i, (mean, cov, residual, S) in enumerate(expected):
            np.testing.assert_allclose(got.mean[i], mean, rtol=0, atol=1e-9)
            np.testing.assert_allclose(got.cov[i], cov, rtol=0, atol=1e-9 * np.abs(cov).max())
            if innovation is not None:
                np.testing.assert_allclose(innovation.residual[i], residual, rtol=0, atol=1e-9)
                np.testing.assert_allclose(innovation.cov[i], S, rtol=0, atol=1e-9 * np.abs(S).max())
    assert not b.health.repairs.any()


def test_linear_dynamics_need_no_interval():
    p = linear(1, 4, 2, batch=(3,), missing=0.0)
    ends = []
    for interval in (1.0, 7.0):
        flt = make_filter("ddf2", interval=interval)
        b = flt.init(Gaussian(p.x, p.P))
        for z in p.z:
            b, _ = flt.step(b, Transition(Linear(p.F, p.c), p.Q), Measurement(z, Linear(p.H, p.d), p.R))
        ends.append(b)
    np.testing.assert_array_equal(ends[0].mean, ends[1].mean)
    np.testing.assert_array_equal(ends[0].root, ends[1].root)


@pytest.mark.parametrize("name", ["ddf1", "ddf2"])
def test_noise_that_belongs_to_each_run_may_be_singular(name):
    rng = np.random.default_rng(6)
    flt, A = make_filter(name), rng.standard_normal((4, 2))
    x, P = rng.standard_normal((4, 4)), spd(rng, 4, 4)
    Q = np.stack([np.zeros((4, 4)), A @ A.T, np.diag([1.0, 0.0, 0.0, 2.0]), spd(rng, 4)])
    R = np.stack([np.eye(2), np.diag([0.0, 1.0]), np.ones((2, 2)), spd(rng, 2)])
    z = rng.standard_normal((4, 2))
    batch, innovation = flt.step(flt.init(Gaussian(x, P)), Transition(swing, Q), Measurement(z, look, R))
    assert not batch.health.repairs.any()
    for i in range(4):
        h, second = H, name == "ddf2"
        mean, cov, _ = differences(swing, x[i], P[i], h, second)
        y, S, P_xy = differences(look, mean, cov + Q[i], h, second)
        K = P_xy @ np.linalg.inv(S + R[i])
        np.testing.assert_allclose(batch.mean[i], mean + K @ (z[i] - y), atol=1e-11)
        np.testing.assert_allclose(flt.estimate(batch).cov[i], cov + Q[i] - K @ (S + R[i]) @ K.T, atol=1e-11)
        np.testing.assert_allclose(innovation.cov[i], S + R[i], atol=1e-12)


def test_an_indefinite_noise_is_repaired_and_counted():
    """No model can tell one, but what a filter is given by another one may be."""
    flt = make_filter("ddf2")
    Q = np.stack([np.eye(4), np.diag([1.0, 1.0, 1.0, -0.5])])
    b = flt.init(Gaussian(np.zeros((2, 4)), np.eye(4)))
    b = flt.predict(b, Transition(swing, Q))
    b, _ = flt.correct(b, Measurement(np.zeros(2), look, np.diag([1.0, -1.0])))
    np.testing.assert_array_equal(b.health.repairs, [1, 2])
    assert np.isfinite(b.root).all()


def test_a_measurement_without_noise_leaves_no_variance():
    flt = make_filter("ddf2")
    b = flt.init(Gaussian(np.ones(3), np.eye(3)))
    b = flt.correct(b, Measurement(np.array([2.0]), Linear(np.eye(1, 3)), np.zeros((1, 1))))[0]
    np.testing.assert_allclose(b.mean, [2.0, 1.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(flt.estimate(b).cov, np.diag([0.0, 1.0, 1.0]), atol=1e-15)
    again, innovation = flt.correct(b, Measurement(np.array([3.0]), Linear(np.eye(1, 3)), np.zeros((1, 1))))
    np.testing.assert_allclose(again.mean, b.mean, atol=1e-15)  # what is known exactly does not move
    assert innovation.residual == pytest.approx(1.0)


def test_the_covariance_stays_positive_where_the_second_order_weight_is_negative():
    """(h^2 - n) / h^2 < 0 for n > 3; S is built from sums of squares all the same."""
    rng = np.random.default_rng(7)
    flt = make_filter("ddf2")
    b = flt.init(Gaussian(np.zeros((20, 12)), np.eye(12)), generators((20,)))
    for _ in range(20):
        tr = Transition(lambda x: np.sin(2.0 * x) + 0.5 * x, 0.01 * np.eye(12))
        me = Measurement(rng.standard_normal((20, 2)), lambda x: x[..., :2] ** 3, 0.01 * np.eye(2))
        b, _ = flt.step(b, tr, me)
        P = flt.estimate(b).cov
        assert np.linalg.eigvalsh(P).min() > -1e-15 * np.abs(P).max()
    assert not b.health.repairs.any()
    assert not b.health.frozen
