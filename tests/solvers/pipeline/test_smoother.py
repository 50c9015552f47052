"""The smoothed navigation: the dense posterior, NEES and RMS over runs, first fixes that differ, and what is refused."""

import gymnasium
import numpy as np
import pytest
from oracles.dense_navigation import Posterior, apart
from scipy import stats

import sins_env  # noqa: F401
import solvers
from sins_env import attitude, earth
from sins_env.types import NavState
from solvers.pipeline.errors.navigation import STATES, NavigationErrors

FLIGHT = "SINS/NavFlight-v0"
QUICK = {"profile": "lu-gauss", "duration": 20.0}
FIX = ("gps_vel", "gps_pos", "gps_valid")


def play(env, smoother, seed, spoil=None):
    """Observations, true states and the smoothed track of an episode; ``spoil(k, obs)`` may change observations."""
    obs, _ = env.reset(seed=seed)
    runs = getattr(env.unwrapped, "num_envs", 1)
    smoother.reset(env.unwrapped.task, [np.random.default_rng(i) for i in range(runs)], runs)
    seen, truth, over = [], [], False
    while not over:
        obs = {key: np.array(value) for key, value in obs.items()}
        if spoil:
            spoil(len(seen) + 1, obs)
        seen.append(obs)
        obs, _, _, done, info = env.step(smoother.step(obs))
        truth.append(info["truth"])
        over = np.all(done)
    truth = NavState(*(np.array([one[key] for one in truth]) for key in NavState._fields))
    return seen, truth, smoother.smoothed()


def outage(first, last):
    def spoil(k, obs):
        if first <= k <= last:
            for key in FIX:
                obs[key][...] = 0

    return spoil


def off_the_posterior(solver, scale):
    """Largest differences of smoothed means and covariances from the dense posterior, in its standard deviations.

    Noise, biases and start are ``scale`` times those of a poor IMU; six of twenty fixes are missing, and there is a lever arm.
    """
    imu = {"arw_deg_sqrt_h": 0.1, "gyro_bias_deg_h": 20.0, "accel_bias_ug": 1000.0, "vrw_ug_sqrt_hz": 100.0}
    env = gymnasium.make(
        FLIGHT,
        reveal_truth=True,
        profile="lu-gauss",
        duration=20.0,
        epoch=1.0,
        n_sub=6,
        imu={"preset": "tactical", **{name: scale * value for name, value in imu.items()}},
        gps={"vel_std_mps": 0.1 * scale, "pos_std_m": 3.0 * scale, "rate_hz": 1.0, "lever_arm_m": (1.0, 2.0, 0.5)},
        attitude_std_deg=(scale, scale, 4.0 * scale),
        velocity_std_mps=0.5 * scale,
        position_std_m=5.0 * scale,
    )
    seen, _, found = play(env, solvers.Smoother(solvers.make(solver)), 5, outage(8, 13))
    task, track, nothing = env.unwrapped.task, found.smoothed, np.full(3, np.nan)
    Q = NavigationErrors().noise(task.prior) * np.outer(STATES.si, STATES.si)
    dense = Posterior(
        task,
        task.start,
        [obs["dtheta"] for obs in seen],
        [obs["dvel"] for obs in seen],
        [(obs["gps_vel"], obs["gps_pos"]) if obs["gps_valid"] else (nothing, nothing) for obs in seen],
        Q + np.diag(np.repeat([0.0, 0.0, 0.0, 1e-22, 1e-18], 3)),  # it inverts Q
    )
    model, mean, cov = earth.get(task.site.earth), [], []
    for k in range(20):
        P = dense.cov[k + 1]
        sigma = np.sqrt(np.diagonal(P))
        bias = np.concatenate([track.gyro_bias[k], track.accel_bias[k]]) - dense.bias[k + 1]
        state = apart(model, NavState(*(part[k] for part in track.nav)), dense.navs[k + 1])
        mean.append(np.concatenate([state, bias]) / sigma)
        cov.append((track.cov[k] - P) / np.outer(sigma, sigma))
    return np.abs(mean).max(), np.abs(cov).max()


@pytest.mark.parametrize("solver", ["ekf", "inekf", "eqf"])
def test_it_is_the_posterior_of_the_whole_navigation_to_second_order(solver):
    """A quarter of the errors has a sixteenth of the difference in the mean, hence a quarter of it in standard deviations.

    Epochs of a second leave .9 % in the covariance, because the filter's map of errors is of second order in the epoch.
    """
    (mean, cov), (less, cov_less) = off_the_posterior(solver, 0.25), off_the_posterior(solver, 0.0625)
    assert mean < 0.15
    assert less < 0.3 * mean
    assert cov < 0.07
    assert cov_less < 0.011


@pytest.mark.parametrize(
    ("env_id", "solver", "settings"),
    [
        (FLIGHT, "ekf", {}),
        (FLIGHT, "inekf", {}),
        (FLIGHT, "ckf", {"feedback": "open"}),
        ("SINS/AlignSway-v0", "ckf", {"feedback": "closed"}),
        ("SINS/AlignSway-v0", "inekf", {}),
    ],
)
def test_forty_runs_have_the_errors_that_their_covariance_tells(env_id, solver, settings):
    """With an outage of a quarter of the time: NEES in its 99.9 % band early, in the outage and late; RMS below the filter's."""
    navigates = env_id == FLIGHT
    kwargs = QUICK if navigates else {"duration": 60.0, "epoch": 0.3, "n_sub": 9, "gps": {"rate_hz": 1 / 0.3}}
    env = gymnasium.make_vec(env_id, num_envs=40, reveal_truth=True, **kwargs)
    smoother = solvers.Smoother(solvers.make(solver, **settings))
    _, truth, found = play(env, smoother, 17, outage(60, 110))
    states, n = found.smoothed.states, 9 if navigates else 3
    here = states.span("phi", "dv", "dp") if navigates else states["phi"]
    errors = []
    for track in (found.smoothed, found.filtered):
        assert len(track.t) == 200
        error = attitude.misalignment(track.nav.q_nb, truth.q_nb)
        if navigates:
            error = apart(earth.get(env.unwrapped.task.site.earth), track.nav, truth)
        errors.append(error)
    smoothed, P = errors[0], found.smoothed.cov[..., here, here]
    nees = (smoothed * np.linalg.solve(P, smoothed[..., None])[..., 0]).sum(axis=-1).mean(axis=1)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 40 * n) / 40
    for k in (0, 30, 85, 150, 199):
        assert low < nees[k] < high
    np.testing.assert_allclose(smoothed[-1], errors[1][-1], atol=1e-12)  # the last one is the filter's
    np.testing.assert_allclose(P[-1], smoother.covariance(), rtol=1e-9, atol=1e-18)
    weight = 1.0 / found.filtered.cov[..., here, here].diagonal(axis1=-2, axis2=-1)
    rms, filtered = (np.sqrt((weight * error**2).mean(axis=(1, 2))) for error in errors)
    away = slice(0, 180)
    assert (rms[away] < filtered[away]).all()
    assert rms[85] < 0.7 * filtered[85]  # amid the outage


def test_runs_that_begin_at_different_first_fixes():
    """In a batch as alone, NaN before; the log of an own recording is played epoch by epoch."""
    env = gymnasium.make_vec("SINS/AlignSway-v0", num_envs=2, start="unknown", coarse=0.0, duration=6.0, n_sub=3)
    obs, _ = env.reset(seed=3)
    seen, task, first = [], env.unwrapped.task, (3, 8)
    for k in range(1, 21):
        seen.append({key: np.array(value) for key, value in obs.items()})
        for run, begin in enumerate(first):
            seen[-1]["gps_valid"][run] &= k >= begin
        obs, *_ = env.step(np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)))

    def track(rows, runs):
        smoother = solvers.Smoother(solvers.make("inekf"))
        rngs = [np.random.default_rng(run) for run in range(runs)]
        smoother.reset(task, rngs if runs > 1 else rngs[0], runs)
        for obs in seen:
            smoother.step({key: value[rows] for key, value in obs.items()})
        return smoother.smoothed().smoothed

    both = track(slice(None), 2)
    for run, begin in enumerate(first):
        one = track(run, 1)
        assert np.isnan(both.cov[: begin - 1, run]).all()
        assert np.isnan(both.nav.q_nb[: begin - 1, run]).all()
        for a, b in ((both.nav.q_nb, one.nav.q_nb), (both.cov, one.cov), (both.gyro_bias, one.gyro_bias)):
            assert np.isfinite(a[begin - 1 :, run]).all()
            np.testing.assert_allclose(a[begin - 1 :, run], b[begin - 1 :], rtol=1e-6, atol=1e-12)


def test_an_episode_in_one_call():
    """Single and as a row of a vector; after a coarse phase the track begins with its last epoch."""
    settings = {"profile": "sun2012", "duration": 6.0, "start": "unknown", "coarse": 4.0}
    rows = solvers.smooth_navigation(solvers.make("ekf"), gymnasium.make_vec(FLIGHT, num_envs=2, **settings), seed=1)
    one = solvers.smooth_navigation(solvers.make("ekf"), gymnasium.make(FLIGHT, **settings), seed=2)
    np.testing.assert_allclose(one.smoothed.t, 4.0 + 0.1 * np.arange(21))
    np.testing.assert_allclose(rows.smoothed.nav.vel[:, 1], one.smoothed.nav.vel, atol=1e-9)
    np.testing.assert_allclose(rows.filtered.cov[:, 1], one.filtered.cov, rtol=1e-6, atol=1e-15)
    assert repr(one.smoothed) == "<Track of 21 epochs, 15 states>"


def test_what_cannot_be_smoothed_is_refused():
    with pytest.raises(ValueError, match="GSFEKF cannot be smoothed; allowed: filters with one Gaussian"):
        solvers.Smoother(solvers.make("gsf_ekf"))
    with pytest.raises(ValueError, match=r"TwoPassFilter cannot be smoothed"):
        solvers.Smoother(solvers.make("two_pass"))
    with pytest.raises(ValueError, match=r"cannot be smoothed; allowed: a pipeline around a filter, such as"):
        solvers.Smoother(solvers.make("coarse_oba"))
    with pytest.raises(RuntimeError, match="nothing to smooth yet"):
        solvers.Smoother(solvers.make("ekf")).smoothed()
