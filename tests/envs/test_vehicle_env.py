"""SINS/AlignVehicle-v0: what is told, zero-velocity updates, records, settings."""

import itertools

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.testing import assert_allclose, assert_array_equal
from oracles.courses import VEHICLE, leaves, make, play, vector

from sins_env import attitude
from sins_env.trajectory.car import SCENES

SHORT = {"coarse": 0.5, "reveal_truth": True}
SCRIPT = [{"t": 0.8, "kind": "door"}, {"t": 0.0, "kind": "in", "seat": "rear-left", "scale": 1.2}]


def heading_deg(info):
    return np.degrees(attitude.to_euler(attitude.to_dcm(info["truth"]["q_nb"]))[0])


@pytest.mark.parametrize("settings", [{}, {"start": "told", "gps": "thesis", "coarse": 0.0}], ids=["unknown", "told"])
def test_gymnasium_finds_nothing_to_say(settings):
    check_env(make(VEHICLE, **{"coarse": 0.5, "events": "mixed", **settings}))


def test_defaults_are_those_of_chapter_6():
    task = gymnasium.make(VEHICLE).unwrapped.task
    assert (task.coarse_s, task.duration_s, task.epoch_s, task.n_sub) == (90.0, 300.0, 0.1, 10)
    assert task.gps.vel_std_mps == 0.03
    assert task.gps.rate_hz == 10.0
    assert (task.imu.gyro_bias_deg_h, task.imu.arw_deg_sqrt_h) == (0.01, 0.005)
    assert task.prior.gps_vel_std_mps == (0.03, 0.03, 0.03)


def test_updates_say_zero_velocity_at_the_site_whatever_the_car_does():
    env = make(VEHICLE, events=SCRIPT, gps={"rate_hz": 5.0, "vel_std_mps": 0.05}, duration=6.0, **SHORT)
    course = play(env, np.zeros((60, 4)), seed=2)
    valid = np.concatenate([obs["gps_valid"] for obs, *_ in course[:-1]])
    assert_array_equal(valid, np.arange(1, 61) % 2 == 0)
    for obs, *_ in course:
        assert_array_equal(obs["gps_vel"], 0.0)
        assert_array_equal(obs["gps_pos"], obs["gps_valid"] * env.task.site.pos)
    assert max(np.abs(info["truth"]["vel"]).max() for *_, info in course) > 1e-3
    assert env.task.gps.vel_std_mps == 0.05


def test_a_receiver_measures_the_car():
    env = make(VEHICLE, events=SCRIPT, gps="perfect", **SHORT)
    course = play(env, np.zeros((25, 4)), seed=2)
    for (obs, *_), (*_, info) in itertools.pairwise(course):
        assert_allclose(obs["gps_vel"], info["truth"]["vel"], atol=1e-15)


def test_records_have_their_headings_and_scenes():
    settings = {
        "heading_deg": [10.0, 150.0, -30.0],
        "events": ["quiet", "rocking", "quiet"],
        "event_rate_per_min": 60.0,
    }
    env = vector(4, VEHICLE, **settings, **SHORT)
    _, info = env.reset(seed=3, options={"record": [2, 1, 0, 1]})
    assert_allclose(heading_deg(info), [-30.0, 150.0, 10.0, 150.0], atol=1e-9)
    moved = [env.step(np.zeros((4, 4)))[-1]["truth"]["vel"] for _ in range(25)]
    assert_array_equal(np.abs(moved).max(axis=(0, 2)) > 1e-5, [False, True, False, True])
    again = {0: 10.0, 1: 150.0, 2: -30.0}
    single = make(VEHICLE, **settings, **SHORT)
    for record, heading in again.items():
        assert heading_deg(single.reset(seed=5, options={"record": record})[1]) == pytest.approx(heading)
    drawn = [heading_deg(single.reset(seed=seed)[1]) for seed in range(40)]
    assert len(np.unique(np.round(drawn))) == 3


def test_a_record_is_the_same_run_as_without_records():
    """The record changes the heading and nothing else; the draws of sensors and events stay as they are."""
    one = play(make(VEHICLE, heading_deg=150.0, events="people", **SHORT), np.zeros((5, 4)), seed=4)
    env = make(VEHICLE, heading_deg=[10.0, 150.0], events=["quiet", "people"], **SHORT)
    env.reset(seed=4, options={"record": 1})
    other = [env.step(np.zeros(4)) for _ in range(5)]
    for (obs, *_), (found, *_) in zip(one[1:], other, strict=True):
        for path, value in leaves(obs):
            assert_array_equal(dict(leaves(found))[path], value)


@pytest.mark.parametrize(
    ("settings", "parts"),
    [
        ({"events": "dors"}, ["'dors'", "did you mean 'doors'", *SCENES]),
        ({"events": 3}, ["events = 3", "doors"]),
        ({"events": ["doors", "people"]}, ["2 scenes in events with heading_deg = 30.0"]),
        ({"events": ["doors"], "heading_deg": [1.0, 2.0]}, ["1 scenes", "2 headings", "one scene for each"]),
        ({"events": [{"t": 3.0}]}, ["{'t': 3.0}", "t (s) and kind"]),
        ({"events": [{"t": 3.0, "kind": "dor"}]}, ["kind 'dor'", "did you mean 'door'"]),
        ({"events": [{"t": -3.0, "kind": "door"}]}, ["t = -3.0", ">= 0"]),
        ({"events": [{"t": 3.0, "kind": "in", "seat": "front"}]}, ["seat 'front'", "front-left"]),
        ({"events": [{"t": 3.0, "kind": "in", "scale": 0.0}]}, ["scale = 0.0", "> 0"]),
        ({"events": [{"t": 3.0, "kind": "in", "sclae": 2}]}, ["'sclae'", "did you mean 'scale'"]),
        ({"events": ["doors", {"t": 3.0, "kind": "in"}]}, ["'doors'", "t (s) and kind"]),
        ({"events": {"t": 3.0, "kind": "in"}}, ["events = {'t': 3.0", "one for each heading, or a script"]),
        ({"event_rate_per_min": -1.0}, ["event_rate_per_min = -1.0", ">= 0"]),
        ({"gps": {"lever_arm_m": [0, 0, 1]}}, ["'lever_arm_m'", "vel_std_mps"]),
        ({"gps": {"rate_hz": 3.0}}, ["3 Hz", "10 Hz divided by a whole number"]),
        ({"gps": "dgs"}, ["'dgs'", "did you mean 'dgps'"]),
        ({"heading_deg": []}, ["heading_deg = []", "a list of them"]),
        ({"heading_deg": [1.0, "x"]}, ["heading_deg = [1.0, 'x']"]),
        ({"vibration": True}, ["'vibration'", "Allowed: "]),
        ({"coarse": -1.0}, ["coarse = -1.0"]),
    ],
)
def test_settings_are_refused_with_one_clear_error(settings, parts):
    with pytest.raises(ValueError, match="llowed: ") as error:
        gymnasium.make(VEHICLE, **settings)
    for part in parts:
        assert part in str(error.value)


@pytest.mark.parametrize(
    ("settings", "options", "parts"),
    [
        ({}, {"record": 0}, ["record = 0", "where heading_deg is a list"]),
        ({"heading_deg": [1.0, 2.0]}, {"record": 2}, ["record 2 does not exist", "0 to 1"]),
        ({"heading_deg": [1.0, 2.0]}, {"record": [0, 1]}, ["record = [0, 1]", "list of 1"]),
        ({"heading_deg": [1.0, 2.0]}, {"records": 1}, ["'records'", "did you mean 'record'"]),
    ],
)
def test_reset_options_are_refused_with_one_clear_error(settings, options, parts):
    env = make(VEHICLE, coarse=0.5, **settings)
    with pytest.raises(ValueError, match="llowed: ") as error:
        env.reset(seed=0, options=options)
    for part in parts:
        assert part in str(error.value)
