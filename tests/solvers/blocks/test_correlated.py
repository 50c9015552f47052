"""Noise that a transition and a measurement share: against the gain that knows it, and a base that stands still."""

import gymnasium
import numpy as np
import pytest
from oracles.zoo import generators

import sins_env  # noqa: F401
import solvers
from solvers.blocks.correlated import independent
from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition


def test_one_axis_with_a_zero_rate_is_the_update_that_knows_the_shared_noise():
    """Heading and bias of a tactical gyro over 60 s: the covariances agree, and so do the estimates.

    A heading that is known at the stop stays known. Taken as independent, the same readings claim 59" after 60 s.
    """
    deg, T = np.pi / 180, 0.1
    noise, bias = 0.1 * deg / 60, deg / 3600
    vw = noise**2 / T
    F, H, Q, R = np.array([[1.0, -T], [0.0, 1.0]]), np.array([[0.0, 1.0]]), np.diag([T * T * vw, 0.0]), np.array([[vw]])
    M = np.array([[-T * vw], [0.0]])
    rng, made = np.random.default_rng(0), make_filter("kf")
    P, x = np.diag([(1e-9) ** 2, bias**2]), np.zeros(2)
    prior = Gaussian(np.zeros((1, 2)), P[None])
    belief, apart = made.init(prior, None), made.init(prior, None)
    for _ in range(600):
        z = bias + np.sqrt(vw) * rng.standard_normal((1, 1))
        x, P = F @ x, F @ P @ F.T + Q
        S = H @ P @ H.T + H @ M + M.T @ H.T + R
        K = (P @ H.T + M) / S
        x, P = x + K @ (z[0] - H @ x), P - K @ S @ K.T
        tr, me = Transition(Linear(F), Q), Measurement(z, Linear(H), R)
        belief, _ = made.step(belief, independent(tr, me, M), me)
        apart, _ = made.step(apart, tr, me)
    now = made.estimate(belief)
    np.testing.assert_allclose(now.mean[0], x, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(now.cov[0, 1, 1], P[1, 1], rtol=1e-6)
    assert np.sqrt(now.cov[0, 0, 0]) < 0.01 * deg / 3600
    assert np.sqrt(now.cov[0, 1, 1]) == pytest.approx(0.61 * deg / 3600, rel=0.02)
    assert np.sqrt(made.estimate(apart).cov[0, 0, 0]) * 3600 / deg == pytest.approx(59, rel=0.05)


def stand(name, runs=8, **settings):
    """Heading errors (runs,) in arcsec after 60 s at rest with a tactical IMU, and their claimed deviations."""
    prior = {"attitude_std_deg": [0.1, 0.1, 0.05]}
    env = gymnasium.make_vec(
        "SINS/AlignStatic-v0", num_envs=runs, epoch=0.5, n_sub=2, duration=60.0, imu="tactical",
        gps={"rate_hz": 2.0, "vel_std_mps": 0.05}, **prior,
    )  # fmt: skip
    obs, _ = env.reset(seed=1)
    made = solvers.make(name, stillness=True, **settings)
    made.reset(env.unwrapped.task, generators((runs,)), runs)
    begin = None
    for k in range(120):
        obs, _, _, _, info = env.step(made.step(obs))
        if k == 20:
            begin = info["errors"]["phi"][:, 2]
    deviation = np.sqrt(made.covariance()[:, 2, 2])
    return info["errors"]["phi"][:, 2] * 206265, deviation * 206265, begin * 206265, made.diagnostics()


@pytest.mark.parametrize("name", ["ckf", "ekf", "inekf"])
def test_the_heading_stays_where_it_stands(name):
    """Whatever the filter: it moves by a tenth of what the gyros' noise turns it without a zero rate, and the covariance holds."""
    error, deviation, begin, found = stand(name, zero_rate=True)
    free, wide, start, _ = stand(name)
    assert np.std(error - begin) < 0.3 * np.std(free - start)
    assert (deviation < wide).all()
    assert 0.15 < np.mean(np.square(error / deviation)) < 2.8
    assert found["zero_rate_nis"].shape == (8,)
    assert found["zero_rate_nis"].mean() < 8.0


def test_settings():
    with pytest.raises(ValueError, match="zero_rate = True with stillness = False"):
        solvers.make("ekf", zero_rate=True)
    with pytest.raises(ValueError, match="zero_rate = True with bias_frame = 'nav'"):
        solvers.make("ekf", zero_rate=True, stillness=True, bias_frame="nav")
