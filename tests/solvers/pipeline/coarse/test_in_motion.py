"""Alignment in motion: exact without noise, the fit against dense least squares, its spread, and the choice from the data."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import sins_env  # noqa: F401
import solvers
from sins_env import attitude
from sins_env.types import NavState
from solvers.pipeline import coarse
from solvers.pipeline.coarse.fits import by_svd
from solvers.pipeline.coarse.motion import Sums
from solvers.pipeline.coarse.spread import PHI, told_by

EXACT = {
    "imu": "perfect",
    "gps": {"preset": "perfect", "rate_hz": 1.0},
    "aids": {"dvl": {"noise_mps": 0.0, "scale_ppm": 0.0, "mounting_mrad": 0.0}},
}
STRAIGHT = {
    "latitude_deg": 40.0,
    "longitude_deg": 10.0,
    "speed_mps": 15.0,
    "heading_deg": 200.0,
    "segments": [{"duration_s": 300.0}],
}
RUNS = 40
METHODS = ("motion_velocity", "motion_position", "motion_body")


def drive(runs, seconds, env_id="SINS/NavFlight-v0", **settings):
    """The task, the observations of a coarse phase, and the true attitudes at its end."""
    settings = {"duration": seconds + 1.0, "n_sub": 10, "start": "unknown", "coarse": seconds, **settings}
    env = gymnasium.make_vec(env_id, num_envs=runs, reveal_truth=True, **settings)
    obs, _ = env.reset(seed=3)
    task, seen = env.unwrapped.task, []
    for _ in range(round(seconds / task.epoch_s)):
        seen.append({key: value.copy() for key, value in obs.items()})
        obs, _, _, _, info = env.step(np.tile(np.eye(10 if task.navigate else 4)[0], (runs, 1)))
    return task, seen, info["truth"]["q_nb"]


def found(method, task, seen):
    estimator = coarse.start(method, task, seen[0]["t"].shape[:-1])
    for obs in seen:
        estimator.add(obs)
    return estimator


def steps(solver, seen):
    """The answers of a solver."""
    return [solver.step(obs) for obs in seen]


def test_exact_without_noise():
    """A car that is never at rest and a lever arm: what the truth integrates, the methods find."""
    task, seen, truth = drive(1, 30.0, profile="car", **EXACT)
    for method in METHODS:
        phi = attitude.misalignment(found(method, task, seen).attitude(), truth)
        assert np.abs(phi).max() < 1e-6, method


def test_fixes_before_the_end_of_their_epoch():
    """Each is compared at its own time: without noise the heading is as good as the interpolation."""
    task, seen, truth = drive(1, 20.0, profile="car", **{**EXACT, "gps": {**EXACT["gps"], "age_s": 0.06}})
    for method in METHODS[:2]:
        estimator = found(method, task, seen)
        assert np.abs(attitude.misalignment(estimator.attitude(), truth)).max() < 1e-3, method


def test_the_velocity_of_positions():
    """Without velocities of fixes it follows from the line that the pairs leave."""
    task, seen, truth = drive(1, 20.0, profile="car", **EXACT)
    nav = found("motion_position", task, seen).state(NavState(truth, np.full((1, 3), 99.0), seen[-1]["gps_pos"]))
    np.testing.assert_allclose(nav.vel, seen[-1]["gps_vel"], atol=1e-3)


@pytest.mark.parametrize("degree", [0, 1])
def test_the_fit_is_that_of_dense_least_squares(degree):
    """Rotation and polynomials as free parameters, from starts all around; one of the pairs does not count."""
    rng = np.random.default_rng(degree)
    true, v = Rotation.from_rotvec([0.3, -0.5, 2.0]).as_matrix(), rng.standard_normal((12, 3))
    t, valid = 7.0 * np.arange(12.0), np.arange(12) != 5
    u = (
        v @ true.T
        + 1e3 * np.vander(t / 60.0, 2)[:, [1, 0][: degree + 1]].sum(axis=1)[:, None]
        + 0.3 * rng.standard_normal((12, 3))
    )
    sums = Sums(degree, ())
    for at, a, b, there in zip(t, u, v, valid, strict=True):
        sums.add(at, a, b, np.array([there]))

    def residual(x):
        fit = v @ Rotation.from_rotvec(x[:3]).as_matrix().T + np.vander(t / 60.0, degree + 1) @ x[3:].reshape(-1, 3)
        return (u - fit)[valid].ravel()

    starts = [np.concatenate([one, np.zeros(3 * (degree + 1))]) for one in 2.0 * rng.standard_normal((8, 3))]
    best = min((least_squares(residual, x, xtol=1e-14, ftol=1e-14) for x in starts), key=lambda one: one.cost)
    np.testing.assert_allclose(by_svd(sums.profile()), Rotation.from_rotvec(best.x[:3]).as_matrix(), atol=1e-6)


def test_what_a_bias_does_is_what_the_methods_make_of_it():
    """One bias a run, differenced; to a fifth for the body velocity, which turns into n by the attitude that it leads to."""
    task, seen, _ = drive(1, 20.0, profile="car", **EXACT)
    gyro, accel, per_sample = 1e-9, 1e-6, task.epoch_s / task.n_sub
    bias = np.zeros((2, 7, 1, 3))
    bias[0, 1:4, 0], bias[1, 4:, 0] = gyro * per_sample * np.eye(3), accel * per_sample * np.eye(3)
    seen = [{key: np.repeat(value, 7, axis=0) for key, value in obs.items()} for obs in seen]
    for obs in seen:
        obs["dtheta"], obs["dvel"] = obs["dtheta"] + bias[0], obs["dvel"] + bias[1]
    for method, share in zip(METHODS, (0.02, 0.02, 0.2), strict=True):
        estimator = found(method, task, seen)
        q_nb, spread = estimator.attitude(), estimator.spread()
        phi = attitude.misalignment(q_nb, np.broadcast_to(q_nb[0], q_nb.shape))
        for slope, change in ((spread.gyro, phi[1:4].T / gyro), (spread.accel, phi[4:].T / accel)):
            np.testing.assert_allclose(slope[0], change, atol=share * np.abs(change).max())


@pytest.mark.parametrize(
    ("method", "seconds", "settings"),
    [
        ("motion_velocity", 20.0, {}),
        ("motion_velocity", 20.0, {"imu": "mems"}),
        ("motion_position", 40.0, {}),
        ("motion_body", 60.0, {"imu": "navigation", "aids": {"dvl": "water"}}),
    ],
)
def test_runs_are_as_far_off_as_they_are_told(method, seconds, settings):
    """The square of the heading's error over its told variance, in its 99.9 % band."""
    task, seen, truth = drive(RUNS, seconds, profile="car", **{"n_sub": 2, **settings})
    estimator = found(method, task, seen)
    phi = attitude.misalignment(estimator.attitude(), truth)
    P = told_by(estimator.spread(), task.prior)[:, PHI, PHI]
    low, high = stats.chi2.ppf([0.0005, 0.9995], RUNS) / RUNS
    assert low < np.mean(phi[:, 2] ** 2 / P[:, 2, 2]) < high


def test_the_data_choose_the_method():
    """A car that drives, and one that is parked: each run as if the method had been named, and alone as in a batch."""
    drives, parks = (
        drive(1, 20.0, profile=profile, imu="tactical", gps={"vel_std_mps": 0.1, "pos_std_m": 3.0, "rate_hz": 1.0})
        for profile in ("car", "sun2012")
    )
    task = dataclasses.replace(parks[0], coarse_s=19.0)
    assert not task.coarse_told
    both = [{key: np.concatenate([a[key], b[key]]) for key in a} for a, b in zip(drives[1], parks[1], strict=True)]

    def play(seen, **settings):
        solver = solvers.make("ckf", **settings)
        solver.reset(task, [np.random.default_rng(i) for i in range(len(seen[0]["t"]))], len(seen[0]["t"]))
        return np.array(steps(solver, seen)), solver.covariance()

    mixed, P = play(both)
    for row, (one, method) in enumerate([(drives, "motion_velocity"), (parks, "svd")]):
        for settings in ({}, {"coarse": method}):
            alone, own = play(one[1], **settings)
            np.testing.assert_allclose(alone[189:, 0], mixed[189:, row], rtol=1e-9, atol=1e-11)
            np.testing.assert_allclose(own[0], P[row], rtol=1e-6, atol=1e-16)
    assert np.degrees(np.abs(attitude.misalignment(mixed[-1, :1, :4], drives[2])[0, 2])) < 2.0


@pytest.mark.parametrize(
    "gps", [{}, {"velocity": False, "pos_std_m": 0.5}, {"age_s": 0.08, "vel_std_mps": 0.05}], ids=str
)
def test_a_single_filter_aligns_in_motion_by_itself(gps):
    """Without a coarse phase: it begins when the heading is known, and its covariance holds from the first epoch on."""
    task, seen, truth = drive(20, 26.0, profile="car", coarse=0.0, gps=gps)
    solver = solvers.make("ckf")
    solver.reset(task, [np.random.default_rng(i) for i in range(20)], 20)
    answers = steps(solver, seen)
    heading = attitude.misalignment(answers[-1][:, :4], truth)[:, 2]
    ratio = heading**2 / solver.covariance()[:, 2, 2]
    assert np.degrees(np.abs(heading)).max() < 4.0
    assert np.mean(ratio) < stats.chi2.ppf(0.9995, 20) / 20


def test_a_drive_without_a_manoeuvre_says_that_its_heading_is_unknown():
    task, seen, _ = drive(2, 40.0, profile=STRAIGHT, imu="tactical")
    solver = solvers.make("ckf")
    solver.reset(dataclasses.replace(task, coarse_s=30.0), [np.random.default_rng(i) for i in range(2)], 2)
    with pytest.warns(RuntimeWarning, match="coarse phase, 30 s: the velocity of the base changes too little"):
        steps(solver, seen)
    assert np.degrees(np.sqrt(solver.covariance()[:, 2, 2])).min() > 100.0


def test_motion_that_nothing_shows_is_said():
    """A drive whose fixes claim a base at rest."""
    task, seen, _ = drive(2, 20.0, profile="car")
    solver = solvers.make("ckf")
    solver.reset(dataclasses.replace(task, coarse_s=15.0), [np.random.default_rng(i) for i in range(2)], 2)
    with pytest.warns(RuntimeWarning, match="neither rest nor any velocity that is measured explains"):
        steps(
            solver,
            [{**obs, "gps_vel": 0.0 * obs["gps_vel"], "gps_pos": task.site.pos + np.zeros((2, 3))} for obs in seen],
        )
    assert np.degrees(np.sqrt(solver.covariance()[:, 2, 2])).min() > 100.0


def test_a_base_that_sways_is_aligned_with_the_velocities_of_its_fixes():
    """In navigation, where the usual method takes a base to be at rest."""
    task, seen, _ = drive(4, 60.0, "SINS/AlignSway-v0", gps={"vel_std_mps": 0.01, "pos_std_m": 1.0}, n_sub=3)
    solver = solvers.make("ckf")
    solver.reset(dataclasses.replace(task, navigate=True), [np.random.default_rng(i) for i in range(4)], 4)
    answers = steps(solver, seen)
    named = found("motion_velocity", task, seen)
    np.testing.assert_allclose(answers[-1][:, :4], named.attitude(), atol=1e-12)


def test_what_no_pair_shows_is_not_told():
    """Two fixes give one direction, about which the attitude may be anything."""
    task, seen, _ = drive(1, 2.5, profile="car")
    estimator = found("motion_velocity", task, seen)
    P = told_by(estimator.spread(), task.prior)[0, PHI, PHI]
    assert np.degrees(np.sqrt(P[2, 2])) > 100.0


def test_a_body_velocity_needs_its_sensor():
    task, seen, _ = drive(1, 1.0, profile="car")
    with pytest.raises(ValueError, match='whose aids show no velocity along the body; allowed: with aids "dvl"'):
        found("motion_body", task, seen)
