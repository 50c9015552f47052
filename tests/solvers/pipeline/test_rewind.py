"""Fixes between the ends of epochs: the INS taken back along exact motion, its errors there, and fixes in the whole chain."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from oracles.zoo import generators

import sins_env  # noqa: F401
import solvers
from sins_env import attitude, earth
from sins_env.evaluation import get_task
from sins_env.evaluation.bound.error_dynamics import ErrorDynamics, simulated, true_motion
from sins_env.sensors.gps import Gps
from sins_env.specs import GpsSpec
from sins_env.trajectory import THESIS, Flight, FlightPlan, Sway
from sins_env.types import NavState, Site
from solvers.pipeline.aiding import gps as gps_aid
from solvers.pipeline.aiding.aid import Ins
from solvers.pipeline.errors.alignment import AlignmentErrors
from solvers.pipeline.errors.invariant import Invariant
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.rewind import rewound
from solvers.pipeline.strapdown import Strapdown

MODEL = earth.get("wgs84")
SEGMENTS = [[1, 1], [2, 0, 1, 0, 0, 12], [17, 0, 0, 0, 12], [2, 0, -1, 0, 0, -12], [8, -1]]
TURNS = {"latitude_deg": 34.0, "longitude_deg": 108.0, "height_m": 50.0, "speed_mps": 15.0, "segments": SEGMENTS}
SITE = Site(np.radians(39.96), np.radians(116.3), 50.0)
T = 0.1


def moving(kind, n_sub, T=T):
    """A trajectory and its first 200 epochs; the true states at t = 0 come first."""
    made = Flight(FlightPlan.of(TURNS), T, n_sub) if kind == "car" else Sway(SITE, T, n_sub, THESIS)
    start = made.reset([np.random.default_rng(1)])
    motion = made.chunk(0, 200)
    states = NavState(*(np.concatenate([a[:, None], b], axis=1)[0] for a, b in zip(start, motion.state, strict=True)))
    return made, motion, states


@pytest.mark.parametrize(
    ("kind", "n_sub", "age", "worst"),
    [
        ("car", 1, 0.05, (2.3e-3, 8e-5, 2e-4)),
        ("car", 5, 0.05, (1e-4, 4e-6, 1e-5)),
        ("car", 5, 0.17, (1e-4, 6e-5, 1e-5)),
        ("sway", 1, 0.05, (3e-3, 8e-5, 4e-4)),
        ("sway", 10, 0.13, (4e-6, 3e-7, 1e-7)),
    ],
)
def test_the_ins_taken_back_is_where_the_vehicle_was(kind, n_sub, age, worst):
    """Worst error of a perfect INS in m/s, m and rad, with one sample in an epoch and with several."""
    made, motion, states = moving(kind, n_sub)
    k = np.arange(2, 201)
    true, rate = made.earlier(NavState(*(part[None, k] for part in states)), k * T, np.full(len(k), age))
    samples = [np.concatenate([part[0][k - 2], part[0][k - 1]], axis=1) for part in (motion.dtheta, motion.dvel)]
    found = rewound(MODEL, NavState(*(part[k] for part in states)), *samples, T / n_sub, np.full(len(k), age))
    off = earth.offset(MODEL, true.pos[0], found.nav.pos)
    turned = attitude.rotation_angle(attitude.multiply(found.nav.q_nb, attitude.conjugate(true.q_nb[0])))
    errors = np.abs(found.nav.vel - true.vel[0]).max(), np.abs(off).max(), np.abs(turned).max()
    assert (np.array(errors) < worst).all(), errors
    assert np.abs(found.rate - rate[0]).max() < 2e-4


def test_the_motion_at_the_time_of_a_fix():
    """States before the end of an epoch are those that a finer grid has at its ends."""
    for kind in ("car", "sway"):
        coarse, _, states = moving(kind, 1)
        k, age = np.array([3, 50, 120, 199]), np.full(4, 0.06)
        fine = Flight(FlightPlan.of(TURNS), 0.02, 1) if kind == "car" else Sway(SITE, 0.02, 1, THESIS)
        fine.reset([np.random.default_rng(1)])
        there = 5 * k - 4  # numbers from zero of the fine epochs that end at the times of the fixes
        expected = fine.chunk(0, 1000)
        state, rate = coarse.earlier(NavState(*(part[None, k] for part in states)), k * T, age)
        for part, other in zip(state, expected.state, strict=True):
            np.testing.assert_allclose(part, other[:, there], rtol=1e-12, atol=1e-11)
        np.testing.assert_allclose(rate, expected.rate_eb_b[:, there], atol=1e-12)


def measured(errors, nav, age, lever=(0.5, 1.0, 2.0), n_sub=2, runs=5):
    """A measurement of fixes that were made ``age`` before the ends of epochs, and the observation."""
    rng = np.random.default_rng(5)
    env = gymnasium.make("SINS/NavFlight-v0", profile=TURNS, n_sub=n_sub, gps={"lever_arm_m": lever})
    env.reset(seed=0)
    task = env.unwrapped.task
    dtheta, dvel = 0.02 * rng.standard_normal((runs, 2 * n_sub, 3)), 0.5 * rng.standard_normal((runs, 2 * n_sub, 3))
    made = rewound(MODEL, nav, dtheta, dvel, T / n_sub, age)
    C = attitude.to_dcm(made.nav.q_nb)
    arm, spin = C @ np.array(lever), (C @ np.cross(made.rate, lever)[..., None])[..., 0]
    obs = {
        "gps_vel": made.nav.vel + spin,
        "gps_pos": earth.displace(MODEL, made.nav.pos, arm),
        "gps_valid": np.ones((runs, 1), dtype=np.int8),
        "gps_age": age[:, None],
        "dtheta": dtheta[:, n_sub:],
        "dvel": dvel[:, n_sub:],
    }
    rate_ie = earth.rate_n(MODEL, task.site.latitude)
    ins = Ins(nav, nav, obs["dtheta"], None, T, rate_ie, samples=(dtheta, dvel))
    return gps_aid.Gps(task, errors.states).read(obs, ins), task, obs, ins


def anywhere(runs=5):
    rng = np.random.default_rng(2)
    pos = earth.displace(MODEL, np.tile([0.6, 1.9, 50.0], (runs, 1)), 30 * rng.standard_normal((runs, 3)))
    return NavState(attitude.normalize(rng.standard_normal((runs, 4))), 10 * rng.standard_normal((runs, 3)), pos)


AGES = np.array([0.0, 0.03, 0.1, 0.13, 0.199])


@pytest.mark.parametrize("errors", [AlignmentErrors(), NavigationErrors(position=False), NavigationErrors()])
def test_a_fix_before_the_end_is_compared_with_the_ins_then(errors):
    """Without errors INS minus fix is zero; Jacobians agree with differences, at large errors and in invariant coordinates."""
    nav = anywhere()
    me, task, obs, ins = measured(errors, nav, AGES)
    np.testing.assert_allclose(me.z, 0.0, atol=2e-7)
    n = errors.states.size
    np.testing.assert_allclose(me.h(np.zeros((5, n))), 0.0, atol=1e-12)
    forms = [(me.h, me.h.jacobian, 0.5 * np.random.default_rng(4).standard_normal((5, n)))]
    if n > 10:
        seen = Invariant(MODEL, task.site.pos, errors.states).measurement(me, nav).h
        forms.append((seen, lambda xi: seen.value_and_jacobian(xi)[1], np.zeros((5, n))))
    for h, slope, at in forms:
        step = 1e-5 * np.eye(n)
        ahead, behind = h(at[:, None] + step), h(at[:, None] - step)
        np.testing.assert_allclose(slope(at), np.swapaxes(ahead - behind, -1, -2) / 2e-5, atol=1e-6)
    now = gps_aid.Gps(task, errors.states).read({key: value for key, value in obs.items() if key != "gps_age"}, ins)
    np.testing.assert_allclose(me.h(forms[0][2])[0], now.h(forms[0][2])[0], atol=2e-6)  # an age of zero


def test_errors_at_the_time_of_a_fix_are_those_of_two_mechanisations():
    """At 3 deg of heading, 0.3 m/s and biases of 3 deg/h and 10 mg, to 2e-5 m/s and 2e-5 m over 60 s."""
    T = 0.05
    _, motion, states = moving("car", 1, T)
    sd = Strapdown(MODEL, T, 1, states.pos[0], hold_position=False)
    q = attitude.multiply(attitude.misalignment_quaternion(np.radians([0.5, -0.3, 3.0])), states.q_nb[0])
    off = earth.displace(MODEL, states.pos[0], np.array([5.0, -4.0, 3.0]))
    ins = sd.start(NavState(q, states.vel[0] + [0.3, -0.2, 0.1], off))
    eps, nabla = np.radians([2.0, -3.0, 1.0]) / 3600, np.array([100.0, -80.0, 50.0]) * 1e-3
    model = NavigationErrors()
    fix, left = gps_aid.Fix(model.states), []
    for k in range(200):
        dtheta, dvel = motion.dtheta[0, k] + eps * T, motion.dvel[0, k] + nabla * T
        true, ins = ins, sd.advance(ins, dtheta, dvel)[0]
        x = np.zeros(15)
        x[:3] = attitude.misalignment(ins.nav.q_nb, states.q_nb[k + 1])
        x[3:6], x[6:9] = ins.nav.vel - states.vel[k + 1], earth.offset(MODEL, states.pos[k + 1], ins.nav.pos)
        x[9:] = np.concatenate([eps, nabla]) / model.states.si[9:]
        made = gps_aid.Made(np.array(T), rewound(MODEL, ins.nav, dtheta, dvel, T, np.array(T)))
        shown = fix.measurement(np.zeros(6), np.eye(6), made=made).h(x)
        then = np.concatenate([true.nav.vel - states.vel[k], earth.offset(MODEL, states.pos[k], true.nav.pos)])
        left.append(np.abs(then - shown))
    worst = np.max(left[5:], axis=0)
    assert worst[:3].max() < 4e-5, worst
    assert worst[3:].max() < 4e-5, worst


def test_what_is_refused():
    nav = anywhere()
    with pytest.raises(ValueError, match=r"gps_age = 0.21 s; allowed: 0 to 0.2 s"):
        measured(NavigationErrors(), nav, np.full(5, 0.21))
    with pytest.raises(ValueError, match=r"gps_age = -0.1 s"):
        measured(NavigationErrors(), nav, np.full(5, -0.1))
    with pytest.raises(ValueError, match=r"GpsSpec.age_s = 1.5; allowed: a number of seconds, 0 to 1"):
        GpsSpec(age_s=1.5)


LATE = {"age_s": 0.02, "age_jitter_s": 0.17}


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space.*:UserWarning")
def test_fixes_in_a_world():
    """The fields, single and vector; no errors change beside what is seen; none is made before the episode begins."""
    quiet = {"vel_std_mps": 0.0, "pos_std_m": 0.0, "rate_hz": 10.0, "lever_arm_m": [0.5, 1.0, 2.0]}
    make = {"profile": TURNS, "duration": 3.0}
    env = gymnasium.make("SINS/NavFlight-v0", gps={**quiet, **LATE}, **make)
    check_env(env.unwrapped, skip_render_check=True)
    rows = gymnasium.make_vec("SINS/NavFlight-v0", num_envs=2, gps={**quiet, **LATE}, **make)
    (one, _), (two, _) = env.reset(seed=4), rows.reset(seed=3)
    plain = gymnasium.make("SINS/NavFlight-v0", gps=quiet, **make)
    assert "gps_age" not in plain.reset(seed=4)[0]
    action = np.concatenate([*env.unwrapped.task.start])
    valid, ages = [], []
    for k in range(30):
        for name, value in one.items():
            np.testing.assert_array_equal(two[name][1], value)
        valid.append(one["gps_valid"][0])
        ages.append(one["gps_age"][0])
        if k == 20:
            assert np.linalg.norm(one["gps_vel"]) > 1.0
        one, two = env.step(action)[0], rows.step(np.tile(action, (2, 1)))[0]
    assert valid[2:] == [1] * 28
    assert min(ages[2:]) >= 0.02
    assert max(ages) <= 0.19
    assert np.std(ages[2:]) > 0.04
    assert all(age <= T * (k + 1) for k, (age, there) in enumerate(zip(ages, valid, strict=True)) if there)
    # the fix of the antenna is that of the trajectory at the time of the fix
    world = env.unwrapped.episode.world
    gps = Gps(GpsSpec(**quiet, **LATE), T, 3.0, MODEL)
    np.testing.assert_allclose(gps.schedule(0, 30)[1][2:], ages[2:])
    assert world.fields["gps_age"].high[0] > 0.19


def nees(error, P):
    return np.sum(error * np.linalg.solve(P, error[..., None])[..., 0], axis=-1)


def drive(name, ignored=False, runs=12):
    """Mean NEES/9 and position error in cm of a drive with fixes of 3 cm and 3 cm/s at 1 Hz, up to two epochs old."""
    fixes = {"rate_hz": 1.0, "pos_std_m": 0.03, "vel_std_mps": 0.03, "lever_arm_m": [0.5, 1.0, 2.0], **LATE}
    start = {"attitude_std_deg": [0.5, 0.5, 1.0], "position_std_m": 3.0}
    env = gymnasium.make_vec("SINS/NavFlight-v0", num_envs=runs, profile=TURNS, gps=fixes, duration=20.0, **start)
    obs, _ = env.reset(seed=3)
    made = solvers.make(name)
    made.reset(env.unwrapped.task, generators((runs,)), runs)
    for _ in range(env.unwrapped.task.num_epochs):
        if ignored:
            del obs["gps_age"]
        obs, _, _, _, info = env.step(made.step(obs))
    error = np.concatenate([info["errors"][key] for key in ("phi", "vel", "pos")], axis=-1)
    return nees(error, made.covariance()).mean() / 9, 100 * np.sqrt(np.square(error[:, 6:]).mean())


@pytest.mark.parametrize("name", ["ckf", "inekf", "gsf_imm"])
def test_fixes_up_to_two_epochs_old_in_the_chain(name):
    """12 runs of 9 numbers: a standard deviation of 0.14."""
    ratio, centimetres = drive(name)
    assert 0.6 < ratio < 1.5
    assert centimetres < 3.5


def test_ignoring_the_age_costs_what_it_is_worth():
    ratio, centimetres = drive("ekf", ignored=True)
    assert ratio > 100
    assert centimetres > 50


def test_the_bound_knows_the_age():
    """The rows of a fix are those of the end of the epoch before, with the dynamics between them, whatever the sensors."""
    task = dataclasses.replace(get_task("flight-lu-gauss-v0"), kwargs={"profile": TURNS, "duration": 6.0})
    rows = []
    for age in (0.0, 0.1):
        one = dataclasses.replace(task, kwargs={**task.kwargs, "gps": {"rate_hz": 10.0, "age_s": age}})
        public, world = simulated(one)
        model, (part,) = ErrorDynamics(world), true_motion(one, public, 1)
        rows.append(model.sensitivity(part)[0])
        assert part.fix.tolist() == [True] * 60
    F = model.transitions(part)[0]
    np.testing.assert_allclose((rows[1][1:] @ F[1:])[:, :, :9], rows[0][:-1, :, :9], atol=1e-6)
    assert np.abs(rows[1][1:] - rows[0][:-1])[:, :, :9].max() > 0.5
