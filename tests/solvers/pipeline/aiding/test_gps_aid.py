"""The fix as an aid: what it measures and holds, and an aid with a state of its own in the whole chain."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from oracles.zoo import generators
from scipy import stats

import sins_env  # noqa: F401
import solvers
from sins_env import attitude, earth
from sins_env.evaluation.bound.error_dynamics import ErrorDynamics
from sins_env.types import NavState
from solvers.filters import make_filter
from solvers.pipeline.aiding.aid import Ins
from solvers.pipeline.aiding.gps import VERTICAL_TIME_CONSTANT_S, Gps
from solvers.pipeline.errors.alignment import AlignmentErrors
from solvers.pipeline.errors.model import Parameter
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.estimator import Navigator
from solvers.types import MISSING

FLIGHT = "SINS/NavFlight-v0"
MODEL = earth.get("wgs84")
OFFSET = np.array([0.4, -0.3, 0.2])  # m/s


@pytest.fixture(scope="module")
def task():
    env = gymnasium.make(FLIGHT, profile="lu-gauss", duration=10.0)
    env.reset(seed=0)
    return env.unwrapped.task


def with_arm(task, *arm):
    return dataclasses.replace(task, gps=dataclasses.replace(task.gps, lever_arm_m=arm))


def fixes(task, runs):
    """A fix for each run, and an INS that turns and is off by some metres."""
    rng = np.random.default_rng(3)
    q = attitude.normalize(rng.standard_normal((runs, 4)))
    place = np.tile(task.site.pos, (runs, 1))
    nav = NavState(q, rng.standard_normal((runs, 3)), earth.displace(MODEL, place, rng.standard_normal((runs, 3))))
    obs = {"gps_vel": rng.standard_normal((runs, 3)), "gps_pos": place, "gps_valid": np.ones((runs, 1), np.int8)}
    rate = rng.standard_normal((runs, 1, 3)) * task.epoch_s / task.n_sub
    return {**obs, "dtheta": np.repeat(rate, task.n_sub, axis=1)}, nav


def given(obs, nav):
    return Ins(nav, nav, obs["dtheta"], None, 0.1, np.zeros(3))


def read(gps, obs, nav):
    return gps.read(obs, given(obs, nav))


@pytest.mark.parametrize("errors", [AlignmentErrors(), NavigationErrors(position=False), NavigationErrors()])
@pytest.mark.parametrize("arm", [(0.0, 0.0, 0.0), (1.0, -2.0, 0.5)])
def test_a_measurement_is_the_ins_less_the_fix_at_the_antenna(task, errors, arm):
    """As many components as the states show: two, three or six."""
    obs, nav = fixes(task, 5)
    me = read(Gps(with_arm(task, *arm), errors.states), obs, nav)
    C = attitude.to_dcm(nav.q_nb)
    rate = obs["dtheta"].sum(axis=1) / task.epoch_s - C.mT @ earth.rate_n(MODEL, task.site.latitude)
    vel = nav.vel + (C @ np.cross(rate, arm)[..., None])[..., 0] - obs["gps_vel"]
    pos = -earth.offset(MODEL, nav.pos, obs["gps_pos"]) + C @ np.array(arm)
    m = {10: 2, 12: 3, 15: 6}[errors.states.size]
    np.testing.assert_allclose(me.z, np.concatenate([vel, pos], axis=-1)[:, :m], atol=1e-7)
    np.testing.assert_array_equal(me.R, task.prior.R[:m, :m])
    np.testing.assert_array_equal(me.h(np.zeros((5, errors.states.size))), np.zeros((5, m)))


@pytest.mark.parametrize("errors", [AlignmentErrors(), NavigationErrors(position=False), NavigationErrors()])
def test_the_jacobian_of_an_antenna(task, errors):
    """Against central differences, for runs and for points of each run."""
    obs, nav = fixes(task, 5)
    me = read(Gps(with_arm(task, 1.0, -2.0, 0.5), errors.states), obs, nav)
    x = 0.5 * np.random.default_rng(4).standard_normal((5, 3, errors.states.size))
    step = 1e-6 * np.eye(errors.states.size)
    expected = np.stack([(me.h(x + d) - me.h(x - d)) / 2e-6 for d in step], axis=-1)
    np.testing.assert_allclose(me.h.jacobian(x), expected, atol=1e-8)
    np.testing.assert_array_equal(me.h.jacobian(x[:, 1]), me.h.jacobian(x)[:, 1])


def test_runs_without_a_fix(task):
    """One of them has the variance of a missing fix, in all of them there is no measurement."""
    obs, nav = fixes(task, 3)
    gps = Gps(task, NavigationErrors().states)
    obs["gps_valid"][1] = 0
    me = read(gps, obs, nav)
    np.testing.assert_array_equal(me.z[1], 0.0)
    assert me.R[1, 0, 0] >= MISSING > me.R[0, 0, 0]
    obs["gps_valid"][:] = 0
    for errors in (NavigationErrors(), AlignmentErrors()):
        gps = Gps(task, errors.states)
        assert gps.hold(obs, given(obs, nav)) is nav
        assert read(gps, obs, nav) is None


@pytest.mark.parametrize("errors", [AlignmentErrors(), NavigationErrors(position=False), NavigationErrors()])
def test_the_receiver_states_the_noise_of_each_fix(task, errors):
    """Each run has its own; the run without a fix has the variance of a missing one."""
    obs, nav = fixes(task, 3)
    std = np.random.default_rng(5).uniform(0.1, 3.0, (3, 6))
    obs["gps_valid"][1], std[1] = 0, 0.0
    me = read(Gps(task, errors.states), {**obs, "gps_vel_std": std[:, :3], "gps_pos_std": std[:, 3:]}, nav)
    m = {10: 2, 12: 3, 15: 6}[errors.states.size]
    for run in (0, 2):
        np.testing.assert_array_equal(me.R[run], np.diag(std[run, :m] ** 2))
    assert np.all(np.diag(me.R[1]) >= MISSING)


@pytest.mark.parametrize("arm", [(0.0, 0.0, 0.0), (1.0, -2.0, 0.5)])
def test_a_vertical_velocity_that_is_no_state_is_held(task, arm):
    obs, nav = fixes(task, 3)
    obs["gps_valid"][1] = 0
    told = with_arm(task, *arm)
    ten, twelve = (Gps(told, errors.states) for errors in (AlignmentErrors(), NavigationErrors(position=False)))
    held, free = (gps.hold(obs, given(obs, nav)) for gps in (ten, twelve))
    two, three = (read(gps, obs, nav) for gps in (ten, twelve))
    moved = three.z[:, 2] * task.epoch_s / VERTICAL_TIME_CONSTANT_S
    np.testing.assert_allclose(nav.vel[:, 2] - held.vel[:, 2], moved, atol=1e-14)
    np.testing.assert_array_equal(held.vel[:, :2], nav.vel[:, :2])
    np.testing.assert_array_equal(two.z, three.z[:, :2])
    assert free is nav


class OffsetGps(Gps):
    """A receiver with a constant offset of its velocity."""

    def __init__(self, task, states):
        super().__init__(task, states)
        self.offset = states["gps.offset"]

    @staticmethod
    def parameters(task):
        return (Parameter("gps.offset", 3, "cm/s", 0.01, std=0.5),)

    def read(self, obs, ins):
        me = super().read(obs, ins)

        def h(x):
            shown = me.h(x).copy()
            shown[..., :3] -= 0.01 * x[..., self.offset]
            return shown

        return me and me._replace(h=h)


class OffsetNavigator(Navigator):
    aid = OffsetGps


def fly(made, runs=24):
    """Errors (runs, 9) after 20 s with fixes whose velocity is off, and the estimator."""
    env = gymnasium.make_vec(FLIGHT, num_envs=runs, profile="lu-gauss", duration=20.0, gps={"pos_std_m": 1.0})
    obs, _ = env.reset(seed=2)
    made.reset(env.unwrapped.task, generators((runs,)), runs)
    for _ in range(env.unwrapped.task.num_epochs):
        obs["gps_vel"] = obs["gps_vel"] + OFFSET
        obs, _, _, _, info = env.step(made.step(obs))
    return np.concatenate([info["errors"][key] for key in ("phi", "vel", "pos")], axis=-1), made


def nees(error, P):
    return np.sum(error * np.linalg.solve(P, error[..., None])[..., 0], axis=-1).mean()


@pytest.mark.parametrize(
    "settings", [{}, {"feedback": "open"}, {"coordinates": "invariant"}], ids=["closed", "open", "invariant"]
)
def test_an_aid_brings_a_state_of_its_own(settings):
    """The offset is found, in its unit, and the nine errors are what their covariance says; a plain navigator's are not."""
    error, made = fly(OffsetNavigator(make_filter("ekf"), **settings))
    low, high = stats.chi2.ppf([0.0005, 0.9995], 9 * 24) / 24
    assert low < nees(error, made.covariance()) < high
    x = made.filter.estimate(made.belief)
    sigma = np.sqrt(np.diagonal(x.cov, axis1=-2, axis2=-1))[:, -3:]
    assert np.all(sigma < 25.0)  # cm/s; it begins with 50
    apart = (x.mean[:, -3:] - 100 * OFFSET) / sigma
    assert np.square(apart).sum(axis=1).mean() < stats.chi2.ppf(0.9995, 3 * 24) / 24


def test_without_it_the_errors_are_not_explained():
    error, made = fly(Navigator(make_filter("ekf")))
    assert nees(error, made.covariance()) > 2 * stats.chi2.ppf(0.9995, 9 * 24) / 24


@pytest.mark.parametrize("arm", [(0.0, 0.0, 0.0), (1.0, -2.0, 0.5)])
def test_a_fix_without_a_velocity_is_the_other_half(task, arm):
    """Its rows are those of the position, with and without an age; an error model without a position has none."""
    obs, nav = fixes(task, 5)
    told = with_arm(task, *arm)
    alone = dataclasses.replace(told, gps=dataclasses.replace(told.gps, velocity=False))
    x = 0.3 * np.random.default_rng(4).standard_normal((5, 15))
    samples = (np.repeat(obs["dtheta"], 2, axis=1), np.ones((5, 2, 3)))
    for age in (None, 0.13):
        more = {} if age is None else {"gps_age": np.full((5, 1), age)}
        ins = dataclasses.replace(given(obs, nav), samples=samples)
        both, one = (Gps(t, NavigationErrors().states).read({**obs, **more}, ins) for t in (told, alone))
        np.testing.assert_array_equal(one.z, both.z[:, 3:])
        np.testing.assert_array_equal(one.h(x), both.h(x)[:, 3:])
        np.testing.assert_array_equal(one.R, task.prior.R[3:, 3:])
        if age or any(arm):
            np.testing.assert_array_equal(one.h.jacobian(x), both.h.jacobian(x)[:, 3:])
    with pytest.raises(ValueError, match="fixes without a velocity; allowed: in navigation"):
        Gps(alone, NavigationErrors(position=False).states)


def test_fixes_without_a_velocity_in_a_world():
    """The positions keep their bits; the bound has their rows alone; an alignment refuses them, and a task that tells otherwise."""
    setting = {"profile": "lu-gauss", "duration": 10.0}
    worlds = [gymnasium.make(FLIGHT, gps={"velocity": velocity}, **setting) for velocity in (True, False)]
    seen = [env.reset(seed=1)[0] for env in worlds]
    assert np.linalg.norm(seen[0]["gps_vel"]) > 1.0
    assert not seen[1]["gps_vel"].any()
    for name in ("gps_pos", "gps_valid", "dtheta"):
        np.testing.assert_array_equal(seen[1][name], seen[0][name])
    both, alone = (ErrorDynamics(env.unwrapped.episode.world) for env in worlds)
    np.testing.assert_array_equal(alone.R, both.R[3:, 3:])
    np.testing.assert_array_equal(alone.shown, both.shown[3:])
    with pytest.raises(ValueError, match="gps velocity = False; allowed: true in an alignment"):
        gymnasium.make("SINS/AlignSway-v0", gps={"velocity": False})
    with pytest.raises(ValueError, match="velocity of gps in told = True; allowed: False"):
        gymnasium.make(FLIGHT, gps={"velocity": False}, told={"gps": {"velocity": True}}, **setting)


@pytest.mark.parametrize("name", ["ckf", "inekf", "gsf_imm"])
def test_positions_alone_in_the_chain(name):
    """The velocity becomes known from them, and the covariance holds."""
    runs = 12
    gps = {"velocity": False, "rate_hz": 1.0, "pos_std_m": 1.0}
    start = {"attitude_std_deg": [0.5, 0.5, 1.0], "velocity_std_mps": 2.0, "position_std_m": 10.0}
    env = gymnasium.make_vec(FLIGHT, num_envs=runs, profile="lu-gauss", duration=20.0, gps=gps, epoch=0.2, **start)
    obs, _ = env.reset(seed=3)
    made = solvers.make(name)
    made.reset(env.unwrapped.task, generators((runs,)), runs)
    for _ in range(env.unwrapped.task.num_epochs):
        obs, _, _, _, info = env.step(made.step(obs))
    error = np.concatenate([info["errors"][key] for key in ("phi", "vel", "pos")], axis=-1)
    nees = np.sum(error * np.linalg.solve(made.covariance(), error[..., None])[..., 0], axis=-1)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 9 * runs) / runs
    assert low < nees.mean() < high
    assert np.sqrt(np.square(error[:, 3:6]).mean()) < 0.4
