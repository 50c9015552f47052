"""Aids against sensors written once more: residual and Jacobian at any error, the bound's rows, and all of them in the chain."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from oracles.zoo import generators
from scipy import linalg, stats
from scipy.spatial.transform import Rotation

import sins_env  # noqa: F401
import solvers
from sins_env import attitude, earth
from sins_env.checks import classes
from sins_env.evaluation.bound.aids import Instant, term
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.sensors.aids import Sensor, specs
from sins_env.states import ERRORS
from sins_env.trajectory import constellation
from sins_env.types import NavState
from solvers.pipeline.aiding import aid, together
from solvers.pipeline.errors.invariant import Invariant
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.strapdown import Strapdown
from solvers.types import Innovation, Measurement

RUNS = 12
#: At 15 m/s through turns of 12 deg/s, from the first second on.
SEGMENTS = [[1, 1], [2, 0, 1, 0, 0, 12], [17, 0, 0, 0, 12]]
TURNS = {"latitude_deg": 34.0, "longitude_deg": 108.0, "height_m": 50.0, "speed_mps": 15.0, "segments": SEGMENTS}
FLIGHT = {"id": "SINS/NavFlight-v0", "profile": TURNS}
NAMES = tuple(classes("sins_env.sensors", Sensor))
LEVER = np.array([0.4, -1.3, -0.6])
FIELD = np.array([-1.9, 30.0, -35.0])
AIDS = {
    "odometer": {"lever_arm_m": LEVER.tolist()},
    "dvl": {"lever_arm_m": LEVER.tolist(), "track": "water"},
    "heading": {"baseline_m": [0.2, 1.0, 0.1], "multipath_m": 0.01},
    "magnetometer": {"soft_iron": 0.02},
    "height": {},
    "depth": {},
    "ranges": {"lever_arm_m": LEVER.tolist(), "multipath_m": 2.0, "satellites": 5},
}
MODEL = earth.get("wgs84")


@pytest.fixture(scope="module")
def task():
    env = gymnasium.make(aids=AIDS, **FLIGHT)
    env.reset(seed=0)
    return env.unwrapped.task


def across(a):
    """The matrices of a x."""
    return np.stack([np.cross(a, unit) for unit in np.eye(3)], axis=-1)


def turned(a):
    """Rotations about Up by the angles a."""
    return Rotation.from_rotvec(np.stack([0 * a, 0 * a, a], axis=-1)).as_matrix()


def reading(name, C, v, height, w, a):
    """What a sensor reads without noise; ``a`` are its parameters by name, (runs, size)."""
    back = np.swapaxes(C, -1, -2)
    times = lambda A, b: np.einsum("...ij,...j", A, b)  # noqa: E731
    if name == "odometer":
        alpha = a["mounting"][:, [0, 0, 1]] * [1, 0, 1]
        y = times(np.eye(3) - across(alpha), times(back, v) + np.cross(w, LEVER))
        return np.stack([(1 + a["scale"][:, 0]) * y[:, 1], y[:, 0], y[:, 2]], axis=-1)
    if name == "dvl":
        current = np.concatenate([a["current"], np.zeros((len(v), 1))], axis=-1)
        y = times(np.eye(3) - across(a["mounting"]), times(back, v - current) + np.cross(w, LEVER))
        return (1 + a["scale"]) * y
    if name == "heading":
        return times(C, times(turned(a["mounting"][:, 0]), [0.2, 1.0, 0.1])) + a["multipath"]
    if name == "magnetometer":
        m = times(back, times(turned(-a["declination"][:, 0]), FIELD))
        return (1 + a["soft_iron"]) * m + a["hard_iron"]
    return {"height": 1, "depth": -1}[name] * height[:, None] + a["bias"]


def in_ecef(q, pos):
    """Place in ECEF of the antenna, and C_b^e, by SciPy."""
    up = Rotation.from_euler("ZYX", np.stack([pos[:, 1] + np.pi / 2, 0 * pos[:, 0], np.pi / 2 - pos[:, 0]], -1))
    C = up.as_matrix() @ attitude.to_dcm(q)
    across = MODEL.a / np.sqrt(1 - MODEL.e2 * np.sin(pos[:, 0]) ** 2)
    out = (across + pos[:, 2]) * np.cos(pos[:, 0])
    z = (across * (1 - MODEL.e2) + pos[:, 2]) * np.sin(pos[:, 0])
    return np.stack([out * np.cos(pos[:, 1]), out * np.sin(pos[:, 1]), z], axis=-1) + C @ LEVER, C, up.as_matrix()


def ranges(q, vel, pos, rate, a, satellites):
    """Ranges and range rates of an antenna, (runs, 2 S)."""
    place, C, up = in_ecef(q, pos)
    speed = np.einsum("...ij,...j", up, vel) + np.einsum("...ij,...j", C, np.cross(rate, LEVER))
    away = satellites[..., :3] - place[:, None]
    distance = np.linalg.norm(away, axis=-1)
    closing = np.sum(away * (satellites[..., 3:] - speed[:, None]), axis=-1) / distance
    return np.concatenate([distance + a["clock"][:, :1] + a["multipath"], closing + a["clock"][:, 1:]], axis=-1)


def overhead(task):
    """Satellites above the site."""
    orbits = constellation.satellites(MODEL, np.array(0.0))
    return orbits[np.argsort(-constellation.up(MODEL, task.site.pos, orbits[:, :3]))[:5]]


def world(task, name, runs=4, size=0.3):
    """An aid, an INS, errors x, and the reading at the INS without them."""
    rng = np.random.default_rng(7)
    errors = together.with_parameters(NavigationErrors(), task)
    made = next(one for one in together.sensors(task, errors) if one.name == name)
    states = errors.states
    q = attitude.normalize(rng.standard_normal((runs, 4)))
    pos = earth.displace(MODEL, np.tile(task.site.pos, (runs, 1)), 30 * rng.standard_normal((runs, 3)))
    nav = NavState(q, 10 * rng.standard_normal((runs, 3)), pos)
    x = size * rng.standard_normal((runs, states.size))
    x[:, states.span("dv", "dp")] *= 10
    own = {p.name: 0.05 * rng.standard_normal((runs, p.size)) for p in errors.parameters}
    for p in errors.parameters:
        x[:, states[p.name]] = 0.05 * rng.standard_normal((runs, p.size)) / p.si
    dtheta = 0.03 * rng.standard_normal((runs, task.n_sub, 3))
    ins = aid.Ins(nav, nav, dtheta, None, task.epoch_s, earth.rate_n(MODEL, task.site.latitude), own)
    rate = dtheta[:, -1] * task.n_sub / task.epoch_s - np.einsum("...ji,j", attitude.to_dcm(q), ins.rate_ie)
    C = np.swapaxes(attitude.misalignment_dcm(x[:, :3]), -1, -2) @ attitude.to_dcm(q)
    a = {p.name.partition(".")[2]: own[p.name] + p.si * x[:, states[p.name]] for p in made.parameters}
    eps = states.si[states["gyro_bias"]] * x[:, states["gyro_bias"]]
    if name == "ranges":
        q_true = attitude.multiply(attitude.conjugate(attitude.misalignment_quaternion(x[:, :3])), q)
        place, vel = earth.displace(MODEL, pos, -x[:, states["dp"]]), nav.vel - x[:, states["dv"]]
        return made, ins, x, ranges(q_true, vel, place, rate - eps, a, overhead(task)), states
    seen = reading(name, C, nav.vel - x[:, states["dv"]], pos[:, 2] - x[:, states["dp"]][:, 2], rate - eps, a)
    return made, ins, x, seen, states


def observed(name, seen, task):
    """The observation that holds a reading."""
    epoch_s = task.epoch_s
    if name == "ranges":
        parts = dict(zip(("ranges", "range_rates"), np.split(seen, 2, axis=-1), strict=True))
        mark = np.ones((len(seen), 5), dtype=np.int8)
        return {**parts, "satellites": np.tile(overhead(task), (len(seen), 1, 1)), "ranges_valid": mark}
    value = {"odometer": seen[:, :1] * epoch_s, "magnetometer": seen * 1e-6}.get(name, seen)
    return {name: value, f"{name}_valid": np.ones((len(value), 1), dtype=np.int8)}


@pytest.mark.parametrize("name", NAMES)
def test_ins_minus_reading_is_what_the_errors_show(task, name):
    """To rounding, at errors of 20 deg, some m/s and 5 %; the constraint reads zero, so its rows are compared at zero.

    Ranges leave out the curvature of the earth, 10 um at 10 m.
    """
    made, ins, x, seen, _ = world(task, name)
    me = made.read(observed(name, seen, task), ins)
    expected = me.z.copy()
    if name == "odometer":
        expected[:, 1:] -= seen[:, 1:]
    atol = 2e-5 if name == "ranges" else 1e-8
    np.testing.assert_allclose(me.h(x), expected, atol=atol)
    np.testing.assert_allclose(me.h(np.zeros_like(x)), 0.0, atol=1e-12)
    points = np.stack([x, 0 * x], axis=1)
    np.testing.assert_allclose(me.h(points)[:, 0], expected, atol=atol)


@pytest.mark.parametrize("name", NAMES)
def test_jacobians(task, name):
    """Against central differences, in the errors of the model at zero and far from it, and in invariant coordinates."""
    made, ins, x, seen, states = world(task, name)
    me = made.read(observed(name, seen, task), ins)
    invariant = Invariant(MODEL, task.site.pos, states).measurement(me, ins.nav)
    for h, slope, at in (
        (me.h, me.h.jacobian, 0 * x),
        (me.h, me.h.jacobian, x),
        (invariant.h, lambda xi: invariant.h.value_and_jacobian(xi)[1], 0 * x),
    ):
        step = 1e-5 * np.eye(states.size)
        # points, which a tangent does not shorten
        ahead, behind = h(at[:, None] + step), h(at[:, None] - step)
        np.testing.assert_allclose(slope(at), np.swapaxes(ahead - behind, -1, -2) / 2e-5, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_the_bound_sees_what_the_aid_sees(task, name):
    """Its rows, at the truth, and its variances, though written apart; parameters may have the other sign."""
    made, ins, x, seen, states = world(task, name)
    ins = dataclasses.replace(ins, own={key: 0 * value for key, value in ins.own.items()})
    me = made.read(observed(name, seen, task), ins)
    H = me.h.jacobian(0 * x)
    spec = next(one for one in task.aids if one.name == name)
    other = term(spec, task.epoch_s)
    variances = np.broadcast_to(np.diagonal(me.R, axis1=-2, axis2=-1), me.z.shape)
    if name != "ranges":  # whose rows the bound weights by the elevation
        np.testing.assert_allclose(variances, np.broadcast_to(other.noise(), me.z.shape))
    H = H * np.sqrt(other.noise() / variances)[..., None]
    blocks = {"phi": "phi", "dv": "dv", "dp": "dp", "gyro_bias": "rate", **{p.name: p.name for p in made.parameters}}
    parts = [part[:, None] for part in (ins.C, ins.nav.vel, made.rate(ins), ins.nav.pos)]
    rows = {key: row[:, 0] if row.ndim > 3 else row for key, row in other.rows(Instant(*parts, np.zeros(1))).items()}
    for block, key in blocks.items():
        expected = np.broadcast_to(rows.get(key, np.zeros((1, 1))), H[..., states[block]].shape)
        atol = 2e-7 if name == "ranges" else 1e-9  # the antenna is 1.4 m away, a satellite 2e7 m
        np.testing.assert_allclose(H[..., states[block]] / states.si[states[block]], expected, atol=atol)
    assert {own.block.name for own in other.states()} == {p.name for p in made.parameters}
    for own, p in zip(other.states(), made.parameters, strict=True):
        spread = np.square(own.std) * np.eye(p.size)
        np.testing.assert_allclose(spread, p.start())
        if own.dynamics is None:
            assert own.time_constant_s == pytest.approx(p.time_constant_s)
        else:  # over an epoch, by the exponential and by steps
            A, density = own.dynamics
            np.testing.assert_allclose(linalg.expm(0.1 * A), p.carry(0.1))
            part = linalg.expm(0.1 / 500 * A)
            P = np.zeros((2, 2))
            for _ in range(500):
                P = part @ P @ part.T + 0.1 / 500 * np.diag(density)
            np.testing.assert_allclose(P, p.added(0.1), rtol=5e-3)


def test_rows_of_several_aids():
    """What is missing has z = 0; a whole aid has a variance of one then, a component keeps its own."""
    one = Measurement(np.array([[1.0, np.nan], [2.0, 3.0]]), lambda x: x[..., :2], 4.0 * np.eye(2))
    me = together.stacked([None, one], [1, 2], (2,))
    np.testing.assert_array_equal(me.z, [[0, 1, 0], [0, 2, 3]])
    np.testing.assert_array_equal(me.present, [[False, True, False], [False, True, True]])
    np.testing.assert_array_equal(me.R, np.tile(np.diag([1.0, 4.0, 4.0]), (2, 1, 1)))
    np.testing.assert_array_equal(me.h(np.arange(6.0).reshape(2, 3)), [[0, 0, 1], [0, 3, 4]])
    fit = together.fits(
        Innovation(np.array([[np.nan, 2.0, np.nan]]), np.full((1, 3, 3), 4.0)), {"a": slice(0, 1), "b": slice(1, 3)}
    )
    np.testing.assert_array_equal(fit["b_nis"], [1.0])
    assert np.isnan(fit["a_nis"]).all()


@pytest.mark.parametrize("name", ["ekf", "gsf_imm"])
def test_a_run_does_not_know_of_the_others(name):
    """A clock runs on, and the noise of ranges follows the elevations of each run: a run beside others has its own bits."""
    task = get_task("tight-v0")

    def answers(runs):
        env = task.make(len(runs))
        obs, _ = task.reset(env, runs)
        solver, found = solvers.make(name), []
        solver.reset(env.unwrapped.task, generators((len(runs),)))
        for _ in range(25):
            found.append(solver.step(obs))
            obs, *_ = env.step(found[-1])
        env.close()
        return np.stack(found, axis=1)

    np.testing.assert_array_equal(answers(range(88, 96))[3], answers((91,))[0])


def nees(error, P):
    return np.sum(error * np.linalg.solve(P, error[..., None])[..., 0], axis=-1)


def fly(name, aids, runs=RUNS, worse=None, gps=None, **settings):
    """Errors (runs, 9) at the end of a drive with its fixes withheld for the last half, and the estimator."""
    fixes = {"rate_hz": 1.0, "pos_std_m": 3.0, "outages_s": [[10.0, 20.0]], **(gps or {})}
    start = {"attitude_std_deg": [0.5, 0.5, 1.0], "position_std_m": 3.0}
    env = gymnasium.make_vec(num_envs=runs, aids=aids, epoch=0.2, n_sub=2, gps=fixes, **start, **FLIGHT)
    obs, _ = env.reset(seed=3)
    made = solvers.make(name, **settings)
    made.reset(env.unwrapped.task, generators((runs,)), runs)
    for k in range(env.unwrapped.task.num_epochs):
        if worse:
            worse(k, obs)
        obs, _, _, _, info = env.step(made.step(obs))
    return np.concatenate([info["errors"][key] for key in ("phi", "vel", "pos")], axis=-1), made


EVERY = {**AIDS, "odometer": {"nhc": False, "lever_arm_m": LEVER.tolist()}, "dvl": {"rate_hz": 2.5, "track": "water"}}


@pytest.mark.parametrize("name", ["ekf", "inekf", "gsf_imm"])
def test_all_aids_in_the_chain(name):
    """Errors are what the covariance says, and the height stays within the barometer's when there are no fixes."""
    error, made = fly(name, EVERY)
    low, high = stats.chi2.ppf([0.0005, 0.9995], 9 * RUNS) / RUNS
    assert low < nees(error, made.covariance()).mean() < high
    assert np.abs(error[:, 8]).max() < 6.0
    found = made.diagnostics()
    for aid_name, rows in (("odometer", 1), ("heading", 3), ("height", 1)):
        assert found[f"{aid_name}_residual"].shape == (RUNS, rows)
        assert found[f"{aid_name}_nis"].mean() == pytest.approx(rows, abs=5 * np.sqrt(2 * rows / RUNS))
    assert np.isnan(found.get("gps_nis", np.nan)).all()  # in the outage


@pytest.mark.parametrize("name", ["ckf", "inekf", "gsf_ekf"])
def test_three_satellites_for_a_while_without_any_fix(name):
    """The covariance holds, and so does the position: it was fixed by six satellites before, and the clock is a state."""
    receiver = {"rate_hz": 1.0, "lever_arm_m": LEVER.tolist(), "few_s": [[12.0, 20.0]], "few": 3}
    error, made = fly(name, {"ranges": receiver}, gps={"outages_s": [[0.0, 100.0]]})
    low, high = stats.chi2.ppf([0.0005, 0.9995], 9 * RUNS) / RUNS
    assert low < nees(error, made.covariance()).mean() < high
    assert np.sqrt(np.square(error[:, 6:8]).sum(axis=-1).mean()) < 5.0
    found = made.diagnostics()
    assert np.isfinite(found["ranges_residual"]).sum(axis=-1).tolist() == [6] * RUNS
    assert found["ranges_nis"].mean() == pytest.approx(6.0, abs=5 * np.sqrt(12.0 / RUNS))


def test_a_gate_leaves_out_the_aid_that_is_wrong_alone():
    def jumps(k, obs):
        if k >= 60:
            obs["height"] = obs["height"] + 50.0

    aids = {"height": {"bias_m": 0.5}, "heading": "novatel-1m"}
    error, made = fly("ekf", aids, 4, jumps, aid_gate=0.999)
    found = made.diagnostics()
    assert np.isnan(found["height_nis"]).all()
    assert np.isfinite(found["heading_nis"]).all()
    assert found["heading_residual"].shape == (4, 3)
    assert np.abs(error[:, 8]).max() < 10.0
    drawn, _ = fly("ekf", aids, 4, jumps)
    assert np.abs(drawn[:, 8]).min() > 20.0


def test_what_wanders_decays_in_the_state_and_where_it_was_fed_back(task):
    errors = together.with_parameters(NavigationErrors(), task)
    p = next(p for p in errors.parameters if p.name == "height.bias")
    at = errors.states[p.name]
    own = slice(at.start - ERRORS.size, at.stop - ERRORS.size)
    decay = errors.carry(60.0)[own, own]
    np.testing.assert_allclose(decay, np.exp(-0.1))
    np.testing.assert_allclose(p.driven(60.0) ** 2 + (p.std * decay) ** 2, p.std**2)
    np.testing.assert_allclose(errors.noise(task.prior)[at, at], p.driven(task.epoch_s) ** 2)
    assert together.decayed(errors.parameters, {p.name: np.ones(1)}, 60.0)[p.name] == pytest.approx(np.exp(-0.1))


def test_the_growth_of_invariant_errors_carries_a_clock_on(task):
    errors = together.with_parameters(NavigationErrors(), task)
    sd = Strapdown(MODEL, task.epoch_s, 1, task.site.pos, hold_position=False)
    start = sd.start(NavState(np.array([[1.0, 0.0, 0.0, 0.0]]), np.ones((1, 3)), task.site.pos[None]))
    after, motion = sd.advance(start, np.zeros((1, 1, 3)), np.ones((1, 1, 3)))
    n = errors.states.size
    grown = Invariant(MODEL, task.site.pos, errors.states).transition(
        errors.transition(motion, np.eye(n)), start.nav, after.nav
    )
    own = slice(ERRORS.size, None)
    F = grown.f.value_and_jacobian(np.zeros((1, n)))[1][0]
    np.testing.assert_array_equal(F[own, own], errors.carry(task.epoch_s))
    clock = errors.states["ranges.clock"]
    np.testing.assert_allclose(F[clock, clock], [[1.0, task.epoch_s], [0.0, 1.0]])


def test_an_observation_without_what_is_told(task):
    made, ins, *_ = world(task, "dvl")
    with pytest.raises(ValueError, match="an observation without 'dvl'"):
        made.read({}, ins)


def test_names_of_the_three_folders():
    """A sensor has a simulation, an aid and a term of the bound."""
    from sins_env.evaluation.bound.aids import Term  # the base, beside what it makes

    assert set(classes("solvers.pipeline.aiding", aid.Sensor)) == set(NAMES)
    assert set(classes("sins_env.evaluation.bound", Term)) == set(NAMES)
    assert [spec.name for spec in specs({name: {} for name in NAMES})] == sorted(NAMES)


def test_a_base_that_is_seen_to_stand_still_has_no_velocity():
    """For all error models; a run alone has the bits of its row."""
    for env_id, more in (
        ("SINS/NavFlight-v0", {"profile": "sun2012"}),
        ("SINS/AlignStatic-v0", {"gps": {"rate_hz": 5.0}}),
    ):
        env = gymnasium.make_vec(env_id, num_envs=3, epoch=0.2, n_sub=2, duration=15.0, reveal_truth=True, **more)
        obs, _ = env.reset(seed=1)
        task, made, alone = env.unwrapped.task, solvers.make("ekf", stillness=True), solvers.make("ekf", stillness=True)
        made.reset(task, generators((3,)), 3)
        start = NavState(*(part[2] for part in task.start))
        alone.reset(dataclasses.replace(task, start=start), np.random.default_rng(0), 1)
        for k in range(task.num_epochs):
            answer = made.step(obs)
            one = alone.step({name: value[2] for name, value in obs.items()})
            np.testing.assert_array_equal(one, answer[2])
            found = made.diagnostics()
            if k < 40:
                assert np.isnan(found.get("zero_velocity_nis", np.nan)).all()
            obs = env.step(answer)[0]
        assert (found["zero_velocity_nis"] < 20.0).all()
        vel = made.filter.estimate(made.running.belief).cov[:, made.running.states["dv"], made.running.states["dv"]]
        assert np.sqrt(vel[:, 0, 0]).max() < 0.01


def test_a_parameter_without_a_spread_is_no_state():
    known = {
        "dvl": {"scale_ppm": 0.0, "mounting_mrad": 0.0},
        "height": {"bias_m": 0.0},
        "heading": {"mounting_deg": 0.0},
    }
    error, made = fly("ckf", known, 4)
    assert made.running.states.names == ERRORS.names
    assert nees(error, made.covariance()).mean() < stats.chi2.ppf(0.9995, 9 * 4) / 4
