"""The navigator: consistency on a flight, closed and open loop, missing fixes, lever arm, and every filter of the zoo."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from oracles.zoo import generators, is_batched, settings_of
from scipy import stats

import sins_env  # noqa: F401
import solvers
from sins_env import attitude, earth
from solvers.blocks.sigma_rules import points
from solvers.filters import names
from solvers.pipeline.aiding.aid import Ins
from solvers.pipeline.aiding.gps import Gps
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.estimator import Navigator
from solvers.types import Gaussian

FLIGHT = "SINS/NavFlight-v0"
QUICK = {"profile": "lu-gauss", "duration": 10.0}  # 10 m/s and 2 m/s^2, fixes at 10 Hz


def fly(solver, runs, seed=1, spoil=None, settings=None, spoil_task=None, **kwargs):
    """Errors (epochs, runs, 9) in rad, m/s, m, and the navigator, after a flight; ``spoil(k, obs)`` may change observations."""
    env = gymnasium.make_vec(FLIGHT, num_envs=runs, **{**QUICK, **kwargs})
    obs, _ = env.reset(seed=seed)
    estimator = solvers.make(solver, **(settings or {}))
    task = env.unwrapped.task if spoil_task is None else spoil_task(env.unwrapped.task)
    estimator.reset(task, generators((runs,)), runs)
    errors, over = [], False
    while not over:
        if spoil:
            spoil(len(errors) + 1, obs)
        obs, _, _, done, info = env.step(estimator.step(obs))
        errors.append(np.concatenate([info["errors"][key] for key in ("phi", "vel", "pos")], axis=-1))
        over = done[0]
    return np.array(errors), estimator


def nees(error, P):
    return np.sum(error * np.linalg.solve(P, error[..., None])[..., 0], axis=-1)


@pytest.mark.parametrize("solver", ["ckf", "inekf"])
def test_errors_are_what_the_covariance_says(solver):
    """40 runs of the Gaussian profile after 20 s: NEES of 9 errors in its 99.9 % band, which no wrong sign survives."""
    errors, estimator = fly(solver, 40, seed=11, duration=20.0)
    P = estimator.covariance()
    assert P.shape == (40, 9, 9)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 9 * 40) / 40
    assert low < nees(errors[-1], P).mean() < high
    sigma = np.sqrt(np.diagonal(P, axis1=-2, axis2=-1)).mean(axis=0)
    assert np.all(sigma[3:6] < 0.1)  # m/s; a fix has 0.1
    assert np.all(sigma[6:9] < 2.0)  # m; a fix has 10 and 3
    assert np.all(estimator.health().failed_at == -1)


def test_before_the_first_fix_the_covariance_is_the_told_one():
    """A coarse phase tells P0 of the nine errors, in the order phi, velocity, position."""
    env = gymnasium.make_vec(FLIGHT, num_envs=2, profile="sun2012", duration=4.0, start="unknown", coarse=2.0)
    obs, _ = env.reset(seed=1)
    estimator = solvers.make("ekf")
    estimator.reset(env.unwrapped.task, None, 2)
    assert estimator.step(obs).shape == (2, 10)
    np.testing.assert_array_equal(estimator.covariance()[1], env.unwrapped.task.prior.P0[:9, :9])
    assert estimator.health() is None


@pytest.mark.parametrize("solver", ["ekf", "ckf"])
def test_closed_loop_agrees_with_open_loop(solver):
    """A degree of misalignment: the same filter with and without feedback, a twentieth of its sigma apart."""
    closed, estimator = fly(solver, 8)
    opened, open_estimator = fly(solver, 8, settings={"feedback": "open"})
    sigma = np.sqrt(np.diagonal(estimator.covariance(), axis1=-2, axis2=-1))
    assert (np.abs(closed[-1] - opened[-1]) / sigma).max() < 0.05
    np.testing.assert_allclose(open_estimator.covariance(), estimator.covariance(), rtol=0.05, atol=1e-6)
    running = estimator.running
    assert np.abs(running.filter.estimate(running.belief).mean).max() < 1e-9  # the INS has it all, biases too


def test_biases_go_into_the_increments():
    """The navigator's sum of the biases that it has fed back is the open loop's estimate of them."""
    _, closed = fly("ekf", 4)
    _, opened = fly("ekf", 4, settings={"feedback": "open"})
    x = opened.filter.estimate(opened.running.belief).mean
    gyro, accel = opened.running.errors.biases(x)
    dt = 0.1
    np.testing.assert_allclose(closed.running.bias[0] / dt, gyro, atol=0.03 * np.abs(gyro).max())
    np.testing.assert_allclose(closed.running.bias[1] / dt, accel, atol=0.03 * np.abs(accel).max())
    assert np.abs(gyro).max() > 0.0


@pytest.mark.parametrize("settings", [{}, {"feedback": "open"}, {"coordinates": "invariant"}])
def test_a_batch_is_its_runs(settings):
    """With fixes that miss in one run of the batch as they miss in that run alone."""

    def spoil(k, obs, row=slice(None)):
        if 20 < k <= 40:
            for key in ("gps_vel", "gps_pos", "gps_valid"):
                obs[key][row] = 0

    errors, estimator = fly("ekf", 3, seed=4, settings=settings, duration=6.0, spoil=lambda k, o: spoil(k, o, 1))
    for i in range(3):
        env = gymnasium.make(FLIGHT, **{**QUICK, "duration": 6.0})
        obs, _ = env.reset(seed=4 + i)
        one = solvers.make("ekf", **settings)
        one.reset(env.unwrapped.task, np.random.default_rng(i))
        for k in range(60):
            if i == 1:
                spoil(k + 1, obs)
            action = one.step(obs)
            assert action.shape == (10,)
            obs, _, _, _, info = env.step(action)
            found = np.concatenate([info["errors"][key] for key in ("phi", "vel", "pos")])
            np.testing.assert_allclose(found, errors[k, i], atol=1e-7)
        assert one.covariance().shape == (9, 9)
        np.testing.assert_allclose(one.covariance(), estimator.covariance()[i], rtol=1e-4, atol=1e-8)


def test_without_a_fix_it_predicts_and_says_so():
    def spoil(k, obs):
        if k > 50:
            for key in ("gps_vel", "gps_pos", "gps_valid"):
                obs[key][:] = 0

    errors, estimator = fly("ekf", 24, spoil=spoil)
    clean, sharp = fly("ekf", 24)
    wide, narrow = (np.sqrt(np.diagonal(e.covariance(), axis1=-2, axis2=-1)).mean(axis=0) for e in (estimator, sharp))
    assert np.all(wide[3:9] > narrow[3:9])
    np.testing.assert_array_equal(errors[:50], clean[:50])
    assert nees(errors[-1], estimator.covariance()).mean() < stats.chi2.ppf(0.9995, 9 * 24) / 24


@pytest.mark.parametrize("solver", ["ckf", "inekf"])
def test_a_run_with_a_broken_sensor_fails_alone(solver):
    def spoil(k, obs):
        if k == 15:
            obs["dvel"][2, 0] = np.nan

    errors, estimator = fly(solver, 4, spoil=spoil, duration=3.0)
    clean, _ = fly(solver, 4, duration=3.0)
    np.testing.assert_array_equal(errors[:, [0, 1, 3]], clean[:, [0, 1, 3]])
    assert estimator.health().failed_at.tolist() == [-1, -1, 15, -1]
    assert np.isfinite(estimator.covariance()[[0, 1, 3]]).all()


def test_a_lever_arm_is_taken_into_account():
    """Three metres of arm: told, the errors are what the covariance says; untold, the place is off by the arm."""
    arm = {"gps": {"lever_arm_m": [2.0, -1.0, 2.0], "vel_std_mps": 0.05, "pos_std_m": 0.5}, "duration": 20.0}
    told, estimator = fly("ekf", 24, **arm)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 9 * 24) / 24
    assert low < nees(told[-1], estimator.covariance()).mean() < high

    def forget(task):
        return dataclasses.replace(task, gps=dataclasses.replace(task.gps, lever_arm_m=(0.0, 0.0, 0.0)))

    untold, _ = fly("ekf", 24, spoil_task=forget, **arm)
    assert np.linalg.norm(untold[-1, :, 6:9].mean(axis=0)) > 2.5 > 5 * np.linalg.norm(told[-1, :, 6:9].mean(axis=0))


def test_the_antimeridian_is_no_border():
    """INS and fix on two sides of it are metres apart."""
    model = earth.get("wgs84")
    pos = np.array([0.6, np.pi - 1e-7, 300.0])
    env = gymnasium.make(FLIGHT, **QUICK)
    env.reset(seed=0)
    task = env.unwrapped.task
    start, over = task.start._replace(pos=pos), earth.displace(model, pos, np.array([5.0, 1.0, 2.0]))
    over[1] -= 2 * np.pi
    fix = {"gps_vel": start.vel, "gps_pos": over, "gps_valid": np.ones(1)}
    still = np.zeros((task.n_sub, 3))
    ins = Ins(start, start, still, None, task.epoch_s, np.zeros(3))
    measurement = Gps(task, NavigationErrors().states).read(fix, ins)
    np.testing.assert_allclose(measurement.z, [0, 0, 0, -5, -1, -2], atol=1e-4)


#: mpf has no covariance of its own to weigh a fix of 10 m with, and takes it nearly as it is
FOLLOWS_THE_FIXES = {"mpf": 5.0}


@pytest.mark.parametrize("name", names())
def test_every_filter_navigates(name):
    """By name and unchanged on 15 states: after 4 s with fixes at 10 Hz all runs stand and are near the truth."""
    runs = 4 if is_batched(name) else 1
    settings = settings_of(name)
    kwargs = {"profile": "lu-gauss", "duration": 4.0}
    if is_batched(name):
        errors, estimator = fly(name, runs, settings=settings, **kwargs)
    else:
        env = gymnasium.make(FLIGHT, **kwargs)
        obs, _ = env.reset(seed=1)
        estimator = solvers.make(name)
        estimator.reset(env.unwrapped.task, np.random.default_rng(0))
        for _ in range(40):
            obs, _, _, _, info = env.step(estimator.step(obs))
        errors = np.concatenate([info["errors"][key] for key in ("phi", "vel", "pos")])[None, None]
    assert np.all(estimator.health().failed_at == -1)
    rms = np.sqrt(np.mean(errors[-1] ** 2, axis=0))
    assert np.all(rms[3:6] < 0.3 * FOLLOWS_THE_FIXES.get(name, 1.0)), rms  # 0.05 for most; they start from 0.5 m/s
    assert np.all(rms[6:9] < 8.0 * FOLLOWS_THE_FIXES.get(name, 1.0)), rms  # they start from 10 m
    assert np.all(np.degrees(rms[:3]) < 3.0), rms  # they start from 1 deg
    P = estimator.covariance()
    assert np.all(np.diagonal(P, axis1=-2, axis2=-1) > 0.0)
    np.testing.assert_allclose(P, np.swapaxes(P, -1, -2))


def test_the_bank_finds_the_heading_among_fifteen_states():
    """gsf_ekf cuts the angle that is least known: state 2, the azimuth; also of a rotation vector below half a turn."""
    for coordinates in ("euler", "invariant"):
        settings = {"coordinates": coordinates}
        _, estimator = fly("gsf_ekf", 2, profile="hotstart60", duration=2.0, settings=settings)
        np.testing.assert_array_equal(estimator.running.belief.axis, 2)
        assert estimator.diagnostics()["components"].min() > 8
        assert np.all(estimator.health().failed_at == -1)


def test_a_bank_takes_invariant_coordinates():
    """Uncut it is the invariant filter."""
    one, bank = fly("gsf_ekf", 4, settings={"coordinates": "invariant", "spacing_deg": 360.0}, duration=3.0)
    np.testing.assert_allclose(one, fly("inekf", 4, duration=3.0)[0], rtol=1e-9, atol=1e-12)
    assert np.all(bank.health().failed_at == -1)


def test_tilts_of_twenty_degrees_rule_no_slice_out():
    """Coordinates in which a slice's tangent is exact, by default where it navigates; in Euler angles the true ones are lost."""
    for coordinates, found in ((None, True), ("euler", False)):
        settings = {} if coordinates is None else {"coordinates": coordinates}
        errors, _ = fly("gsf_ekf", 6, seed=9008, profile="hotstart90", duration=40.0, settings=settings)
        assert (np.degrees(np.abs(errors[-1, :, 2]).max()) < 2.0) == found
    assert solvers.make("gsf_ekf").aligner.settings.coordinates == "euler"


def test_a_fifth_degree_rule_on_fifteen_states_counts_its_fallbacks():
    """451 points, those on the axes of negative weight: where the covariance they give is indefinite, it is repaired."""
    assert len(points(solvers.filters.make_filter("ckf5").rule.rule, 15).xi) == 451
    _, estimator = fly("ckf5", 4, profile="hotstart90", duration=3.0)
    health = estimator.health()
    assert np.all(health.failed_at == -1)
    assert (health.repairs + health.fallbacks).sum() > 0


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("ckf", {"model": "thesis"}, "model = 'thesis' is of alignment"),
        ("ckf", {"bias_frame": "nav"}, "bias_frame = 'nav' is of alignment"),
        ("coarse_inertial", {}, "a coarse alignment gives the attitude alone"),
        ("two_pass", {}, "gives the attitude alone"),
    ],
)
def test_what_cannot_navigate_says_so(name, settings, message):
    env = gymnasium.make(FLIGHT, **QUICK)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        solvers.make(name, **settings).reset(env.unwrapped.task, np.random.default_rng(0))


def test_unknown_coordinates_offer_the_nearest():
    with pytest.raises(ValueError, match="invariant"):
        solvers.make("ckf", coordinates="invarant")
    with pytest.raises(ValueError, match="in invariant coordinates"):
        solvers.make("ckf", coordinates="invariant", model="thesis")


def test_the_answer_is_the_state():
    nav = Navigator(solvers.filters.make_filter("ekf"))
    env = gymnasium.make(FLIGHT, **QUICK)
    obs, _ = env.reset(seed=0)
    nav.reset(env.unwrapped.task, None)
    action = nav.step(obs)
    np.testing.assert_allclose(np.linalg.norm(action[:4]), 1.0, rtol=1e-12)
    np.testing.assert_allclose(action[7:], obs["gps_pos"], atol=50.0)
    assert isinstance(nav.filter.estimate(nav.belief), Gaussian)
    assert attitude.rotation_angle(action[:4]) >= 0.0
