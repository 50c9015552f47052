"""The bound of flights: dynamics against nonlinear strapdown, noise and start against draws, filter against dense algebra."""

import dataclasses
import math

import numpy as np
import pytest
from oracles.wrong_dynamics import body_is_level, no_acceleration, rate_reversed
from scipy import linalg

from sins_env import attitude, earth
from sins_env.evaluation import get_task
from sins_env.evaluation.bound import bounds, error_dynamics
from sins_env.evaluation.bound.error_dynamics import DP, DV, PHI, ErrorDynamics, true_motion
from sins_env.evaluation.bound.fisher import fisher_factor
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.tasks import catalogue as tasks
from sins_env.specs import GpsSpec
from sins_env.types import NavState
from sins_env.units import ARCSEC, DEG, DEG_PER_H, UG
from solvers.pipeline.strapdown import Strapdown

GATE = 1e-5
ACCEL, GYRO = slice(9, 12), slice(12, 15)
FLIGHTS = [name for name in tasks.names() if name.startswith("flight")]
FIXED = ("flight-sun2012-fixed-v0", "flight-zhao2010-v0")


def flight(profile, **kwargs):
    task = get_task(f"flight-{profile}-v0")
    return dataclasses.replace(task, kwargs={**task.kwargs, **kwargs})


def world_of(task, runs=1):
    env = task.make(runs, reveal_truth=True)
    _, info = task.reset(env, range(runs))
    return env.unwrapped.episode.world, info


# ---- the value ----


@pytest.mark.parametrize("name", FLIGHTS)
def test_every_flight_has_a_bound(name):
    """The thresholds are three times the bound at T, rounded up."""
    task = get_task(name)
    bound = bounds.find(task)
    assert bound.sigma.shape == (len(bound.t), 9)
    assert bool(bound.holds) == (name not in FIXED)
    assert bound.fits(Criteria.of(task, world_of(task)[0].task))
    np.testing.assert_allclose(bound.final, bound.sigma[-1])
    level, azimuth = bound.final[:2].max() / ARCSEC, bound.final[2] / DEG
    assert task.delta_azimuth_deg == pytest.approx(math.ceil(3 * azimuth / 0.1) * 0.1)
    assert task.delta_level_arcsec == math.ceil(3 * level / 10) * 10


def test_golden_values():
    """docs/mathematics/bound.md#golden-values, another code: mean over time of the heading, at T, over the last 600 s; position."""

    def heading(profile):
        return bounds.find(flight(profile)).sigma[:, 2] / DEG

    sun, physical = heading("sun2012"), heading("sun2012-physical")
    assert (sun.mean(), sun[-1]) == (pytest.approx(1.85, abs=0.01), pytest.approx(0.74, abs=0.005))
    assert physical[-600:].mean() == pytest.approx(0.103, abs=0.001)
    for spread in (30, 60, 90):
        assert heading(f"hotstart{spread}")[-1] == pytest.approx(0.108, abs=0.0005)
    for profile, golden in (("lu-gauss", 0.4797), ("lu-mixture", 0.4797 / math.sqrt(0.7927))):
        variance = np.square(bounds.find(flight(profile)).sigma[100:, 6:]).sum(axis=1)
        assert np.sqrt(variance).mean() == pytest.approx(golden, rel=2e-3)


def test_the_length_of_an_epoch_does_not_matter():
    """A factor dt too much or too little would."""
    short, long = (
        bounds.compute(flight("hotstart30", epoch=epoch, n_sub=n)).final for epoch, n in ((0.1, 1), (0.5, 5))
    )
    np.testing.assert_allclose(long, short, rtol=2e-3)


def test_fixes_that_are_not_gaussian_tell_less():
    """As Gaussian ones of R / 0.7927, velocity and position alike."""
    spread = 1 / math.sqrt(fisher_factor(GpsSpec(contamination=0.2), 6))
    gps = {"vel_std_mps": 0.1 * spread, "pos_std_m": [10 * spread, 10 * spread, 3 * spread]}
    mixed, plain = (bounds.compute(flight(*of, duration=80.0)) for of in (("lu-mixture",), ("lu-gauss",)))
    wider = bounds.compute(flight("lu-gauss", gps=gps, duration=80.0))
    np.testing.assert_allclose(mixed.sigma, wider.sigma, rtol=1e-9)
    assert np.all(mixed.sigma > plain.sigma)
    assert np.all(mixed.final[6:] > 1.11 * plain.final[6:])


def test_an_outage_is_seen():
    plain, outage = (
        bounds.compute(flight("hotstart30", duration=150.0, **more)).sigma
        for more in ({}, {"gps": {"outages_s": [[60.0, 120.0]]}})
    )
    np.testing.assert_allclose(outage[:60], plain[:60])
    assert np.all(outage[119, 6:] > 3 * plain[119, 6:])
    assert np.all(outage[130, 6:] < 2 * plain[130, 6:])


@pytest.mark.parametrize("more", [{"imu": "perfect", "gps": "perfect"}, {"start": "unknown", "coarse": 50.0}])
def test_odd_settings(more):
    bound = bounds.compute(flight("sun2012", duration=130.0, **more))
    assert bool(bound.holds) == ("start" not in more)
    assert np.isfinite(bound.sigma).all()


# ---- the dynamics ----


def nonlinear(task, seconds, epoch, size=1e-3):
    """Difference quotient of the noise-free strapdown with respect to every state's 1 sigma, (15, 15)."""
    world, info = world_of(dataclasses.replace(task, kwargs={**task.kwargs, "epoch": epoch}))
    start, site, model = info["truth"], world.task.site, ErrorDynamics(world)
    sigma = np.sqrt(np.diag(model.P0))
    x = size * sigma * np.concatenate([np.eye(15), -np.eye(15)])
    q = attitude.multiply(attitude.from_rotvec(-x[:, PHI]), start["q_nb"])
    pos = earth.displace(model.earth, start["pos"], x[:, DP])
    ins = Strapdown(model.earth, epoch, 1, site.pos, hold_position=False)
    state = ins.start(NavState(q, start["vel"] + x[:, DV], pos))
    motion = world.trajectory.chunk(0, round(seconds / epoch))
    for k in range(motion.dtheta.shape[1]):
        bias = epoch * x[:, None]
        state, _ = ins.advance(state, motion.dtheta[0, k] + bias[..., GYRO], motion.dvel[0, k] + bias[..., ACCEL])
    end, out = state.nav, np.diag(sigma)
    q = attitude.multiply(end.q_nb[:15], attitude.conjugate(end.q_nb[15:]))
    out[DV] = (end.vel[:15] - end.vel[15:]).T / (2 * size)
    out[PHI] = (-2 * np.sign(q[:, :1]) * q[:, 1:]).T / (2 * size)
    truth = motion.state.pos[0, -1]
    metres = [earth.offset(model.earth, truth, place) for place in (end.pos[:15], end.pos[15:])]
    out[DP] = (metres[0] - metres[1]).T / (2 * size)
    return out


def linear(task, seconds, spoil=None):
    """The product of F, columns scaled to 1 sigma."""
    task = dataclasses.replace(task, kwargs={**task.kwargs, "duration": seconds})
    world, _ = world_of(task)
    model = ErrorDynamics(world)
    product = np.diag(np.sqrt(np.diag(model.P0)))
    for part in true_motion(task, world.task, 1):
        F = model.transitions(part if spoil is None else spoil(model, part))[0]
        for step in F if spoil is not _no_place else _without_place(F):
            product = step @ product
    return product


def apart(a, b):
    """The largest difference, each row in units of its largest entry."""
    return np.max(np.abs(a - b) / np.abs(b).max(axis=1, keepdims=True))


@pytest.fixture(scope="module")
def quotients():
    """At half the epoch: the strapdown's own error in the vertical channel is 2e-5 after 200 s, and falls with its square."""
    return {name: (s, nonlinear(flight(name), s, 0.05)) for name, s in (("lu-gauss", 200.0), ("hotstart30", 120.0))}


@pytest.mark.parametrize("name", ["lu-gauss", "hotstart30"])
def test_dynamics_are_those_of_the_strapdown(quotients, name):
    """Acceleration, roll and turn, at 40 and 110 m/s, every state and row; measured 5e-6 up, 3e-7 in the others."""
    seconds, expected = quotients[name]
    assert apart(linear(flight(name), seconds), expected) < GATE


def _at_the_start(model, part):
    return part._replace(pos=np.broadcast_to([34 * DEG, 108 * DEG, 0.0], part.pos.shape))


def _slow(model, part):
    return part._replace(vel=0 * part.vel)


def _no_place(model, part):
    return part


def _without_place(F):
    F = F.copy()
    F[:, :9, DP] = np.eye(9)[:, DP]
    return F


@pytest.mark.parametrize("spoil", [body_is_level, no_acceleration, rate_reversed, _at_the_start, _slow, _no_place])
def test_the_gate_sees_errors(quotients, spoil):
    seconds, expected = quotients["lu-gauss"]
    assert apart(linear(flight("lu-gauss"), seconds, spoil), expected) > GATE


def test_sensitivity_to_a_lever_arm():
    """H against differences of the antenna's velocity and position."""
    task = flight("hotstart30", duration=80.0, gps={"lever_arm_m": [0.5, 1.0, 2.0]})
    world, _ = world_of(task)
    model = ErrorDynamics(world)
    part = list(true_motion(task, world.task, 1))[-1]
    C, rate = part.C_end[0, -1], part.rate_end[0, -1]

    def antenna(x):
        turned = attitude.to_dcm(attitude.from_rotvec(-x[PHI])) @ C
        return np.concatenate([x[DV] + turned @ np.cross(rate + x[GYRO], model.lever), x[DP] + turned @ model.lever])

    step = 1e-4 * np.eye(15)
    quotient = np.array([(antenna(x) - antenna(-x)) / 2e-4 for x in step]).T
    np.testing.assert_allclose(model.sensitivity(part)[0, -1], quotient, atol=1e-7)


# ---- noise and start ----


def test_process_noise_is_what_the_sensors_draw():
    """Noise that swells and fades, over 100 s of six sensors in 40 runs: within 4 standard errors, in four parts of the wave."""
    runs, epochs = 40, 1000
    world, _ = world_of(flight("zhao2010"))
    world.reset([np.random.default_rng(run) for run in range(runs)], {})  # which measures nothing yet
    model, motion = ErrorDynamics(world), world.trajectory.chunk(0, epochs)
    h = world.task.epoch_s
    truth = error_dynamics.Truth(0, *[None] * 6, np.ones(epochs, dtype=bool), None, np.zeros(epochs))
    Q = model.noise(truth, np.broadcast_to(np.eye(15), (1, epochs, 15, 15)))[0]
    measured = world.imu.measure(motion.dtheta, motion.dvel)
    for states, true, found, triad in (
        (PHI, motion.dtheta, measured[0], world.imu.gyro),
        (DV, motion.dvel, measured[1], world.imu.accel),
    ):
        noise = (found - true)[:, :, 0] - h * triad.bias[:, None]
        for part in np.split(np.arange(epochs), 4):
            expected = np.trace(Q[part][:, states, states], axis1=1, axis2=2)
            drawn = np.square(noise[:, part]).sum(axis=2).mean(axis=0)
            error = math.sqrt(2 * np.square(expected).sum() / (3 * runs))
            assert abs(drawn.sum() - expected.sum()) < 4 * error


def test_process_noise_reaches_the_position():
    """Of velocity's white noise S: [S h, S h^2 / 2] on velocity and position after an epoch, to first order in h^3."""
    task = flight("lu-gauss", duration=1.0)
    world, _ = world_of(task)
    model = ErrorDynamics(world)
    part = next(true_motion(task, world.task, 1))
    Q = model.noise(part, model.transitions(part))[0, 0]
    S, h = (50 * UG) ** 2, 0.1
    np.testing.assert_allclose(np.diag(Q)[DV], S * h, rtol=1e-4)
    np.testing.assert_allclose(np.diag(Q[DV, DP]), S * h**2 / 2, rtol=1e-4)
    np.testing.assert_allclose(np.diag(Q)[PHI], (0.01 * DEG / 60) ** 2 * h, rtol=1e-4)
    assert not Q[9:].any()


@pytest.mark.parametrize("profile", ["lu-gauss", "sun2012", "hotstart60"])
def test_start_covariance_is_that_of_the_draws(profile):
    """Of 3000 runs: every variance within 5 standard errors, every correlation within 5."""
    runs = 3000
    world, info = world_of(flight(profile, duration=1.0), runs)
    start, truth, model = info["start"], info["truth"], ErrorDynamics(world)
    phi = attitude.misalignment(start["q_nb"], truth["q_nb"])
    pos = earth.offset(model.earth, truth["pos"], start["pos"])
    x = np.concatenate([start["vel"] - truth["vel"], phi, pos, world.imu.accel.bias, world.imu.gyro.bias], axis=1)
    x = x / np.sqrt(np.diag(model.P0))
    if profile == "hotstart60":
        x = np.delete(x, [3, 4, 5], axis=1)  # headings beyond 180 deg wrap
    drawn = x.T @ x / runs
    np.testing.assert_array_less(np.abs(np.diag(drawn) - 1), 5 * math.sqrt(2 / runs))
    np.testing.assert_array_less(np.abs(drawn - np.diag(np.diag(drawn))), 5 / math.sqrt(runs))


# ---- the recursion ----


def test_covariance_is_that_of_a_dense_least_squares_problem():
    """The posterior of the last state from the joint covariance of start and noise: 80 s with a turn, lever arm, gap, outliers.

    The six states of a Doppler log in the water come behind.
    """
    aids = {"dvl": {"track": "water", "rate_hz": 0.5, "outages_s": [[60.0, 70.0]]}}
    K, h, share = 80, 1.0, GpsSpec(contamination=0.2)
    gps = {"lever_arm_m": [0.5, 1.0, 2.0], "outages_s": [[30.0, 45.0]], "contamination": 0.2}
    task = flight("hotstart30", duration=80.0, epoch=h, n_sub=10, gps=gps, aids=aids)
    world, _ = world_of(task)
    model = ErrorDynamics(world)
    (part,) = true_motion(task, world.task, 1)
    F, H, n = model.transitions(part)[0], model.sensitivity(part)[0], 21
    drive = [(100 * UG) ** 2] * 3 + [(0.1 * DEG / 60) ** 2] * 3 + [0.0] * 9
    std = [0.1] * 3 + [5 * DEG, 5 * DEG, 30 * DEG] + [10.0] * 3 + [1000 * UG] * 3 + [DEG_PER_H] * 3
    std += [2e-3] + [3e-3] * 3 + [0.2] * 2
    white = np.diag(drive + [0.0] * 4 + [2 * 0.2**2 / 1800] * 2)
    joint = linalg.block_diag(np.diag(np.square(std)), *(h / 2 * (white + F[k] @ white @ F[k].T) for k in range(K)))
    state, rows, noise = np.eye(n, (K + 1) * n), [], []
    for k in range(K):
        state = F[k] @ state
        state[:, (k + 1) * n : (k + 2) * n] += np.eye(n)
        if not 30 < k + 1 <= 45:
            rows.append(H[k] @ state)
            noise += [x / fisher_factor(share, 6) for x in [0.01] * 3 + [100.0] * 3]
        if k % 2 and not 60 < k + 1 <= 70:
            back, v = part.C_end[0, k].T, part.vel_end[0, k]
            y, zero = back @ v, np.zeros((3, 3))
            skew = lambda a: np.cross(a, np.eye(3)).T  # noqa: E731
            log = np.hstack([back, -back @ skew(v), zero, zero, zero, -y[:, None], -skew(y), back[:, :2]])
            rows.append(log @ state)
            noise += [0.01**2] * 3
    expected = posterior_std(state, joint, rows, noise)[[3, 4, 5, 0, 1, 2, 6, 7, 8]]
    np.testing.assert_allclose(bounds.compute(task).final, expected, rtol=1e-8)


def posterior_std(state, joint, rows, noise):
    """The spread of ``state`` @ u for u ~ N(0, joint) after ``rows`` @ u was seen with variances ``noise``."""
    M = np.concatenate(rows)
    cross = state @ joint @ M.T
    S = M @ joint @ M.T + np.diag(noise)
    return np.sqrt(np.diag(state @ joint @ state.T - cross @ linalg.solve(S, cross.T, assume_a="pos")))


def test_covariance_with_positions_alone_and_ranges_is_that_of_a_dense_problem():
    """Fixes without a velocity, then three satellites of five with clock and multipath: rows are differences of the geometry.

    The satellites, and which of them are seen, are those of the observations.
    """
    arm, S = np.array([0.4, -1.0, 1.5]), 5
    ranges = {"satellites": S, "multipath_m": 2.0, "few_s": [[40.0, 60.0]], "rate_hz": 0.5, "lever_arm_m": arm.tolist()}
    gps = {"velocity": False, "outages_s": [[30.0, 100.0]]}
    K, h, n = 60, 1.0, 15 + 2 + S
    task = flight("hotstart30", duration=60.0, epoch=h, n_sub=10, gps=gps, aids={"ranges": ranges})
    env = task.make(1)
    obs, info = task.reset(env, [0])
    told = np.concatenate([info["start"][name] for name in ("q_nb", "vel", "pos")], axis=-1)
    world = env.unwrapped.episode.world
    model = ErrorDynamics(world)
    (part,) = true_motion(task, world.task, 1)
    F = np.zeros((K, n, n))
    F[:, :15, :15] = model.transitions(part)[0, :, :15, :15]
    decay = h / 300.0
    F[:, 15:, 15:] = linalg.block_diag([[1.0, h], [0.0, 1.0]], (1 - decay + decay**2 / 2 - decay**3 / 6) * np.eye(S))
    c2 = 299_792_458.0**2
    drive = [(100 * UG) ** 2] * 3 + [(0.1 * DEG / 60) ** 2] * 3 + [0.0] * 9
    white = np.diag(drive + [c2 * 1e-19, 2 * math.pi**2 * c2 * 2e-20] + [2 * 2.0**2 / 300] * S)
    std = [0.1] * 3 + [5 * DEG, 5 * DEG, 30 * DEG] + [10.0] * 3 + [1000 * UG] * 3 + [DEG_PER_H] * 3
    std += [100.0, 10.0] + [2.0] * S
    joint = linalg.block_diag(np.diag(np.square(std)), *(h / 2 * (white + F[k] @ white @ F[k].T) for k in range(K)))
    state, rows, noise = np.eye(n, (K + 1) * n), [], []
    for k in range(K):
        state = F[k] @ state
        state[:, (k + 1) * n : (k + 2) * n] += np.eye(n)
        obs = env.step(told)[0] if k else obs
        if k + 1 <= 30:
            rows.append(np.eye(3, n, 6) @ state)
            noise += [100.0] * 3
        seen = obs["ranges_valid"][0] == 1
        assert seen.sum() == (S if k < 40 else 3) * (k % 2)
        if not seen.any():
            continue
        satellites = obs["satellites"][0, seen]
        pos = earth.displace(model.earth, part.pos[0, k], part.vel_end[0, k] * h / 2)

        def shown(x, k=k, seen=seen, satellites=satellites, pos=pos):
            C = attitude.to_dcm(attitude.from_rotvec(-x[PHI])) @ part.C_end[0, k]
            place = earth.displace(model.earth, pos, x[DP] + C @ arm)
            vel = part.vel_end[0, k] + x[DV] + C @ np.cross(part.rate_end[0, k] + x[GYRO], arm)
            vel = earth.ecef_to_enu(pos[0], pos[1]).T @ vel
            away = satellites[:, :3] - earth.to_ecef(model.earth, place)
            far = np.linalg.norm(away, axis=-1)
            rate = np.sum(away * (satellites[:, 3:] - vel), axis=-1) / far
            return np.concatenate([far + x[15] + x[17:][seen], rate + x[16]]), away / far[:, None]

        step = np.array([1e-2] * 3 + [1e-4] * 3 + [1.0] * 3 + [1.0] * 3 + [1e-4] * 3 + [1.0] * (2 + S))
        H = np.array([(shown(x)[0] - shown(-x)[0]) / (2 * s) for x, s in zip(np.diag(step), step, strict=True)]).T
        rows.append(H @ state)
        up = earth.ecef_to_enu(pos[0], pos[1])[2]
        sine = shown(np.zeros(n))[1] @ up
        noise += [*np.square(3.0 / sine), *np.square(0.1 / sine)]
    env.close()
    expected = posterior_std(state, joint, rows, noise)[[3, 4, 5, 0, 1, 2, 6, 7, 8]]
    np.testing.assert_allclose(bounds.compute(task).final, expected, rtol=1e-5)


def test_units_do_not_matter():
    """Why states are not scaled: not one bit changes where metres, m/s and rad become 2^-k of themselves."""
    task = flight("hotstart30", duration=10.0)
    world, _ = world_of(task)
    model = ErrorDynamics(world)
    unit = 2.0 ** np.array([-4] * 3 + [-8] * 3 + [3] * 3 + [-9] * 3 + [-20] * 3)
    (part,) = true_motion(task, world.task, 1)
    F, H = model.transitions(part)[0], model.sensitivity(part)[0]
    Q = model.noise(part, F[None])[0]
    P = model.P0
    scaled = P / unit / unit[:, None]
    for k in range(100):
        P = F[k] @ P @ F[k].T + Q[k]
        G = F[k] * unit / unit[:, None]
        scaled = G @ scaled @ G.T + Q[k] / unit / unit[:, None]
        if part.fix[k]:
            P, scaled = bounds.correct(P, H[k], model.R), bounds.correct(scaled, H[k] * unit, model.R)
    np.testing.assert_array_equal(scaled * unit * unit[:, None], P)
