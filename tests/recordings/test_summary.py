"""What is said of a recording: gaps, rest, and a first heading, from increments made by plain formulas."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import made
from scipy.spatial.transform import Rotation

from sins_env import earth
from sins_env.recordings import Gap, Gnss, Recording, Reference, heading_pitch_roll, load, north, summarise
from sins_env.recordings.summary import inertial_alignment
from sins_env.specs import IMU_PRESETS, ImuSpec
from sins_env.types import Site

SITE = Site(np.radians(34.0), 1.9, 400.0)
RATE = 100.0
WGS84 = earth.get("wgs84")


def parked(heading, pitch, roll, duration=200.0, sway_deg=0.0, **parts):
    """A base on the spot: earth's rate and gravity in a body that sways about its z axis, by scipy alone."""
    n = round(duration * RATE)
    t = (np.arange(n) + 0.5) / RATE
    R0 = Rotation.from_euler("ZXY", [-heading, pitch, roll], degrees=True)
    angle = np.radians(sway_deg) * np.sin(2 * np.pi * t / 5)
    rate = np.radians(sway_deg) * 2 * np.pi / 5 * np.cos(2 * np.pi * t / 5)
    R = R0 * Rotation.from_rotvec(angle[:, None] * [0, 0, 1.0])
    w = R.inv().apply(earth.rate_n(WGS84, SITE.latitude)) + rate[:, None] * [0, 0, 1.0]
    f = R.inv().apply([0, 0, float(earth.gravity(WGS84, SITE.latitude, SITE.height))])
    return Recording("parked", RATE, 10.0, w / RATE, f / RATE, SITE, **parts)


@pytest.mark.parametrize("heading", [0.0, 30.0, 137.0, 359.5])
@pytest.mark.parametrize(("pitch", "roll", "sway"), [(0.0, 0.0, 0.0), (5.0, -20.0, 0.0), (-40.0, 60.0, 3.0)])
def test_first_heading(heading, pitch, roll, sway):
    found = summarise(parked(heading, pitch, roll, sway_deg=sway)).guess
    assert (found.start, found.end) == (10.0, 210.0)
    atol = 0.02 if sway else 1e-6  # deg; without sway nothing is left but rounding
    assert_allclose(np.degrees(np.unwrap([np.radians(heading), found.angles[0]]))[1], heading, atol=atol)
    assert_allclose(np.degrees(found.angles[1:]), [pitch, roll], atol=atol)
    for half in found.halves:
        assert abs((np.degrees(half) - heading + 180) % 360 - 180) < 0.05


def test_the_guess_ends_where_it_moves_or_a_gap_begins():
    one = parked(30, 0, 0, 100.0)
    t = 10.0 + np.arange(1, 101)
    vel = np.zeros((100, 3))
    vel[60:, 1] = 5.0
    pos = np.tile(SITE.pos, (100, 1))
    moved = parked(30, 0, 0, 100.0, gnss=Gnss(t, vel, pos))
    assert summarise(moved).guess.end == pytest.approx(70.0)  # a second before the first fast fix
    q = np.tile([1.0, 0, 0, 0], (100, 1))
    assert summarise(parked(30, 0, 0, 100.0, reference=Reference(t, q, vel, pos))).guess.end == pytest.approx(70.0)
    dtheta = one.dtheta.copy()
    dtheta[3000:3010] = np.nan
    gap = Recording("gap", RATE, 10.0, dtheta, one.dvel, SITE)
    assert summarise(gap).guess.end == pytest.approx(40.0)
    assert summarise(gap).gaps == [Gap(pytest.approx(40.0), pytest.approx(40.1), 10)]
    dtheta[1500:1510] = np.nan
    assert summarise(gap).guess is None  # less than 20 s


def test_rest():
    one = parked(30, 0, 0, 100.0)
    dvel, dtheta = one.dvel.copy(), one.dtheta.copy()
    dvel[2000:3000, 0] += 0.01 * np.sin(np.arange(1000) / 5)  # shaken for 10 s
    dtheta[6000:6500, 2] += 0.001  # turned for 5 s
    found = summarise(Recording("x", RATE, 10.0, dtheta, dvel, SITE)).rest
    assert found[0] == (10.0, 30.0)
    assert found[1][0] == pytest.approx(40.0, abs=1.0)
    assert found[1][1] == 70.0
    assert found[-1] == (pytest.approx(75.0, abs=1.0), 110.0)
    assert all(end - start >= 5 for start, end in found)


def test_the_guess_begins_with_the_first_sample_and_lasts_five_minutes_at_most():
    """The first 20 s are missing; the span is counted from where it begins."""
    one = parked(30, 0, 0, 350.0)
    dtheta = one.dtheta.copy()
    dtheta[:2000] = np.nan
    found = summarise(Recording("late", RATE, 10.0, dtheta, one.dvel, SITE)).guess
    assert (found.start, found.end) == (30.0, 330.0)


def test_a_short_knock_is_no_change_of_level():
    """A tenth of a second moves the mean of its second by a tenth of it; the start of a second is not its level."""
    one = parked(30, 0, 0, 100.0)
    dvel = one.dvel.copy()
    dvel[2000:2010, 0] += 0.12 / RATE  # m/s^2; a level that changes by 0.1 ends the rest
    assert summarise(Recording("x", RATE, 10.0, one.dtheta, dvel, SITE)).rest == [(10.0, 110.0)]


def test_forces_rates_and_fixes():
    found = summarise(made.recording(samples=4000))
    assert found.force[1] == pytest.approx(np.linalg.norm([0.1 * 1, -0.2, 9.8]), abs=0.05)
    assert found.force[0] <= found.force[1] <= found.force[2]
    assert (found.fix_rate_hz, found.fix_gaps) == (pytest.approx(1.0), [])
    assert found.reference_rate_hz == pytest.approx(20.0)
    one = made.recording(samples=4000)
    keep = np.delete(np.arange(20), [5, 6, 12])
    gnss = Gnss(one.gnss.t_s[keep], one.gnss.vel[keep], one.gnss.pos[keep])
    found = summarise(Recording("x", 200.0, 1000.0, one.dtheta, one.dvel, one.site, gnss))
    assert found.fix_gaps == [Gap(1005.0, 1008.0, 2), Gap(1012.0, 1014.0, 1)]


@pytest.mark.parametrize(
    ("spec", "error"),
    [
        (None, 0.0),  # these gyros are perfect
        (ImuSpec(gyro_bias_deg_h=4.5), 19.8),  # the earth turns by 12.47 deg/h about north at 34 deg
        (ImuSpec(gyro_bias_deg_h=4.6), 20.2),
        (ImuSpec(gyro_bias_deg_h=3.0, gyro_markov_deg_h=4.0), 21.9),
        (IMU_PRESETS["mems"], 58.8),
    ],
)
def test_gyros_that_find_no_north_by_what_is_told(spec, error):
    found = north(parked(30, 0, 0), spec)
    assert np.degrees(found.error) == pytest.approx(error, abs=0.1)
    assert found.found == (error < 20)
    if not found.found:
        assert f"leave {error:.0f} deg; motion with velocity fixes" in str(found)


def test_gyros_that_find_no_north_by_their_rate_at_rest():
    """A bias of 10 deg/h shows in the length of the rate: 23.4 deg/h along the earth's, 18.06 across it, and not in noise."""
    one = parked(30, 0, 0)
    for bias, found in (([0, 0, 1e-9], True), (one.dtheta[0] / np.linalg.norm(one.dtheta[0]), False)):
        dtheta = one.dtheta + np.radians(10 / 3600) / RATE * np.asarray(bias)
        assert north(Recording("x", RATE, 10.0, dtheta, one.dvel, SITE)).found == found
    noise = np.random.default_rng(0).standard_normal(one.dtheta.shape)
    for arw_deg_sqrt_h, found in ((0.1, True), (2.0, False)):  # over 200 s: 0.4 and 8.5 deg/h
        noisy = one.dtheta + np.radians(arw_deg_sqrt_h / 60) / np.sqrt(RATE) * noise
        assert north(Recording("x", RATE, 10.0, noisy, one.dvel, SITE)).found == found


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
@pytest.mark.parametrize(("start", "heading"), [(0, 90.624), (300, 90.583), (680, 90.541), (930, 90.606)])
def test_the_parked_car(recorded, start, heading):
    """../shared/data/README.md: coarse alignment in the inertial frame over 300 s (there the last begins at 1030 s)."""
    recording = load(recorded)
    q = inertial_alignment(recording, start * 100, (start + 300) * 100)
    assert np.degrees(heading_pitch_roll(q)[0]) == pytest.approx(heading, abs=0.03)


@pytest.mark.parametrize("recorded", ["navgrade_car_gps.npz"], indirect=True)
def test_the_driven_car(recorded):
    found = summarise(load(recorded))
    assert found.guess.end == pytest.approx(69.75, abs=1.0)  # then it drives off
    assert np.degrees(found.guess.angles[0]) == pytest.approx(92.60 - 90.0, abs=0.1)
    assert found.fix_gaps == [Gap(pytest.approx(22.95), pytest.approx(24.95), 1)]
    assert 50 < sum(end - start for start, end in found.rest) < 69
