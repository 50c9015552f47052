"""What the filters do at the limits of their numbers: exact fixes, a singular S, diffuse priors, fixes that are far off."""

import math

import numpy as np
import pytest
from oracles.zoo import as_kalman, generators, settings_of

from solvers.filters import make_filter, names
from solvers.types import Gaussian, Linear, Measurement, NoiseLaw, Transition

I2, F = np.eye(2), np.array([[1.0, 1.0], [0.0, 1.0]])
Q, H, R = 0.01 * I2, np.eye(1, 2), np.array([[0.04]])
ZS = (0.3, 0.9, 1.2, 1.4)
LIKE_KALMAN = {name: as_kalman(name) for name in names() if as_kalman(name) is not None}


def track(name, settings, R, H=H, P0=1.0, zs=ZS):
    flt = make_filter(name, **settings)
    b = flt.init(Gaussian(np.zeros(2), P0 * I2), generators(()))
    for z in zs:
        b, _ = flt.step(b, Transition(Linear(F), Q), Measurement(np.full(len(H), z), Linear(H), R))
    return flt.estimate(b), b.health


def kalman(R, P0=1.0):
    """The Kalman filter in Joseph's form."""
    x, P = np.zeros(2), P0 * I2
    for z in ZS:
        x, P = F @ x, F @ P @ F.T + Q
        K = P @ H.T / (H @ P @ H.T + R)
        x, P = x + K @ (z - H @ x), (I2 - K @ H) @ P @ (I2 - K @ H).T + K @ R @ K.T
    return x, P


@pytest.mark.parametrize("name", [n for n in names() if n not in ("mpf", "mpf_ekf")])
@pytest.mark.parametrize("variance", [0.0, 1e-30])
def test_an_exact_fix_is_followed(name, variance):
    x, health = track(name, settings_of(name), np.array([[variance]]))
    assert health.failed_at == -1
    assert abs(x.mean[0] - ZS[-1]) < 1e-6
    assert 0.1 < x.mean[1] < 0.5
    assert x.cov[0, 0] < 1e-6


@pytest.mark.parametrize("name", LIKE_KALMAN)
def test_two_readings_of_one_sensor_count_once(name):
    """Two readings and four, and two before or behind another sensor, whose fix must keep its weight."""
    right, P = kalman(R)
    for readings in (2, 4):
        x, health = track(name, LIKE_KALMAN[name], 0.04 * np.ones((readings, readings)), np.repeat(H, readings, axis=0))
        np.testing.assert_allclose(x.mean, right, atol=1e-5)
        np.testing.assert_allclose(x.cov, P, atol=1e-5)
        assert health.failed_at == -1
    both = track("kf", {}, np.diag([0.04, 0.09]), I2)[0]
    for rows in ([0, 0, 1], [1, 0, 0]):
        at = np.array(rows)
        x, _ = track(name, LIKE_KALMAN[name], np.where(at[:, None] == at, np.array([0.04, 0.09])[at], 0.0), I2[at])
        np.testing.assert_allclose(x.mean, both.mean, atol=1e-5)
        np.testing.assert_allclose(x.cov, both.cov, atol=1e-5)
    if name in ("ckf", "ddf1", "ddf2"):
        settings = {"form": "square-root"} if name == "ckf" else {}
        x, health = track(name, settings, 0.04 * np.ones((2, 2)), np.vstack([H, H]))
        np.testing.assert_allclose(x.mean, right, atol=1e-9)
        assert health.repairs == 4


@pytest.mark.parametrize("name", LIKE_KALMAN)
def test_diffuse_priors(name):
    """Up to 1e8 nothing is lost; at 1e16 a covariance has no digits left, and the filter is rather too unsure."""
    right, P = kalman(R, 1e8)
    x, _ = track(name, LIKE_KALMAN[name], R, P0=1e8)
    np.testing.assert_allclose(x.mean, right, atol=1e-5)
    np.testing.assert_allclose(x.cov, P, atol=1e-5)
    two, _ = track(
        name, LIKE_KALMAN[name], 2.0 * R * I2, np.vstack([H, H]), P0=1e8
    )  # as good as one of half the variance
    np.testing.assert_allclose(two.mean, right, atol=1e-3)
    np.testing.assert_allclose(two.cov, P, rtol=1e-3)
    x, health = track(name, LIKE_KALMAN[name], R, P0=1e16)
    assert health.failed_at == -1
    assert (np.abs(x.mean - right) < np.sqrt(np.diagonal(P))).all()
    assert (np.diagonal(x.cov) > 0.7 * np.diagonal(P)).all()


@pytest.mark.parametrize(
    ("name", "pull", "share"),
    [("huber_ckf", 1.345, 0.5), ("mcc_ckf", 1.2 * 3.0 * math.exp(-0.5), 0.5), ("student_t_ckf", 4.0 / 12.0**0.5, 1.0)],
)
def test_a_wrong_fix_pulls_no_more_than_promised(name, pull, share):
    for P in (0.01, 0.1, share):
        off = np.concatenate([np.linspace(0.1, 40.0, 30), 10.0 ** np.arange(2, 13)])
        flt = make_filter(name)
        b = flt.init(Gaussian(np.zeros((len(off), 1)), P * np.eye(1)))
        b, _ = flt.correct(b, Measurement(off[:, None], Linear(np.eye(1)), np.eye(1)))
        assert b.mean.max() <= pull * P * (1.0 + 1e-4)
    b = make_filter("huber_ckf").init(Gaussian(np.zeros(1), 4.0 * np.eye(1)))  # beyond the promise a fix is followed
    b, _ = make_filter("huber_ckf").correct(b, Measurement(np.array([100.0]), Linear(np.eye(1)), np.eye(1)))
    assert b.mean[0] > 99.0


@pytest.mark.parametrize("rate_hz", [1.0, 4.0, 20.0])
def test_patience_is_a_time(rate_hz):
    """An estimate 315 m off comes back after ten seconds, whatever the rate of the fixes."""
    flt, dt = make_filter("student_t_ckf"), 1.0 / rate_hz
    F = np.array([[1.0, dt], [0.0, 1.0]])
    b, seconds = flt.init(Gaussian(np.zeros(2), np.diag([1.0, 0.01]))), 0.0
    while abs(b.mean[0] - 315.0) > 5.0 and seconds < 60.0:
        me = Measurement(np.array([315.0]), Linear(np.eye(1, 2)), np.eye(1))
        b, _ = flt.step(b, Transition(Linear(F), 1e-4 * dt * np.eye(2), dt=dt), me)
        seconds += dt
    assert 9.9 < seconds < 10.1 + 2.0 * dt


@pytest.mark.parametrize("law", [None, NoiseLaw(0.2, 10.0)])
def test_particles_that_are_gaussians_know_what_they_know(law):
    """NEES per state on a linear problem, over 40 runs; without marginal weights it is 1.5 to 2.7."""
    runs, n, rng = 40, 4, np.random.default_rng(7)
    F = np.eye(n) + np.diag([0.1, 0.1, 0.0], 1)
    F[0, 3] = 0.05
    Q, sigma = np.diag([1e-3, 1e-2, 0.0, 0.0]), 0.2
    x, flt, found = rng.standard_normal((runs, n)), make_filter("hepf"), []
    b = flt.init(Gaussian(np.zeros((runs, n)), np.eye(n)), rng.spawn(runs))
    for _ in range(24):
        x = x @ F.T + np.sqrt(np.diagonal(Q)) * rng.standard_normal((runs, n))
        factor = 1.0 if law is None else np.where(rng.random((runs, 1)) < law.share, math.sqrt(law.factor), 1.0)
        z = x[:, :1] + sigma * factor * rng.standard_normal((runs, 1))
        b, _ = flt.step(b, Transition(Linear(F), Q), Measurement(z, Linear(np.eye(1, n)), sigma**2 * np.eye(1), law))
        e = x - flt.estimate(b).mean
        found.append((e * np.linalg.solve(flt.estimate(b).cov, e[..., None])[..., 0]).sum(axis=-1) / n)
    assert abs(np.mean(found[-6:]) - 1.0) < 3.0 * math.sqrt(2.0 / (runs * n))
