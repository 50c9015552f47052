"""The parked car: its motion by differences of attitude and position, settled tilts by hand, draws by their statistics."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import simpson
from scipy.spatial.transform import Rotation
from scipy.stats import kstest, poisson

from sins_env import attitude, earth
from sins_env.trajectory import Vehicle, car
from sins_env.trajectory.car import Event
from sins_env.types import Site

DEG = np.pi / 180
SITE = Site(39.96 * DEG, 116.3 * DEG, 50.0)
WGS84 = earth.get("wgs84")
BUSY = [Event(0.5, "in", "front-left"), Event(3.0, "rock", scale=2.0), Event(4.0, "door", "rear-right", 2.0)]


def parked(events, runs=1, duration=300.0, n_sub=10, rate=2.0, heading=None, seed=0, epoch=0.1):
    car = Vehicle(SITE, epoch, n_sub, duration, rate)
    rngs = np.random.default_rng(seed).spawn(runs)
    return car, car.reset(rngs, None if heading is None else np.full(runs, heading), [events] * runs)


def euler(q):
    return np.stack(attitude.to_euler(attitude.to_dcm(q)), axis=-1)


def settled(events):
    """Heading, pitch, roll in mrad and height in mm that a script leaves, relative to the start."""
    vehicle, start = parked(events, heading=0.7)
    end = vehicle.chunk(2999, 1).state
    turned = 1e3 * (euler(end.q_nb[0, 0]) - euler(start.q_nb[0]))
    return np.append(turned, 1e3 * (end.pos[0, 0, 2] - start.pos[0, 2]))


def test_people_leave_the_tilt_of_their_weight_and_doors_leave_none():
    """By hand: heading, pitch, roll of both roll modes, and height at the IMU (0.2, -0.2, 0.9) m."""
    assert_allclose(settled([Event(1.0, "door", scale=2.0), Event(9.0, "rock")]), 0.0, atol=1e-9)
    for seat, right, front in (("front-right", 1, 1), ("rear-left", -1, -1)):
        found = settled([Event(1.0, "in", seat, 1.2)])
        assert_allclose(found[:3], 1.2 * np.array([0.25 * right, -1.5 * front, 2.5 * right]), atol=2e-5)
        arm = (
            -0.2 * found[2] - 0.2 * found[1]
        )  # U: pitch lifts what is before the axis, roll lowers what is right of it
        assert found[3] == pytest.approx(-2.0 * 1.2 + arm, abs=0.06)  # parked askew by half a degree
    assert_allclose(settled([Event(1.0, "in"), Event(30.0, "out")]), 0.0, atol=1e-9)


def test_a_quiet_car_stands_still():
    vehicle, start = parked([], runs=2, heading=1.0)
    motion = vehicle.chunk(0, 5)
    assert_array_equal(motion.state.vel, 0.0)
    assert_allclose(motion.state.pos, np.broadcast_to(SITE.pos, (2, 5, 3)), rtol=1e-15)
    C = attitude.to_dcm(start.q_nb)
    up = C.mT @ [0, 0, earth.gravity(WGS84, SITE.latitude, SITE.height)]
    assert_allclose(motion.dvel.sum(axis=(1, 2)) / 0.5, up, atol=1e-12)
    assert_allclose(motion.dtheta.sum(axis=(1, 2)) / 0.5, C.mT @ earth.rate_n(WGS84, SITE.latitude), rtol=1e-11)
    pitch_roll = np.stack([euler(parked([], runs=400)[1].q_nb)[:, i] for i in (1, 2)]) / DEG
    assert_allclose(pitch_roll.std(axis=1), 0.5, rtol=4 / np.sqrt(800))


def test_a_heading_that_is_not_given_is_drawn_over_the_circle():
    heading = euler(parked([], runs=400)[1].q_nb)[:, 0] % (2 * np.pi)
    assert kstest(heading / (2 * np.pi), "uniform").pvalue > 1e-3
    assert_allclose(euler(parked([], runs=2, heading=5.0)[1].q_nb)[:, 0] % (2 * np.pi), 5.0, atol=0.1)


def position(state):
    """ENU metres about the site, from latitude, longitude and height: (..., 3)."""
    R_M, R_N = earth.radii(WGS84, SITE.latitude)
    d = (state.pos - SITE.pos) * [R_M + SITE.height, (R_N + SITE.height) * np.cos(SITE.latitude), 1.0]
    return d[..., [1, 0, 2]]


def test_a_person_moves_the_imu_sideways_and_lengthways():
    """By hand, mm: right 0.9 m x 2.5 mrad of roll, less 0.7 m x 0.4 of it about the upper axis, and heading at the arm."""
    vehicle, start = parked([Event(1.0, "in")], heading=0.0)
    moved = position(vehicle.chunk(2999, 1).state)[0, 0] - position(start)[0]
    assert_allclose(1e3 * moved[:2], [0.9 * 2.5 - 0.7 * 0.4 - 0.2 * 0.25, 0.9 * 1.5 + 0.9 - 0.2 * 0.25], atol=0.04)


def test_increments_are_integrals_of_the_differentiated_attitude_and_position():
    """The simulator's own rates and accelerations are not used: attitude and IMU position, differentiated."""
    vehicle, _ = parked(BUSY, runs=2, heading=2.0, seed=4)
    h, weights = 1e-3, {1: 45 / 60, 2: -9 / 60, 3: 1 / 60}
    t = 5.0 + np.arange(401) * 2.5e-4  # ten samples while it is rocked and a door opens
    at = {k: vehicle.states(t + k * h)[0] for k in range(-3, 4)}

    def dcm(k):
        return Rotation.from_quat(at[k].q_nb.reshape(-1, 4), scalar_first=True)

    turned = {k: (dcm(0).inv() * dcm(k)).as_rotvec() for k in at}
    rate = sum(w * (turned[k] - turned[-k]) for k, w in weights.items()) / h
    vel = sum(w * (position(at[k]) - position(at[-k])) for k, w in weights.items()) / h
    accel = sum(w * (at[k].vel - at[-k].vel) for k, w in weights.items()) / h
    assert np.abs(vel).max() > 0.01
    assert_allclose(vel, at[0].vel, atol=3e-6)  # a latitude's last bit is 1e-10 m
    spin = earth.rate_n(WGS84, SITE.latitude)
    g = float(earth.gravity(WGS84, SITE.latitude, SITE.height))
    to_body = dcm(0).as_matrix().reshape(2, -1, 3, 3).mT
    transport = (earth.transport_matrix(WGS84, SITE.latitude, SITE.height) @ vel[..., None])[..., 0]
    rate = rate.reshape(2, -1, 3) + (to_body @ (spin + transport)[..., None])[..., 0]
    force = (to_body @ (accel + np.cross(2 * spin, vel) + [0, 0, g])[..., None])[..., 0]
    motion = vehicle.chunk(50, 1)
    for found, density, atol in ((motion.dtheta, rate, 2e-11), (motion.dvel, force, 2e-9)):
        pieces = [simpson(density[:, 40 * i : 40 * i + 41], x=t[40 * i : 40 * i + 41], axis=1) for i in range(10)]
        assert_allclose(found[:, 0], np.stack(pieces, axis=1), rtol=0, atol=atol)
    spin_b = (attitude.to_dcm(motion.state.q_nb[:, 0]).mT @ spin[:, None])[..., 0]
    assert_allclose(motion.rate_eb_b[:, 0], rate[:, -1] - spin_b, atol=1e-9)


def test_a_long_sample_is_the_sum_of_short_ones():
    """The motion is the same at any rate: inputs lie on a grid of their own."""
    fine, coarse = (parked(BUSY, runs=2, n_sub=n, seed=1)[0].chunk(0, 120) for n in (10, 1))
    assert_allclose(fine.state.pos, coarse.state.pos, rtol=1e-15)
    assert_allclose(fine.dvel.sum(axis=2), coarse.dvel[:, :, 0], atol=1e-9)
    assert_allclose(fine.dtheta.sum(axis=2), coarse.dtheta[:, :, 0], atol=1e-12)


def test_chunks_and_neighbours_do_not_matter():
    whole = parked("mixed", runs=5, rate=20.0)[0].chunk(0, 300)
    vehicle = Vehicle(SITE, 0.1, 10, 300.0, 20.0)
    vehicle.reset(np.random.default_rng(0).spawn(5)[3:], None, ["mixed"] * 2)
    parts = [vehicle.chunk(first, count) for first, count in ((0, 7), (7, 1), (8, 150), (158, 142))]
    for i, atol in ((0, 1e-16), (1, 1e-14)):
        assert_allclose(np.concatenate([part[i] for part in parts], axis=1), whole[i][3:], rtol=0, atol=atol)
    found = np.concatenate([part.state.vel for part in parts], axis=1)
    assert_allclose(found, whole.state.vel[3:], rtol=0, atol=1e-14)


def test_events_are_poisson_in_time():
    """A door opens, shuts and slams: three inputs to each event."""
    runs, mean = 400, 30.0
    begun = [car.draw("doors", 6.0, 300.0, rng)[::3] for rng in np.random.default_rng(7).spawn(runs)]
    counts = np.array([len(one) for one in begun])
    assert counts.mean() == pytest.approx(mean, abs=4 * np.sqrt(mean / runs))
    assert counts.var() == pytest.approx(mean, rel=4 * np.sqrt(2 / runs))
    expected = poisson.pmf(30, mean)
    assert (counts == 30).mean() == pytest.approx(expected, abs=4 * np.sqrt(expected / runs))
    times = np.array([door.begin for one in begun for door in one])
    assert kstest(times / 300.0, "uniform").pvalue > 0.01


@pytest.mark.parametrize(
    ("scene", "rocks", "people"), [("people", 0.0, 0.5), ("rocking", 0.5, 0.0), ("mixed", 0.2, 0.4)]
)
def test_scenes_hold_what_their_names_say(scene, rocks, people):
    inputs = [car.draw(scene, 6.0, 300.0, rng) for rng in np.random.default_rng(2).spawn(100)]
    flat = [one for run in inputs for one in run]
    rocked = sum(one.length > 3.0 for one in flat)
    slams = sum(one.length == car.SLAM_S for one in flat)
    seated = sum(abs(one.size[1]) > 0.2e-3 and one.shape.settled == 1.0 for one in flat) / 2  # on the sill, then seated
    total = rocked + slams
    for found, share in ((rocked, rocks), (seated, people)):
        assert found / total == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / total))
    assert not car.draw("quiet", 6.0, 300.0, np.random.default_rng(0))


def test_who_leaves_weighs_what_came_in():
    """The weight on board stays between none and that of four, however long it goes on."""
    for rng in np.random.default_rng(3).spawn(20):
        inputs = [one for one in car.draw("people", 20.0, 600.0, rng) if one.shape.settled]
        assert len(inputs) > 100
        assert np.ptp(np.cumsum([one.size[4] for one in inputs])) <= 4 * 1.3 * 2.0e-3 + 1e-9
