"""A first mapping: what is measured is right, what cannot be measured is left open, and the mapping reads the file."""

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import made
from scipy.spatial.transform import Rotation

from sins_env.cli.main import main
from sins_env.recordings import load, save
from sins_env.recordings.guessing import Known, guess

HZ, G, EARTH, LATITUDE = 50.0, 9.807, 7.292115e-5, np.radians(48.1)
N = 1500
T = 1000.0 + np.arange(1, N + 1) / HZ
SITE = (48.1, 11.6, 520.0)
NAMES = "t,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z"


def at_rest(up="U"):
    """Rates, rad/s, and specific force, m/s^2, along Right-Forward-Up of a base at rest with heading 40 deg."""
    rng = np.random.default_rng(2)
    north = EARTH * np.cos(LATITUDE) * np.array([-np.sin(np.radians(40)), np.cos(np.radians(40)), 0])
    rates = north + [0, 0, EARTH * np.sin(LATITUDE)] + 1e-6 * rng.standard_normal((N, 3))
    force = np.array([0, 0, G]) + 1e-4 * rng.standard_normal((N, 3))
    return (rates, force) if up == "U" else (rates @ made.SWAP.T, force @ made.SWAP.T)


def write(folder, t, rates, force, names=NAMES, delimiter=",", more=None, **form):
    rows = np.column_stack([t, rates, force, *(more or [])])
    lines = [delimiter.join(f"{x:.15g}" if np.isfinite(x) else "" for x in row) for row in rows]
    head = [names.replace(",", delimiter)] if names else []
    path = folder / "imu.csv"
    path.write_text("\n".join([*head, *lines]) + "\n")
    return path


@pytest.mark.parametrize(
    ("gyro", "accel", "per_gyro", "per_accel"),
    [
        ("rad/s", "m/s2", 1.0, 1.0),
        ("deg/s", "g", np.degrees(1), 1 / 9.80665),
        ("deg/h", "mg", np.degrees(1) * 3600, 1000 / 9.80665),
        ("rad", "m/s", 1 / HZ, 1 / HZ),
        ("arcsec", "m/s", np.degrees(1) * 3600 / HZ, 1 / HZ),
    ],
)
@pytest.mark.parametrize(("unit", "per_s"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_units_from_gravity_the_earth_and_steps(tmp_path, gyro, accel, per_gyro, per_accel, unit, per_s):
    rates, force = at_rest("D")
    path = write(tmp_path, np.rint(T * per_s) if unit != "s" else T, rates * per_gyro, force * per_accel)
    found = guess(path, Known(site=SITE))
    assert not found.open
    told = found.mapping
    assert (told["gyro"]["unit"], told["accel"]["unit"], told["time"]["unit"]) == (gyro, accel, unit)
    recording = load(path, mapping=told)
    assert recording.rate_hz == HZ
    assert_allclose(recording.dtheta * HZ, rates @ made.SWAP.T, rtol=1e-9, atol=1e-13)
    assert_allclose(recording.dvel * HZ, force @ made.SWAP.T, rtol=1e-9, atol=1e-9)


def test_columns_without_names(tmp_path):
    """Of a KF-GINS text with a week in front, and of one with the accelerometers first."""
    rates, force = at_rest("D")
    path = write(tmp_path, np.column_stack([np.full(N, 2100), T]), rates / HZ, force / HZ, "", " ")
    told = guess(path, Known(site=SITE)).mapping
    assert told["time"] == {"column": 2, "unit": "s", "week": 1}
    assert (told["gyro"]["columns"], told["accel"]["columns"]) == ([3, 4, 5], [6, 7, 8])
    path = write(tmp_path, T, force, rates, "", ";")
    told = guess(path, Known(site=SITE)).mapping
    assert (told["gyro"]["columns"], told["accel"]["columns"], told["delimiter"]) == ([5, 6, 7], [2, 3, 4], ";")


def test_a_unit_of_gyros_that_do_not_feel_the_earth(tmp_path):
    """Gravity turns in the axes of a body that sways, as its gyros say."""
    angle = 0.3 * np.sin(0.8 * T)
    turned = Rotation.from_euler("x", angle[:, None])
    force = turned.inv().apply(np.tile([0, 0, G], (N, 1)))
    rates = np.column_stack([0.24 * np.cos(0.8 * T), 0 * T, 0 * T]) + np.array([0.01, -0.02, 0.005])
    found = guess(write(tmp_path, T, np.degrees(rates), force), Known(site=SITE, axes="RFU"))
    assert found.mapping["gyro"]["unit"] == "deg/s"
    assert "how gravity turns" in found.lines[-3].why + found.lines[-4].why + found.lines[-5].why
    assert not found.open


@pytest.mark.parametrize(("forward", "axes"), [((0, 1), "RFU"), ((1, 0), "FLU"), ((0, -1), "LBU")])
def test_the_forward_axis_from_the_speed_of_fixes(tmp_path, forward, axes):
    rates, force = at_rest()
    change = np.sin(0.7 * T)
    force[:, :2] += np.outer(change, forward)
    speed = 10 + (np.cos(0.7 * T[0]) - np.cos(0.7 * T)) / 0.7
    fix = np.full((N, 6), np.nan)
    fix[::25] = np.column_stack([0 * T + 48.1, 0 * T + 11.6, 0 * T + 520, speed, 0 * T, 0 * T])[::25]
    path = write(tmp_path, T, rates, force, NAMES + ",lat,lon,alt,velN,velE,velD", more=[fix])
    found = guess(path)
    assert found.mapping["axes"] == axes
    assert found.mapping["gnss"]["velocity"] == {"columns": ["velN", "velE", "velD"], "frame": "NED"}
    assert found.mapping["gnss"]["position"] == {"columns": ["lat", "lon", "alt"], "unit": "deg"}
    assert not found.open


@pytest.mark.parametrize(
    ("change", "known", "message"),
    [
        (lambda t, w, f: (t, w, f), Known(site=SITE), "axes: gravity along .z .*one of FLU, BRU, RFU, LBU"),
        (lambda t, w, f: (t, w, f), Known(axes="RFU"), r'site: no latitude and longitude; write "site": \[latitude'),
        (
            lambda t, w, f: (t, w + 0.02, f),
            Known(SITE, "RFU"),
            "gyro: neither the earth's rate nor the turning of gravity",
        ),
        (
            lambda t, w, f: (t, w, f * 1e4),
            Known(SITE, "RFU"),
            'accel: .f. is 98070, which is gravity in no unit; write "unit"',
        ),
        (lambda t, w, f: (t, w, f - [0, 0, G]), Known(SITE, "RFU"), "acceleration without gravity"),
        (
            lambda t, w, f: (np.arange(N) * 100, w, f),
            Known(SITE, "RFU"),
            'time: steps of 100 are 10 Hz in ms, .* write "unit"',
        ),
        (lambda t, w, f: (np.arange(N), w, f), Known(SITE, "RFU"), 'rate_hz: no column tells time.*"rate_hz": 100.0'),
    ],
)
def test_what_cannot_be_measured_is_left_open(tmp_path, change, known, message):
    names = NAMES if message[:4] != "rate" else NAMES.replace("t,", "counter,", 1)
    found = guess(write(tmp_path, *change(T, *at_rest()), names), known)
    assert re.search(message, found.open[0])


def test_a_file_for_each_part(tmp_path):
    """As gnss-ins-sim writes them: the others are found beside the first."""
    rates, force = at_rest("D")
    for name, head, values in (
        ("gyro-0.csv", "gyro_x (deg/s),gyro_y (deg/s),gyro_z (deg/s)", np.degrees(rates)),
        ("accel-0.csv", "accel_x (m/s^2),accel_y (m/s^2),accel_z (m/s^2)", force),
        ("time.csv", "time (sec)", T[:, None]),
        ("gps-0.csv", "gps_lat (deg)", T[:30, None]),
    ):
        np.savetxt(tmp_path / name, values, delimiter=",", header=head, comments="")
    for name in ("gyro-0.csv", "accel-0.csv"):
        found = guess(tmp_path / name, Known(site=SITE))
        assert not found.open
        recording = load(tmp_path / name, mapping=found.mapping)
        assert_allclose(recording.dtheta * HZ, rates @ made.SWAP.T, rtol=1e-9, atol=1e-13)
        assert_allclose(recording.dvel * HZ, force @ made.SWAP.T, rtol=1e-9, atol=1e-9)


def test_fixes_in_a_file_of_their_own(tmp_path):
    """As u-blox writes them, in milliseconds, 1e-7 deg and mm; and fixes that every row of one table repeats."""
    at = 1000.0 + np.arange(1, 30)
    rows = np.column_stack(
        [at * 1e3, 481000000 + 0 * at, 116000000 + 0 * at, 520000 + 0 * at, 100 + 0 * at, at, 0 * at]
    )
    np.savetxt(
        tmp_path / "pvt.csv", rows, delimiter=",", header="iTOW,lat,lon,height,velN,velE,velD", comments="", fmt="%.0f"
    )
    path = write(tmp_path, T, *at_rest("D"))
    told = guess(path, Known(gnss="pvt.csv")).mapping
    gnss = load(path, mapping=told, accept=("positions_and_velocities", "held_fixes")).gnss
    assert_allclose(gnss.t_s, at)
    assert_allclose(gnss.pos[0], [np.radians(48.1), np.radians(11.6), 520.0])
    assert_allclose(gnss.vel[:, 1], 0.1)
    held = np.repeat(
        np.column_stack([48.1 + 1e-6 * np.arange(30), 11.6 + 0 * np.arange(30), 520 + 0.1 * np.arange(30)]), 50, axis=0
    )
    path = write(tmp_path, T, *at_rest("D"), NAMES + ",lat,lon,h", more=[held])
    assert guess(path).mapping["drop_held_fixes"] is True


def test_forward_axis_from_fixes_in_a_file_of_their_own(tmp_path):
    """Axes back, left, up: gravity shows up, and the fixes of a car that speeds up and brakes show forward."""
    rates, force = at_rest()
    push = np.sin(0.4 * T)
    right, forward, up = (force + np.outer(push, [0, 1, 0])).T
    path = write(tmp_path, T, rates, np.column_stack([-forward, right, up]))
    at = T[:: int(HZ)]
    speed = 3.0 - np.cos(0.4 * at) / 0.4
    fixes = np.column_stack([1e3 * at, 48.1 + 0 * at, 11.6 + 0 * at, 520 + 0 * at, speed, 0 * at, 0 * at])
    np.savetxt(tmp_path / "fixes.csv", fixes, delimiter=",", header="t [ms],lat,lon,h,vn,ve,vd", comments="")
    found = guess(path, Known(gnss="fixes.csv"))
    assert (found.mapping["axes"], found.open) == ("BRU", [])


def test_what_is_no_table_of_an_imu(tmp_path):
    path = write(tmp_path, T, *at_rest(), "t,a,b,c,d,e,f")
    with pytest.raises(
        ValueError, match="no three columns named as those of accelerometers; allowed: names such as acc_x, here"
    ):
        guess(path)
    save(made.recording(), tmp_path / "x.npz")
    with pytest.raises(ValueError, match="npz, which says itself what it holds"):
        guess(tmp_path / "x.npz")


def test_the_verb_writes_a_mapping_that_describe_reads(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, T, *at_rest())
    assert main(["map", "imu.csv", "--axes", "RFU"]) == 0
    said = capsys.readouterr()
    assert "imu.json" in said.out
    assert 'open: site: no latitude and longitude; write "site"' in said.err
    assert main(["map", "imu.csv"]) == 2
    assert "imu.json exists already; allowed: --out with another name, or --force" in capsys.readouterr().err
    assert main(["map", "imu.csv", "--axes", "RFU", "--site", "48.1", "11.6", "520", "--force"]) == 0
    assert json.loads((tmp_path / "imu.json").read_text())["site"] == [48.1, 11.6, 520.0]
    assert main(["describe", "imu.csv"]) == 0
    assert "1500 at 50 Hz" in capsys.readouterr().out
