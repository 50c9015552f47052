"""Aiding sensors of a recording: from columns to observations, and to a solver's result."""

import json
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made
from oracles.replays import make, play, stacked

import sins_env  # noqa: F401
from sins_env import recordings
from sins_env.recordings import Gnss, Readings, Recording
from sins_env.sensors.odometer import OdometerSpec
from solvers import zoo

WHEEL = {"odometer": {"scale_ppm": 1000.0, "lever_arm_m": [0, -1.2, -0.8]}}
FIXES = {"vel_std_mps": 0.1, "pos_std_m": 3.0}


def navigated(env, task):
    """The estimates (K, 10) of an EKF, and all observations."""
    observations, estimates, over = [env.reset(seed=3)[0]], [], False
    estimator = zoo.ekf()
    estimator.reset(task or env.task, np.random.default_rng(0))
    while not over:
        estimates.append(estimator.step(observations[-1]))
        obs, _, _, over, _ = env.step(estimates[-1])
        observations.append(obs)
    return np.array(estimates), observations[:-1]


def test_a_simulated_drive_comes_back_from_a_file(tmp_path):
    """Ten seconds without fixes: the odometer holds the position as in the simulation, to rounding."""
    gps = {**FIXES, "rate_hz": 1.0, "outages_s": [[5.0, 15.0]]}
    settings = {"profile": "car", "imu": "tactical", "gps": gps, "duration": 15.0, "aids": WHEEL}
    env = gymnasium.make("SINS/NavFlight-v0", **settings).unwrapped
    env.reset(seed=3)
    task = env.task
    expected, seen = navigated(env, task)
    there, t = stacked(seen, "gps_valid")[:, 0] == 1, stacked(seen, "t")[:, 0]
    rolled = np.cumsum(stacked(seen, "odometer"), axis=0)
    recording = Recording(
        "car",
        10.0,
        0.0,
        stacked(seen, "dtheta")[:, 0],
        stacked(seen, "dvel")[:, 0],
        task.site,
        Gnss(t[there], stacked(seen, "gps_vel")[there], stacked(seen, "gps_pos")[there]),
        aids={"odometer": Readings(np.append(0.0, t), np.concatenate([[[0.0]], rolled]))},
    )
    replay = {"mode": "navigate", "coarse": 0.0, "imu": "tactical", "gps": FIXES}
    for name in ("car.csv", "car.npz"):
        recordings.save(recording, tmp_path / name)
        again = make(tmp_path / name, **replay, aids=WHEEL)
        assert again.task.aids == task.aids
        observations, _, _ = play(again, np.append([1.0, 0, 0, 0, 0, 0, 0], task.site.pos), seed=0)
        for key in seen[0]:
            assert_allclose(stacked(observations[:-1], key), stacked(seen, key), atol=1e-9)
    found, _ = navigated(again, task)
    scale = np.append(np.ones(7), [6.4e6, 6.4e6, 1.0])  # positions in m
    assert_allclose(found * scale, expected * scale, atol=1e-6)
    free = make(tmp_path / name, **replay, aids={"odometer": "off"})
    assert free.task.aids == ()
    drifted = navigated(free, replace(task, aids=()))[0] - expected
    assert np.abs(drifted * scale)[-1, 7:9].max() > 0.01  # and without it, the position is another


#: Rows of a table with a stamp each tenth of a second, and what a mapping says of it.
TABLE = {
    "odometer": ({"speed": {"column": "a", "unit": "km/h"}}, "odometer", [2.0], 72.0),
    "dvl": ({"velocity": {"columns": ["a", "b", "c"], "unit": "mm/s"}, "axes": "FRD"}, "dvl", [0.2, 0.1, -0.3], 100.0),
    "heading": (
        {"heading": {"column": "a", "unit": "deg"}, "pitch": {"column": "b", "unit": "deg"}},
        "heading",
        [2 * np.cos(np.pi / 3) * 0.5, 2 * np.cos(np.pi / 3) * np.sqrt(0.75), 2 * np.sin(np.pi / 3)],
        30.0,
    ),
    "magnetometer": (
        {"field": {"columns": ["a", "b", "c"], "unit": "uT"}, "axes": "RFU"},
        "magnetometer",
        [1e-5, 2e-5, 3e-5],
        10.0,
    ),
    "height": (
        {"pressure": {"column": "a", "unit": "hPa"}},
        "height",
        [1000.0],
        898.746,
    ),  # table of the standard atmosphere
    "depth": ({"depth": {"column": "a", "unit": "ft"}}, "depth", [3.048], 10.0),
}


def recorded(tmp_path, aids, table):
    """A recording of ten seconds, with a table beside it."""
    recordings.save(made.recording(reference=False), tmp_path / "one.csv")
    np.savetxt(tmp_path / "aids.csv", table, delimiter=",", header="t,a,b,c", comments="")
    mapping = json.loads((tmp_path / "one.json").read_text())
    given = {name: {"file": "aids.csv", "time": {"column": "t"}, **columns} for name, columns in aids.items()}
    (tmp_path / "one.json").write_text(json.dumps({**mapping, "aids": given}))
    return tmp_path / "one.json"


@pytest.mark.parametrize("name", TABLE)
def test_columns_become_observations(tmp_path, name):
    columns, key, expected, first = TABLE[name]
    t = 1000.0 + 0.1 * np.arange(101)
    path = recorded(tmp_path, {name: columns}, np.column_stack([t, *([k * first] * 101 for k in (1, 2, 3))]))
    aids = {name: {"baseline_m": [0, 2.0, 0]} if name == "heading" else {}}
    observations, _, _ = play(make(path, aids=aids), seed=0)
    assert_allclose(stacked(observations[:-1], key), np.tile(expected, (100, 1)), rtol=1e-3, atol=1e-9)
    assert stacked(observations[:-1], f"{key}_valid").all()
    assert make(path).observation_space.contains(observations[0])
    back = tmp_path / "back.npz"
    recordings.save(recordings.load(path), back)
    recordings.save(recordings.load(back), tmp_path / "again.csv")
    assert_allclose(recordings.load(tmp_path / "again.csv").aids[name].values, recordings.load(path).aids[name].values)


def test_a_heading_without_a_pitch_has_no_vertical_part(tmp_path):
    t = 1000.0 + np.arange(11.0)
    path = recorded(
        tmp_path, {"heading": {"heading": {"column": "a", "unit": "deg"}}}, np.column_stack([t, *[t * 0 + 90] * 3])
    )
    observations, _, _ = play(make(path), seed=0)
    valid = stacked(observations, "heading_valid")
    assert_array_equal(np.flatnonzero(valid[:, 0]), 9 + 10 * np.arange(10))  # once a second
    assert_array_equal(valid[9], [1, 1, 0])
    assert_allclose(observations[9]["heading"], [1.0, 0.0, 0.0], atol=1e-12)


def test_readings_between_ends_of_epochs():
    """Twenty times a second they are interpolated, over a pause they are none, and once a second they are refused."""
    one = made.recording(reference=False)
    t = 1000.0 + 0.05 * np.arange(200) + 0.02
    t = t[(t < 1004.0) | (t > 1006.0)]
    observations, _, _ = play(make(replace(one, aids={"height": Readings(t, t[:, None] - 1000.0)})), seed=0)
    valid = stacked(observations[:-1], "height_valid")[:, 0] == 1
    ends = 0.1 * np.arange(1, 101)
    assert_array_equal(valid, (ends < 3.98) | ((ends > 6.02) & (ends < 9.98)))
    assert_allclose(stacked(observations[:-1], "height")[valid, 0], ends[valid], atol=1e-9)
    slow = replace(one, aids={"height": Readings(np.arange(1000.03, 1010.0), np.zeros((10, 1)))})
    with pytest.raises(ValueError, match=r"none at the end of an epoch of 0.1 s; allowed: .* epochs of a sample"):
        make(slow)
    assert make(slow, epoch=0.005).task.aids[0].name == "height"  # the advice works
    assert make(slow, aids={"height": "off"}).task.aids == ()


@pytest.mark.parametrize(
    ("aids", "text"),
    [
        ({"odometr": {"speed": {"column": "a", "unit": "m/s"}}}, "did you mean 'odometer'"),
        ({"odometer": {"speed": {"column": "a", "unit": "mph"}}}, "unit of speed 'mph'"),
        ({"odometer": {}}, "allowed: time and one of distance, increment, speed"),
        ({"dvl": {"velocity": {"columns": ["a", "b"], "unit": "m/s"}}}, "3 of them"),
        ({"dvl": {"velocity": {"columns": ["a", "b", "c"], "unit": "m/s"}, "axes": "FRX"}}, "FRX"),
    ],
)
def test_wrong_mappings(tmp_path, aids, text):
    with pytest.raises(ValueError, match=text):
        recordings.load(recorded(tmp_path, aids, np.ones((3, 4)) * np.array([[1001.0], [1002], [1003]])))


def test_wrong_settings():
    one = replace(made.recording(), aids={"odometer": Readings(1000.0 + np.arange(9), np.zeros((9, 1)))})
    with pytest.raises(ValueError, match="no dvl in made; there: odometer"):
        make(one, aids={"dvl": {}})
    with pytest.raises(ValueError, match=r"aids\.odometer\.slip_s = .* in a replay; allowed: in a simulation only"):
        make(one, aids={"odometer": {"slip_s": [[1, 2]]}})
    with pytest.raises(ValueError, match="a dict with a preset"):
        make(one, aids=OdometerSpec())
    assert recordings.left_out(one, "kfgins") == ["displacements", "aids"][1:]
