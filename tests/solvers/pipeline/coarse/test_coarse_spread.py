"""The covariance that a coarse method tells: its slopes against the method itself, NEES over runs, and the prior made of it."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from scipy import stats

import sins_env  # noqa: F401
import solvers
from sins_env import attitude
from sins_env.states import ERRORS
from solvers.pipeline import coarse
from solvers.pipeline.coarse.spread import PHI, Spread, told_by

SHORT = {"start": "unknown", "coarse": 30.0, "duration": 95.0, "n_sub": 3}
STATIC = ("SINS/AlignStatic-v0", {"imu": "rlg-car", "gps": {"vel_std_mps": 0.03, "rate_hz": 10}})
SWAY = ("SINS/AlignSway-v0", {"gps": {"outages_s": [[8.0, 12.0]]}})
QUIET = {"imu": "perfect", "gps": "perfect"}


def coarse_phase(env_id, runs, **settings):
    """The task, all observations of the coarse phase, and the true attitudes at its end."""
    env = gymnasium.make_vec(env_id, num_envs=runs, reveal_truth=True, **{**SHORT, **settings})
    obs, _ = env.reset(seed=3)
    seen, task = [], env.unwrapped.task
    for _ in range(round(task.coarse_s / task.epoch_s)):
        seen.append({key: value.copy() for key, value in obs.items()})
        obs, _, _, _, info = env.step(np.tile([1.0, 0.0, 0.0, 0.0], (runs, 1)))
    return task, seen, info["truth"]["q_nb"]


def found(method, task, seen):
    runs = seen[0]["t"].shape[:-1]
    estimator = coarse.start(method, task, runs)
    for obs in seen:
        estimator.add(obs)
    return estimator.attitude(), estimator.spread()


@pytest.mark.parametrize(
    ("env_id", "method"),
    [("SINS/AlignStatic-v0", f"analytic{form}") for form in (1, 2, 3)] + [("SINS/AlignSway-v0", "aided")],
)
def test_what_a_bias_does_is_what_the_method_makes_of_it(env_id, method):
    """One bias a run, differenced; on the swaying base the attitude turns through degrees meanwhile."""
    task, seen, _ = coarse_phase(env_id, 1, **QUIET)
    gyro, accel = 1e-9, 1e-6  # rad/s, m/s^2
    per_sample = task.epoch_s / task.n_sub
    bias = np.zeros((2, 7, 1, 3))
    bias[0, 1:4, 0], bias[1, 4:, 0] = gyro * per_sample * np.eye(3), accel * per_sample * np.eye(3)
    for obs in seen:
        for key in obs:
            obs[key] = np.repeat(obs[key], 7, axis=0)
        obs["dtheta"], obs["dvel"] = obs["dtheta"] + bias[0], obs["dvel"] + bias[1]
    q_nb, spread = found(method, task, seen)
    phi = attitude.misalignment(q_nb, np.broadcast_to(q_nb[0], q_nb.shape))
    for slope, change in ((spread.gyro, phi[1:4].T / gyro), (spread.accel, phi[4:].T / accel)):
        for found_row, row in zip(slope[0], change, strict=True):
            np.testing.assert_allclose(found_row, row, atol=0.01 * np.abs(row).max() + 1e-6 * np.abs(change).max())


@pytest.mark.parametrize(
    ("world", "method"),
    [(SWAY, "aided"), (SWAY, "oba"), (STATIC, "aided"), (STATIC, "analytic3"), (STATIC, "analytic1")],
)
def test_a_hundred_runs_are_as_far_off_as_they_are_told(world, method):
    """NEES of three angles in its 99.9 % band, and for the heading alone."""
    env_id, settings = world
    task, seen, truth = coarse_phase(env_id, 100, **settings)
    q_nb, spread = found(method, task, seen)
    P = told_by(spread, task.prior)[:, PHI, PHI]
    phi = attitude.misalignment(q_nb, truth)
    nees = (phi * np.linalg.solve(P, phi[..., None])[..., 0]).sum(axis=-1)
    for value, n in ((nees, 3), (phi[:, 2] ** 2 / P[:, 2, 2], 1)):
        low, high = stats.chi2.ppf([0.0005, 0.9995], 100 * n) / 100
        assert low < value.mean() < high


def test_the_prior_made_of_a_spread():
    """Blocks by hand, biases in n, and a heading that may be anything."""
    task, rng = coarse_phase("SINS/AlignStatic-v0", 1)[0], np.random.default_rng(1)
    gyro, accel, q_nb = rng.standard_normal((3, 3)), 1e-3 * rng.standard_normal((3, 3)), np.array([0.5, 0.5, -0.5, 0.5])
    told, C = task.prior.P0, attitude.to_dcm(q_nb)
    P0 = told_by(Spread(gyro, accel, 1e-9 * np.eye(3)), task.prior)
    J = np.hstack([gyro, accel])
    biases = slice(ERRORS["gyro_bias"].start, None)
    np.testing.assert_allclose(P0[PHI, PHI], J @ told[biases, biases] @ J.T + 1e-9 * np.eye(3), rtol=1e-12)
    np.testing.assert_allclose(P0[PHI, biases], J @ told[biases, biases], rtol=1e-12)
    np.testing.assert_array_equal(P0[3:, 3:], told[3:, 3:])
    np.testing.assert_array_equal(P0, P0.T)
    in_n = told_by(Spread(gyro, accel, 1e-9 * np.eye(3)), task.prior, q_nb)
    turned = np.hstack([gyro @ C.T, accel @ C.T]) @ told[biases, biases]
    np.testing.assert_allclose(in_n[PHI, biases], turned, rtol=1e-12)
    far = told_by(Spread(1e9 * gyro, accel, 1e-9 * np.eye(3)), task.prior)
    assert np.degrees(np.sqrt(far[2, 2])) == pytest.approx(180.0 / np.sqrt(3.0))
    assert np.linalg.eigvalsh(far / np.sqrt(np.outer(far.diagonal(), far.diagonal()))).min() > -1e-12


@pytest.mark.parametrize("settings", [{}, {"coordinates": "invariant"}, {"bias_frame": "nav"}, {"coarse": "svd"}])
def test_the_fine_phase_begins_with_it(settings):
    """Unless the task tells the spread, or the method knows none."""
    task, seen, _ = coarse_phase("SINS/AlignSway-v0", 2)
    assert not task.coarse_told
    covariances = []
    for told in (False, True):
        estimator = solvers.make("ekf", **settings)
        estimator.reset(dataclasses.replace(task, coarse_told=told), [np.random.default_rng(i) for i in range(2)], 2)
        for obs in seen:
            estimator.step(obs)
        covariances.append(estimator.covariance())
    np.testing.assert_allclose(covariances[1], np.broadcast_to(task.prior.P0[:3, :3], (2, 3, 3)), rtol=1e-9, atol=1e-20)
    known = found(settings.get("coarse", "aided"), task, seen)[1]
    expected = covariances[1] if known is None else told_by(known, task.prior)[:, PHI, PHI]
    assert (known is None) == (settings.get("coarse") == "svd")
    np.testing.assert_allclose(covariances[0], expected, rtol=1e-9, atol=1e-20)
