"""What a recording says against itself: drives by plain formulas, each with one mistake of a mapping or an instrument."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sins_env import earth
from sins_env.recordings import REFUSING, Gnss, Recording, Reference, findings, load, save, summarise
from sins_env.recordings.assembling import with_velocities
from sins_env.recordings.findings.fixes import is_held
from sins_env.recordings.findings.mending import with_mended_fixes
from sins_env.recordings.mapping import Mapping
from sins_env.types import Site

RATE, T0 = 100.0, 1000.0
SITE = Site(np.radians(48.1), np.radians(11.6), 520.0)
WGS84 = earth.get("wgs84")


def about_up(angles):
    return Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0]))


def drive(park=60.0, go=60.0, heading=40.0, turns=False, fix_hz=1.0, noise=0.0, reference=False):
    """A car that stands, then drives with changing speed at one heading, or with turns; rotations by scipy alone."""
    rng = np.random.default_rng(3)
    n = round((park + go) * RATE)
    t = np.arange(n + 1) / RATE
    y = np.clip(t - park, 0, None)
    speed = np.where(t > park, 12 - 12 * np.cos(2 * np.pi * y / 20), 0.0)
    yaw = np.radians(heading) + (0.8 * np.sin(2 * np.pi * y / 30) if turns else 0 * y)
    vel = np.column_stack([np.sin(yaw), np.cos(yaw), 0 * yaw]) * speed[:, None]
    meridian, normal = earth.radii(WGS84, SITE.latitude)
    way = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (vel[1:] + vel[:-1]) / RATE, axis=0)])
    pos = SITE.pos + way[:, [1, 0, 2]] / [meridian + 520, (normal + 520) * np.cos(SITE.latitude), 1]
    R = about_up(-yaw)
    w_ie = earth.rate_n(WGS84, SITE.latitude)
    g = float(earth.gravity(WGS84, SITE.latitude, 520.0))
    middle = about_up(-0.5 * (yaw[1:] + yaw[:-1]))
    mean = 0.5 * (vel[1:] + vel[:-1])
    f = np.diff(vel, axis=0) * RATE + np.cross(2 * w_ie, mean) + [0, 0, g]
    dtheta = (R[:-1].inv() * Rotation.from_rotvec(np.tile(w_ie / RATE, (n, 1))) * R[1:]).as_rotvec()
    dvel = middle.inv().apply(f) / RATE
    dtheta += 1e-7 * rng.standard_normal((n, 3))
    dvel += 1e-5 * rng.standard_normal((n, 3))
    at = np.arange(round(RATE / fix_hz), n + 1, round(RATE / fix_hz))
    off = noise * rng.standard_normal((len(at), 3)) * [1 / meridian, 1 / meridian / np.cos(SITE.latitude), 1]
    fixes = Gnss(T0 + t[at], vel[at] + 0.1 * noise * rng.standard_normal((len(at), 3)), pos[at] + off)
    told = Reference(T0 + t[at], R[at].as_quat(scalar_first=True), vel[at], pos[at]) if reference else None
    return Recording("drive", RATE, T0, dtheta, dvel, SITE, fixes, None, told)


def names(recording):
    return [one.name for one in findings(recording)]


def fixes(one, **parts):
    return replace(one, gnss=one.gnss._replace(**parts))


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_a_good_drive_has_no_finding(turns, noise):
    assert names(drive(turns=turns, noise=noise, reference=True)) == []
    assert names(drive(park=0.0, go=90.0, turns=turns, noise=noise)) == []


def ned(values):
    return values[:, [1, 0, 2]] * [1, 1, -1]


MISTAKES = {
    "clock": (lambda r: fixes(r, t_s=r.gnss.t_s + 2.0), "clock_offset", "2.00 s behind"),
    "leap seconds": (lambda r: fixes(r, t_s=r.gnss.t_s - 18.0), "clock_offset", "18.00 s before theirs: UTC"),
    "velocities NED": (lambda r: fixes(r, vel=ned(r.gnss.vel)), "positions_and_velocities", "North, East, Down"),
    "swapped": (lambda r: fixes(r, pos=r.gnss.pos[:, [1, 0, 2]]), "positions_and_velocities", "are swapped"),
    "radians": (
        lambda r: fixes(r, pos=np.radians(r.gnss.pos) * [1, 1, 180 / np.pi]),
        "positions_and_velocities",
        "in rad",
    ),
    "knots": (lambda r: fixes(r, vel=r.gnss.vel * 3600 / 1852), "positions_and_velocities", "in knots"),
    "km/h": (lambda r: fixes(r, vel=r.gnss.vel * 3.6), "positions_and_velocities", "in km/h"),
    "gyro unit": (lambda r: replace(r, dtheta=np.degrees(r.dtheta)), "earth_rate_at_rest", "deg/s were read as rad/s"),
    "gyro unit back": (
        lambda r: replace(r, dtheta=np.radians(r.dtheta)),
        "earth_rate_at_rest",
        "rad/s were read as deg/s",
    ),
    "mirrored": (lambda r: replace(r, dtheta=-r.dtheta), "axes", "mirrored axes"),
    "other axes": (lambda r: replace(r, dvel=ned(r.dvel), dtheta=ned(r.dtheta)), "course", "deg right of the course"),
    "minus g": (lambda r: replace(r, dvel=-r.dvel), "upside_down", "sign of gravity"),
    "scale": (lambda r: replace(r, dvel=1.1 * r.dvel), "gravity_at_rest", "wrong scale"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_found_and_explained(mistake):
    change, name, words = MISTAKES[mistake]
    found = {one.name: one for one in findings(change(drive(turns=True)))}
    assert words in str(found[name]), found
    assert found[name].wrong == (name in REFUSING)
    assert found[name].value > found[name].limit or name in ("upside_down", "earth_rate_at_rest")


def test_values_of_sensors_that_fail():
    one = drive()
    dtheta, dvel = one.dtheta.copy(), one.dvel.copy()
    dtheta[7000:7100], dvel[7000:7100] = dtheta[7000], dvel[7000]
    dtheta[9000, 2] += 0.02  # 2 rad/s in a single sample
    dvel[10000:10008, 1] = 0.2  # 2 g, the end of the range
    found = {one.name: one for one in findings(replace(one, dtheta=dtheta, dvel=dvel))}
    assert set(found) == {"hung_sensor", "glitches", "saturated"}
    assert_allclose(found["hung_sensor"].span_s, (T0 + 70, T0 + 71), atol=0.02)
    assert_allclose(found["glitches"].span_s, (T0 + 90, T0 + 90.01), atol=0.02)
    assert "accelerometer forward stays at 20 m/s^2" in found["saturated"].text
    assert [one.name for one in found.values() if one.wrong] == ["hung_sensor"]


def test_a_reference_in_another_frame():
    one = drive(reference=True)
    east = Rotation.from_euler("z", -np.radians(50.0)).as_quat(scalar_first=True)  # 50 deg from east, taken from north
    turned = replace(one, reference=one.reference._replace(q_nb=np.tile(east, (len(one.reference.t_s), 1))))
    found = {one.name: one for one in findings(turned)}
    assert "heading is 50.00 deg" in found["reference_attitude"].text
    assert "counter-clockwise from east" in found["reference_attitude"].text
    half = Rotation.from_euler("z", np.radians(60.0)).as_quat(scalar_first=True)
    course = findings(replace(one, reference=one.reference._replace(q_nb=np.tile(half, (len(one.reference.t_s), 1)))))
    assert "reference_course" in [one.name for one in course]


def test_fixes_that_are_none_or_repeat(tmp_path):
    """Refused with advice that works: with the key that the error names the recording is that without the mistake."""
    one = drive(turns=True)
    pos, vel = one.gnss.pos.copy(), one.gnss.vel.copy()
    pos[:10], vel[:10] = 0.0, 0.0
    null = replace(fixes(one, pos=pos, vel=vel), site=Site(0.0, 0.0, 0.0))
    save(null, tmp_path / "null.npz")
    with pytest.raises(ValueError, match=r'10 of 120 fixes .* "drop_null_fixes": true') as error:
        load(tmp_path / "null.npz")
    assert "accepted as they are: null_fixes" in str(error.value)
    assert len(load(tmp_path / "null.npz", accept="null_fixes").gnss.t_s) == 120
    mended = load(tmp_path / "null.npz", drop_null_fixes=True)
    assert_allclose(mended.gnss.pos, one.gnss.pos[10:], rtol=1e-12)
    assert_allclose(mended.site.pos, one.gnss.pos[10], rtol=1e-12)  # the place was that of a fix that is none

    many = np.repeat(np.arange(120), 10)
    t = np.repeat(one.gnss.t_s, 10) + np.tile(np.arange(10) / 10, 120)
    held = replace(one, gnss=Gnss(t, one.gnss.vel[many], one.gnss.pos[many]))
    save(held, tmp_path / "held.npz")
    with pytest.raises(ValueError, match=r'a receiver of 1 Hz, logged faster; "drop_held_fixes": true'):
        load(tmp_path / "held.npz")
    mended = load(tmp_path / "held.npz", drop_held_fixes=True)
    assert_allclose(mended.gnss.t_s, one.gnss.t_s)  # also while it stands: once for each interval of the receiver
    assert not is_held(one.gnss).any()
    places = fixes(held, vel=None)  # velocities from positions are those of the fixes that stay
    mended = with_mended_fixes(places, Mapping(drop_held_fixes=True, velocity_from_positions=True)).gnss
    assert_allclose(mended.vel, with_velocities(fixes(one, vel=None).gnss).vel)

    save(fixes(one, t_s=one.gnss.t_s - 18.0), tmp_path / "late.npz")
    with pytest.raises(ValueError, match=r'"fix_shift_s": 18.00'):
        load(tmp_path / "late.npz")
    assert_allclose(load(tmp_path / "late.npz", fix_shift_s=18.0).gnss.t_s, one.gnss.t_s)
    with pytest.raises(ValueError, match=r"unknown finding to accept 'clock_ofset'.*clock_offset"):
        load(tmp_path / "late.npz", accept="clock_ofset")


def test_a_straight_drive_is_no_rest():
    """At constant speed the increments are as steady as at rest; the fixes tell."""
    one = drive(park=60.0, go=0.0)
    moving = fixes(one, vel=np.tile([3.0, 4.0, 0.0], (60, 1)))
    assert summarise(one).rest == [(T0, T0 + 60.0)]
    assert summarise(moving).rest == []


def test_a_height_below_all_land_is_no_fix():
    one = drive()
    pos = one.gnss.pos.copy()
    pos[80, 2] = -999.0  # the place is good
    found = findings(fixes(one, pos=pos))[0]
    assert (found.name, found.value, found.span_s) == ("null_fixes", 1, (T0 + 81, T0 + 81))


def test_data_that_are_only_unusual():
    """No noise, no earth, or a quick turn: a simulation's data, and a fast vehicle's, are no failure of a sensor."""
    one = drive(park=60.0, go=0.0, reference=True)
    perfect = replace(one, dtheta=np.tile(one.dtheta[0], (6000, 1)), dvel=np.tile(one.dvel[0], (6000, 1)))
    assert "hung_sensor" not in names(perfect)
    without_earth = replace(perfect, dtheta=0.0 * one.dtheta)
    assert [(found.name, found.wrong) for found in findings(without_earth)] == [("earth_rate_at_rest", False)]
    turn = one.dtheta.copy()
    turn[3000:3100, 2] += 0.03 * np.sin(np.linspace(0, np.pi, 100))  # up to 3 rad/s within a second
    assert "glitches" not in names(replace(one, dtheta=turn))
