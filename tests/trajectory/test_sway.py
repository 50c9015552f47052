"""The oracle differentiates the returned attitude and position; it shares no formula with the simulator."""

import tracemalloc

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import simpson
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from sins_env import attitude, earth
from sins_env.trajectory import STILL, THESIS, Sway, SwayMotion
from sins_env.types import Site

DEG = np.pi / 180
SITE = Site(39.96 * DEG, 116.3 * DEG, 0.0)
WGS84 = earth.get("wgs84")
#: A ship: several components of an angle, and coherent ways.
OWN = {
    "roll": [
        {"amplitude_deg": 9.0, "period_s": 4.0, "phase_deg": 20.0},
        {"amplitude_deg": 2.0, "period_s": 0.9, "phase_deg": 0.0},
    ],
    "pitch": {"amplitude_deg": 1.5, "period_s": 6.0, "phase_deg": -40.0},
    "surge": {"amplitude_m": 0.5, "period_s": 8.0, "phase_deg": 15.0},
    "sway": [{"amplitude_m": 0.2, "period_s": 7.0, "phase_deg": 90.0}],
    "heave": {"amplitude_m": 0.8, "period_s": 5.0},
}
#: Its angles with phases of each run.
DRAWN = {**OWN, "yaw": {"amplitude_deg": 30.0, "period_s": 12.0}, "pitch": {"amplitude_deg": 1.5, "period_s": 6.0}}
VARIANTS = {
    "thesis": {},
    "heading": {"heading_deg": None},
    "random": {"heading_deg": None, "random": True},
    "thesis-earth": {"earth_model": "thesis"},
    "south": {"latitude_deg": -60.0},
    "own": {"motion": SwayMotion.of(OWN), "heading_deg": 70.0},
    "own drawn": {"motion": SwayMotion.of(DRAWN), "heading_deg": None},
}


def rngs(runs, seed=0):
    return np.random.default_rng(seed).spawn(runs)


def make(epoch=0.1, n_sub=3, runs=2, seed=0, latitude_deg=39.96, earth_model="wgs84", **options):
    sway = Sway(Site(latitude_deg * DEG, SITE.longitude, 0.0, earth_model), epoch, n_sub, **options)
    start = sway.reset(rngs(runs, seed))
    return sway, start


def euler_deg(q):
    return np.degrees(np.stack(attitude.to_euler(attitude.to_dcm(q)), axis=-1))


def test_thesis_numbers():
    """docs/mathematics/simulation.md#sway, typed anew."""
    sway, _ = make(runs=1)
    state = sway.chunk(0, 300).state
    t = 0.1 * np.arange(1, 301)
    heading = 30 + 5 * np.cos(2 * np.pi * t / 7 + np.pi / 4)
    pitch = 7 * np.cos(2 * np.pi * t / 5 + np.pi / 4)
    roll = 10 * np.cos(2 * np.pi * t / 6 + np.pi / 7)
    assert_allclose(euler_deg(state.q_nb[0]), np.stack([heading, pitch, roll], axis=-1), atol=1e-11)
    for axis, (A, T) in enumerate(((0.02, 7), (0.03, 6), (0.03, 8))):
        w = 2 * np.pi / T
        basis = np.stack([np.cos(w * t), np.sin(w * t)], axis=-1)
        coefficients, residual, *_ = np.linalg.lstsq(basis, state.vel[0, :, axis], rcond=None)
        assert residual[0] < 1e-25
        assert np.hypot(*coefficients) == pytest.approx(A * w, rel=1e-12)


def test_a_motion_of_ones_own_moves_along_the_vessel():
    """Every way is amplitude cos(2 pi t / period + phase) forward, to the right and up from the mean heading."""
    sway, _ = make(runs=2, motion=SwayMotion.of(OWN), heading_deg=70.0)
    state = sway.chunk(0, 200).state
    t = 0.1 * np.arange(1, 201)
    wave = {n: [(c["amplitude_" + u], 2 * np.pi / c["period_s"], c.get("phase_deg", 0) * DEG) for c in cs]
            for n, cs, u in (("roll", OWN["roll"], "deg"), ("surge", [OWN["surge"]], "m"), ("sway", OWN["sway"], "m"))}  # fmt: skip
    roll = sum(a * np.cos(w * t + p) for a, w, p in wave["roll"])
    assert_allclose(euler_deg(state.q_nb[0])[:, 2], roll, atol=1e-11)
    assert_array_equal(state.q_nb[0], state.q_nb[1])  # all phases of angles are told
    forward, right = (sum(-a * w * np.sin(w * t + p) for a, w, p in wave[name]) for name in ("surge", "sway"))
    h = 70.0 * DEG
    assert_allclose(state.vel[0, :, 0], forward * np.sin(h) + right * np.cos(h), atol=1e-12)
    assert_allclose(state.vel[0, :, 1], forward * np.cos(h) - right * np.sin(h), atol=1e-12)
    heave = np.abs(state.vel[..., 2]).max(axis=1)
    assert_allclose(heave, 0.8 * 2 * np.pi / 5.0, rtol=2e-3)
    assert np.abs(state.vel[0, :, 2] - state.vel[1, :, 2]).max() > 0.01  # its phase is drawn


def test_a_fast_motion_is_integrated_to_rounding():
    """Increments of long samples are the sums of those of short ones, whatever the periods are."""
    fast = {
        "roll": {"amplitude_deg": 40, "period_s": 0.3, "phase_deg": 5},
        "yaw": {"amplitude_deg": 90, "period_s": 0.5},
    }
    long, short = (make(epoch=0.3, n_sub=n, runs=2, motion=SwayMotion.of(fast))[0].chunk(3, 2) for n in (1, 30))
    assert_allclose(long.dtheta[:, :, 0], short.dtheta.sum(axis=2), atol=1e-12)
    assert_allclose(long.dvel[:, :, 0], short.dvel.sum(axis=2), atol=1e-11)


def test_phases_that_are_drawn_leave_the_other_draws_as_they_were():
    starts = [
        make(runs=2, motion=SwayMotion.of({"surge": OWN["surge"], **turns}), heading_deg=None)[1]
        for turns in ({}, {"yaw": {"amplitude_deg": 0.0}})
    ]
    assert_allclose(starts[0].vel, starts[1].vel, atol=1e-15)  # the same mean heading
    angles = euler_deg(make(runs=2, motion=SwayMotion.of(DRAWN), heading_deg=None)[0].chunk(0, 200).state.q_nb)
    assert_allclose(angles[0, :, 2], angles[1, :, 2], atol=1e-11)  # roll is told, pitch and yaw are drawn
    assert np.abs(angles[0, :, 1] - angles[1, :, 1]).max() > 0.1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rol": {}}, "unknown axis of motion 'rol'; did you mean 'roll'"),
        ({"roll": {"amplitude_m": 1}}, "unknown setting of roll 'amplitude_m'; did you mean 'amplitude_deg'"),
        ({"roll": {"period_s": 1}}, "has no amplitude_deg; allowed"),
        ({"pitch": {"amplitude_deg": -1}}, r"pitch.amplitude_deg = -1; allowed: a number >= 0 and <= 180"),
        ({"pitch": [{"amplitude_deg": 41}] * 2}, "amplitudes of pitch add up to 82; allowed: at most 80"),
        ({"surge": {"amplitude_m": 2, "period_s": 1}}, "speeds of surge add up to 12.5664 m/s; allowed: at most 10"),
        ({"heave": 3}, "heave = 3; allowed: a dict of amplitude_m"),
        ([], r"motion = \[\]; allowed: thesis, random, or a dict of yaw"),
    ],
)
def test_a_motion_that_is_none_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        SwayMotion.of(given)


def test_phases_of_the_sway_are_drawn_over_the_circle():
    _, start = make(runs=800)
    for axis, (A, T) in enumerate(((0.02, 7), (0.03, 6), (0.03, 8))):
        phase = np.arccos(start.vel[:, axis] * T / (2 * np.pi * A)) / np.pi
        assert kstest(phase, "uniform").pvalue > 0.01
    assert np.abs(np.corrcoef(start.vel.T) - np.eye(3)).max() < 4 / np.sqrt(800)


def test_attitude_is_the_same_in_every_run_unless_asked():
    _, start = make(runs=3)
    assert_array_equal(start.q_nb, np.broadcast_to(start.q_nb[:1], (3, 4)))
    assert len(np.unique(start.vel[:, 0])) == 3


def test_heading_none_is_drawn_over_the_circle():
    _, start = make(runs=800, heading_deg=None)
    heading = euler_deg(start.q_nb)[:, 0] - np.degrees(5 * DEG * np.cos(np.pi / 4))
    assert kstest(heading % 360 / 360, "uniform").pvalue > 0.01
    fixed = euler_deg(make(heading_deg=120.0)[1].q_nb)[:, 0]
    assert_allclose(fixed, 120 + 5 * np.cos(np.pi / 4))


def test_random_motion_scales_amplitudes_and_periods():
    sway, _ = make(runs=60, random=True, epoch=0.1)
    angles = euler_deg(sway.chunk(0, 1500).state.q_nb)  # 150 s, at least 15 periods
    for axis, (amplitude, period) in enumerate(((5, 7), (7, 5), (10, 6))):
        x = angles[:, :, axis]
        x = x - 30 if axis == 0 else x
        size = np.abs(x).max(axis=1) / amplitude
        assert size.min() > 0.495
        assert size.max() < 1.505
        assert np.ptp(size) > 0.7
        crossings = np.count_nonzero(np.diff(np.sign(x), axis=1), axis=1)
        ratio = 300 / crossings / period
        assert ratio.min() > 0.66
        assert ratio.max() < 1.46
        assert np.ptp(ratio) > 0.4


def test_still_base():
    sway, start = make(motion=STILL, runs=2)
    motion = sway.chunk(0, 5)
    assert_array_equal(motion.state.vel, 0.0)
    assert_allclose(euler_deg(motion.state.q_nb), np.broadcast_to([30.0, 0.0, 0.0], (2, 5, 3)), atol=1e-13)
    C = attitude.to_dcm(start.q_nb)[0]
    rate, force = motion.dtheta[0].sum(axis=(0, 1)) / 0.5, motion.dvel[0].sum(axis=(0, 1)) / 0.5
    assert_allclose(rate, C.T @ earth.rate_n(WGS84, SITE.latitude), rtol=1e-12, atol=1e-19)
    assert_allclose(force, C.T @ [0, 0, earth.gravity(WGS84, SITE.latitude)], atol=1e-13)


def rates_by_differences(options, t, runs=2):
    """omega_ib^b and f^b (runs, T, 3) at times t, by sixth-order differences of attitude and velocity."""
    h = 2e-3
    weights = {1: 45 / 60, 2: -9 / 60, 3: 1 / 60}
    sway, _ = make(runs=runs, **options)
    model = earth.get(options.get("earth_model", "wgs84"))
    latitude = options.get("latitude_deg", 39.96) * DEG
    at = {k: sway.states(t + k * h)[0] for k in range(-3, 4)}
    middle = at[0]
    shape = middle.vel.shape

    def dcm(q):
        return Rotation.from_quat(q.reshape(-1, 4), scalar_first=True)

    def turned(k):
        return (dcm(middle.q_nb).inv() * dcm(at[k].q_nb)).as_rotvec()

    turn = sum(w * (turned(k) - turned(-k)) for k, w in weights.items()) / h
    accel = sum(w * (at[k].vel - at[-k].vel) for k, w in weights.items()) / h
    R_M, R_N = earth.radii(model, latitude)
    v = middle.vel
    transport = np.stack([-v[..., 1] / R_M, v[..., 0] / R_N, v[..., 0] * np.tan(latitude) / R_N], axis=-1)
    spin = model.rate * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    to_body = np.swapaxes(dcm(middle.q_nb).as_matrix().reshape(*shape, 3), -1, -2)
    rate = turn.reshape(shape) + (to_body @ (spin + transport)[..., None])[..., 0]
    force = accel + np.cross(2 * spin, v) + [0.0, 0.0, float(earth.gravity(model, latitude))]
    return rate, (to_body @ force[..., None])[..., 0]


@pytest.mark.parametrize("options", VARIANTS.values(), ids=VARIANTS)
def test_increments_are_integrals_of_the_differentiated_motion(options):
    sway, _ = make(**options)
    motion = sway.chunk(30, 2)
    nodes = np.linspace(3.0, 3.2, 6 * 16 + 1)
    rate, force = rates_by_differences(options, nodes)
    for found, density, atol in ((motion.dtheta, rate, 3e-12), (motion.dvel, force, 1e-11)):
        pieces = [simpson(density[:, 16 * i : 16 * i + 17], x=nodes[16 * i : 16 * i + 17], axis=1) for i in range(6)]
        assert_allclose(found.reshape(2, 6, 3), np.stack(pieces, axis=1), rtol=0, atol=atol)


def test_velocity_is_the_derivative_of_position():
    sway, _ = make(runs=3, heading_deg=None)
    t, h = np.linspace(1.0, 5.0, 9), 1e-3
    before, after, state = (sway.states(t + s * h)[0] for s in (-1, 1, 0))
    R_M, R_N = earth.radii(WGS84, SITE.latitude)
    d = (after.pos - before.pos) / (2 * h) * [R_M, R_N * np.cos(SITE.latitude), 1.0]
    assert_allclose(d[..., [1, 0, 2]], state.vel, atol=2e-6)


def test_rate_for_the_lever_arm():
    sway, _ = make(runs=2)
    motion = sway.chunk(0, 20)
    rate, _ = rates_by_differences({}, 0.1 * np.arange(1, 21))
    C = attitude.to_dcm(motion.state.q_nb)
    spin = np.swapaxes(C, -1, -2) @ earth.rate_n(WGS84, SITE.latitude)
    assert_allclose(motion.rate_eb_b, rate - spin, atol=1e-11)


@pytest.mark.parametrize("n_sub", [30, 10, 3, 1])
def test_vibration_does_not_alias(n_sub):
    """4.8 g at 300 Hz sampled at 300 Hz would be a constant 4.8 g; the increments are the fine integral."""
    sway, _ = make(epoch=0.1, n_sub=n_sub, runs=1, seed=3, vibration=True)
    quiet, _ = make(epoch=0.1, n_sub=n_sub, runs=1, seed=3)
    motion, still = sway.chunk(0, 10), quiet.chunk(0, 10)
    per_sample = 6000 // n_sub
    t = np.linspace(0.0, 0.1, 6001)
    state, _ = sway.states(t)
    omega = 2 * np.pi * np.array([300.0, 250.0, 400.0])
    speed = 9.80665 * np.array([4.8, 3.8, 4.0]) / omega
    phase = np.empty(3)
    for axis in range(3):  # v cos p at the start, -v sin p a quarter of a period later
        both = [one.states(np.array([0.0, np.pi / 2 / omega[axis]]))[0].vel[0, :, axis] for one in (sway, quiet)]
        begin, later = both[0] - both[1]
        assert np.hypot(begin, later) == pytest.approx(speed[axis], rel=1e-9)
        phase[axis] = np.arctan2(-later, begin)
    accel = -omega * speed * np.sin(omega * t[:, None] + phase)
    C = attitude.to_dcm(state.q_nb[0])
    spin = earth.rate_n(WGS84, SITE.latitude)
    extra = accel + np.cross(2 * spin, speed * np.cos(omega * t[:, None] + phase))
    extra = (np.swapaxes(C, -1, -2) @ extra[..., None])[..., 0]
    steps = [slice(per_sample * i, per_sample * (i + 1) + 1) for i in range(n_sub)]
    expected = np.stack([simpson(extra[s], x=t[s], axis=0) for s in steps])
    assert_allclose((motion.dvel - still.dvel)[0, 0], expected, rtol=0, atol=2e-8)
    assert n_sub < 30 or np.abs(motion.dvel - still.dvel).max() > 5e-3  # 4.0 g over half a period is there
    drift = np.abs((motion.dvel - still.dvel).sum(axis=(0, 1, 2)))
    assert drift.max() < 0.06  # m/s in 1 s; aliased it would be tens
    assert np.abs(motion.dtheta - still.dtheta).max() < 1e-11


def test_vibration_in_the_velocity_is_the_integral_of_the_increments():
    sway, start = make(epoch=0.05, n_sub=15, runs=2, vibration=True, motion=STILL)
    motion = sway.chunk(0, 4)
    total = motion.dvel.sum(axis=2).cumsum(axis=1)
    C = attitude.to_dcm(start.q_nb)[:, None]
    g = earth.gravity(WGS84, SITE.latitude) * 0.05 * np.arange(1, 5)
    gained = (C @ total[..., None])[..., 0] - np.stack([0 * g, 0 * g, g], axis=-1)
    assert_allclose(gained, motion.state.vel - start.vel[:, None], atol=1e-6)  # Coriolis of 0.01 m/s


@pytest.mark.parametrize(
    "options",
    [{}, {"vibration": True}, {"random": True, "heading_deg": None}, VARIANTS["own"], VARIANTS["own drawn"]],
    ids=["thesis", "vibration", "random", "own", "own drawn"],
)
def test_chunks_and_neighbours_do_not_matter(options):
    whole, _ = make(runs=3, **options)
    expected = whole.chunk(0, 12)
    alone = Sway(SITE, 0.1, 3, **options)
    alone.reset(rngs(3)[2:])
    parts = [alone.chunk(first, count) for first, count in ((0, 5), (5, 1), (6, 6))]
    for found, wanted in zip(zip(*(p[:2] for p in parts), strict=True), expected[:2], strict=True):
        assert_allclose(np.concatenate(found, axis=1)[0], wanted[2], rtol=0, atol=1e-14)
    q = np.concatenate([p.state.q_nb for p in parts], axis=1)[0]
    assert_allclose(q, expected.state.q_nb[2], rtol=0, atol=1e-15)


@pytest.mark.parametrize("options", [{}, {"random": True}], ids=["thesis", "random"])
def test_memory_is_that_of_a_chunk(options):
    sway, _ = make(n_sub=30, runs=16, **options)
    sway.chunk(0, 10)
    tracemalloc.start()
    for first in range(0, 100, 10):
        sway.chunk(first, 10)
    late = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert late < 40e6  # bytes; one chunk's increments are 0.23 MB, the integrals of 16 random runs 30 MB


def test_options_leave_the_other_draws_as_they_were():
    t = np.linspace(0.0, 5.0, 20)
    plain, turned, shaken = (
        make(**options)[0].states(t)[0] for options in ({}, {"heading_deg": None}, {"vibration": True})
    )
    assert_array_equal(turned.vel, plain.vel)
    away = 6.4e6 * np.abs(shaken.pos - plain.pos)[..., :2].max()
    assert 0 < away < 2e-4  # m, of vibration; other phases of the sway would be centimetres
    assert THESIS.sway_m == (0.02, 0.03, 0.03)
