"""Flights as users write them: every form of a segment, files, and one clear error for an impossible one."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sins_env.trajectory import MANOEUVRES, Flight, FlightPlan, Segment
from sins_env.worlds.profiles import PROFILES, flight_profile, is_flight

OWN = {
    "latitude_deg": 47.5,
    "longitude_deg": 8.5,
    "height_m": 430,
    "speed_mps": 30,
    "heading_deg": 45,
    "segments": [
        ["cruise", 20],
        ["accelerate", 10, 2],
        ["climb", 5, 2],
        ["descend", 5, 2],
        {"duration_s": 10, "roll_rate_deg_s": 2, "heading_rate_deg_s": [0, 3]},
        ["turn", 20, 3],
        ["turn", 10, 3, 0],
        [10, 0, 0, -2],
        ["decelerate", 10, 1.5],
    ],
}
YAML = """
latitude_deg: 47.5
longitude_deg: 8.5
height_m: 430
speed_mps: 30
heading_deg: 45
segments:
  - [cruise, 20]
  - [accelerate, 10, 2]   # s, m/s2
  - [climb, 5, 2]         # s, deg/s
  - [descend, 5, 2]
  - {duration_s: 10, roll_rate_deg_s: 2, heading_rate_deg_s: [0, 3]}
  - [turn, 20, 3]
  - [turn, 10, 3, 0]
  - [10, 0, 0, -2]
  - [decelerate, 10, 1.5]
"""


def flight(*segments, **fields):
    return FlightPlan.of({"latitude_deg": 0.0, "longitude_deg": 0.0, **fields, "segments": list(segments)})


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        (["cruise", 3], Segment(3.0)),
        (["accelerate", 3, 2], Segment(3.0, 2.0)),
        (["decelerate", 3, 2], Segment(3.0, -2.0)),
        (["climb", 3, 2], Segment(3.0, 0.0, 2.0)),
        (["descend", 3, 2], Segment(3.0, 0.0, -2.0)),
        (["roll", 3, -2], Segment(3.0, 0.0, 0.0, -2.0)),
        (["turn", 3, -2], Segment(3.0, heading_rate_deg_s=-2.0)),
        (("turn", 3, 0, 2), Segment(3.0, heading_rate_deg_s=(0.0, 2.0))),
        ([3], Segment(3.0)),
        ([3, 1, 2, 4, 5], Segment(3.0, 1.0, 2.0, 4.0, 5.0)),
        ((3, 1, 2, 4, 5, 6), Segment(3.0, 1.0, 2.0, 4.0, (5.0, 6.0))),
        (np.array([3, 1, 2, 4, 5, 6]), Segment(3.0, 1.0, 2.0, 4.0, (5.0, 6.0))),
        ({"duration_s": 3, "heading_rate_deg_s": [5, 6]}, Segment(3.0, heading_rate_deg_s=(5.0, 6.0))),
        (Segment(3.0), Segment(3.0)),
    ],
    ids=str,
)
def test_forms_of_a_segment(given, wanted):
    assert Segment.of(given) == wanted


def test_every_manoeuvre_is_known_by_its_name():
    for name in MANOEUVRES:
        assert Segment.of([name, 3, 1] if MANOEUVRES[name] else [name, 3]).manoeuvre == name
    assert Segment(3.0, 1.0, heading_rate_deg_s=(0.0, -1.0)).manoeuvre == "accelerate + turn"


def test_python_yaml_and_json_are_the_same_flight(tmp_path):
    (tmp_path / "own.yaml").write_text(YAML)
    (tmp_path / "own.json").write_text(json.dumps(OWN))
    plan = FlightPlan.of(OWN)
    assert FlightPlan.of(tmp_path / "own.yaml") == plan
    assert FlightPlan.of(str(tmp_path / "own.json")) == plan
    assert FlightPlan.of(plan) is plan
    assert flight_profile(str(tmp_path / "own.yaml")).plan == plan
    assert is_flight(str(tmp_path / "own.json"))
    assert is_flight("lu-gauss")
    (tmp_path / "mapping.json").write_text('{"columns": {}}')
    assert not is_flight(str(tmp_path / "mapping.json"))


def test_what_the_segments_add_up_to():
    plan = FlightPlan.of(OWN)
    names, ends = zip(*plan.summary(), strict=True)
    assert names[4:7] == ("roll + turn", "turn", "turn")
    # s, m/s, heading, pitch, roll
    assert_allclose(ends[2], [35, 50, 45, 10, 0], atol=1e-9)
    assert_allclose(ends[4], [50, 50, 60, 0, 20], atol=1e-9)
    assert_allclose(ends[6], [80, 50, 135, 0, 20], atol=1e-9)
    assert_allclose(ends[-1], [100, 35, 135, 0, 0], atol=1e-9)
    assert plan.rest_s == 0.0
    assert flight([5], ["cruise", 4], [2, 0, 0, 0, 0, 0], ["accelerate", 1, 1], [3]).rest_s == 11.0
    assert flight([5], ["turn", 2, 1.0], [3]).rest_s == 5.0


def test_derivatives_are_those_of_velocity_and_attitude():
    plan, h = FlightPlan.of(OWN), 1e-4
    for segment, end in enumerate(plan.ends_s):
        t = end - 1.3
        before, now, after = (plan.kinematics(np.array(t + x), np.array(segment)) for x in (-h, 0.0, h))
        assert_allclose(now.accel, (after.vel - before.vel) / (2 * h), atol=1e-6)
        assert_allclose(now.rates, (after.angles - before.angles) / (2 * h), atol=1e-9)


def test_the_drawn_track_is_that_of_the_truth():
    plan = PROFILES["lu-gauss"].plan
    t, _, at, moved = plan.track()
    truth = Flight(plan, 1.0, 1)
    truth.reset([None])
    state = truth.chunk(0, 600).state
    assert_allclose(t[1:], np.arange(1, 601))
    assert_allclose(at.vel[1:], state.vel[0], atol=1e-9)
    assert_allclose(moved[1:, 2] + 300, state.pos[0, :, 2], atol=1.0)
    north = (state.pos[0, :, 0] - plan.site.latitude) * 6.36e6
    assert_allclose(moved[1:, 1], north, atol=0.01 * north.max())


BAD = {
    "duration": (
        [["cruise", 5], ["cruise", 0]],
        "segment 2 (['cruise', 0]): duration_s = 0; allowed: a positive number",
    ),
    "negative": ([{"duration_s": -1}], "segment 1 ({'duration_s': -1}): duration_s = -1"),
    "nan": ([[1, float("nan")]], "accel_mps2 = nan; allowed: a finite number"),
    "none": ([{"accel_mps2": 1}], "duration_s = None; allowed: a positive number of seconds"),
    "text": ([[1, "fast"]], "accel_mps2 = 'fast'"),
    "slow": ([["decelerate", 5, 3]], "segment 1 (decelerate, 0 to 5 s) ends at speed -5 m/s; allowed: 0 to 10000"),
    "fast": ([["accelerate", 500, 100]], "ends at speed 50010 m/s"),
    "pitch": ([["climb", 9, 10]], "segment 1 (climb, 0 to 9 s) ends at pitch 90 deg; allowed: -85 to 85"),
    "roll": (
        [["cruise", 1], ["roll", 10, -19]],
        "segment 2 (roll, 1 to 11 s) ends at roll -190 deg; allowed: -180 to 180",
    ),
    "field": (
        [{"duration_s": 5, "acel_mps2": 1}],
        "unknown setting of a segment 'acel_mps2'; did you mean 'accel_mps2'?",
    ),
    "name": ([["acelerate", 5, 1]], "unknown manoeuvre 'acelerate'; did you mean 'accelerate'?"),
    "sign": ([["decelerate", 5, -1]], "size = -1; allowed: a positive number, the name says which way"),
    "count": ([["climb", 5]], "1 numbers; allowed: [climb, duration, size]"),
    "cruise": ([["cruise", 5, 1]], "2 numbers; allowed: [cruise, duration]"),
    "row": ([[1, 2, 3, 4, 5, 6, 7]], "allowed: a dict of fields, one to six numbers, or [manoeuvre"),
    "kind": ([5], "segment 1 (5): allowed: a dict of fields"),
    "rates": ([{"duration_s": 1, "heading_rate_deg_s": [1, 2, 3]}], "allowed: a finite number, or (start, end)"),
    "empty": ([], "segments = []; allowed: a list of at least one segment"),
    "deep": ([["descend", 5, 8], ["cruise", 2000]], "segment 2 (cruise, 5 to 2005 s) leads to height"),
    "pole": ([["accelerate", 1000, 2], ["cruise", 10000]], "leads to latitude"),
}


@pytest.mark.parametrize(("segments", "message"), BAD.values(), ids=BAD)
def test_an_impossible_flight_is_one_clear_error(segments, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011  the message is compared below
        flight(*segments, speed_mps=10.0)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"latitude_deg": 90.0}, "latitude_deg = 90.0; allowed: -89 to 89"),
        ({"longitude_deg": 190.0}, "longitude_deg = 190.0; allowed: -180 to 180"),
        ({"speed_mps": -1.0}, "speed_mps = -1.0"),
        ({"height_m": 2e5}, "height_m = 200000.0"),
        ({"heading_deg": None}, "heading_deg = None; allowed: a finite number"),
        ({"earth": "wgs72"}, "unknown earth model 'wgs72'; did you mean 'wgs84'?"),
        ({"headin_deg": 3.0}, "unknown setting of the flight 'headin_deg'; did you mean 'heading_deg'?"),
    ],
    ids=str,
)
def test_a_bad_start_is_one_clear_error(fields, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011  the message is compared below
        flight([5], **fields)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", "latitude_deg: [1", "a.yaml: line 2 is no YAML"),
        (
            "a.json",
            '{"latitude_deg": 1,}',
            "a.json: line 1 is no JSON .(Illegal trailing comma|Expecting property name)",
        ),
        ("a.yaml", "", "a.yaml: flight = None; allowed: a dict of latitude_deg"),
        ("a.yaml", "a.yaml", "a.yaml: flight = 'a.yaml'; allowed: a dict"),  # the name of a file is no flight
        ("a.yaml", "latitude_deg: 1", "a.yaml: the flight has no longitude_deg"),
        ("a.yml", YAML.replace("climb", "clim"), r"a.yml: segment 3 .*did you mean 'climb'"),
        ("a.txt", YAML, "a.txt: no flight; allowed: a file that ends in .yaml, .yml, .json"),
    ],
)
def test_a_bad_file_is_named(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        FlightPlan.of(tmp_path / name)
    assert "\n" not in str(error.value)


def test_a_missing_file():
    with pytest.raises(FileNotFoundError, match=r"gone\.yaml"):
        FlightPlan.of("gone.yaml")


def test_borders_must_lie_on_the_grid_of_samples():
    plan = flight([1], [0.25], [1])
    with pytest.raises(
        ValueError, match=r"segment 2 \(cruise, 1 to 1\.25 s\) ends at 1\.25 s, between IMU samples of 0\.1"
    ):
        Flight(plan, 0.1, 1)
    Flight(plan, 0.1, 2)
    Flight(flight(*[[0.1]] * 30), 0.1, 1)  # sums of 0.1 are not exact


def test_the_track_on_the_sphere_is_good_enough_for_the_frame():
    """From the equator to the last latitude that is allowed: the truth stays below 89.9 deg."""
    length = np.radians(88.99) * 6.37e6
    plan = flight([length / 5000.0], speed_mps=5000.0)
    truth = Flight(plan, length / 5000.0 / 2000, 1)
    latitude = np.degrees(truth.chunk(1999, 1).state.pos[0, 0, 0])
    assert 88.9 < latitude < 89.2
