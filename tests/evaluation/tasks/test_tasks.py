"""Tasks are frozen: seeds, kwargs and the worlds they make."""

import dataclasses
import json

import numpy as np
import pytest
from places import ROOT

from sins_env import attitude
from sins_env.envs import ENV_IDS
from sins_env.evaluation import digest, get_task
from sins_env.evaluation.tasks import catalogue as tasks
from sins_env.evaluation.tasks import suite
from sins_env.evaluation.tasks.catalogue import suite_files
from sins_env.evaluation.tasks.task import EvaluationTask, run_seed, solver_rng, suite_hash
from sins_env.scenarios.scenario import Scenario

#: What the files of the suite say of their worlds.
DIGESTS = {one.task["name"]: one.task.get("digest") for one in map(Scenario.of, suite_files())}
SEED_0 = 1996661565137576703
THRESHOLDS = {
    "sway-white-v0": (0.7, 70, 360, 0),
    "sway-markov-v0": (1.6, 70, 600, 0),
    "sway-told-wrong-v0": (0.6, 60, 360, 0),
    "sway-scratch-v0": (0.7, 70, 480, 120),
    "sway-contaminated-v0": (0.7, 70, 360, 0),
    "sway-jump-v0": (0.7, 70, 360, 0),
    "sway-heavytail-v0": (0.7, 70, 360, 0),
    "sway-anyheading-v0": (0.7, 70, 360, 0),
    "rlg-car-v0": (0.3, 90, 300, 90),
    "navgrade-car-v0": (0.5, 210, 136.35, 68),
    "flight-sun2012-v0": (2.3, 110, 900, 0),
    "flight-sun2012-fixed-v0": (2.3, 110, 900, 0),
    "flight-sun2012-physical-v0": (0.3, 130, 900, 0),
    "flight-lu-gauss-v0": (0.1, 20, 600, 0),
    "flight-lu-mixture-v0": (0.1, 20, 600, 0),
    "flight-zhao2010-v0": (0.1, 60, 500, 0),
    "flight-hotstart30-v0": (0.4, 190, 300, 0),
    "flight-hotstart60-v0": (0.4, 190, 300, 0),
    "flight-hotstart90-v0": (0.4, 190, 300, 0),
    "vehicle-v0": (0.3, 90, 300, 90),
    "static8-v0": (0.3, 90, 300, 90),
}
SIMULATED = [name for name in tasks.names() if not get_task(name).windows]


def test_every_task_has_a_digest():
    """Its file ends with it, as ``sins_env.evaluation.digest`` makes it."""
    missing = {name: digest(get_task(name)) for name, value in DIGESTS.items() if value is None}
    assert not missing, f"digest: {missing}"
    assert set(THRESHOLDS) <= set(DIGESTS) == set(tasks.names())


@pytest.mark.parametrize("name", SIMULATED)
def test_digest(name):
    """A change means that old results no longer compare: give the task a new version instead."""
    assert digest(get_task(name)) == DIGESTS[name]


@pytest.mark.parametrize("name", [name for name in SIMULATED if name in THRESHOLDS])
def test_thresholds_and_durations(name):
    task, public = get_task(name), get_task(name).make(1).unwrapped.task
    found = (task.delta_azimuth_deg, task.delta_level_arcsec, public.duration_s, public.coarse_s)
    assert found == THRESHOLDS[name]


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
def test_digest_of_the_recording(recorded):
    task = get_task("rlg-car-v0")
    assert digest(task) == DIGESTS[task.name]
    world = task.make(1).unwrapped.episode.world
    assert len(world.windows.starts) == task.windows
    np.testing.assert_allclose(world.windows.starts, 150.0 * np.arange(7))


@pytest.mark.parametrize("recorded", ["navgrade_car_gps.npz"], indirect=True)
def test_digest_of_the_drive(recorded):
    task = get_task("navgrade-car-v0")
    assert digest(task) == DIGESTS[task.name]
    env = task.make(1).unwrapped
    public, world = env.task, env.episode.world
    assert (public.navigate, public.num_epochs, public.coarse_s, len(world.windows.starts)) == (True, 2727, 68.0, 1)
    assert (public.gps.vel_std_mps, public.gps.pos_std_m) == (0.03, (0.5, 0.5, 1.0))
    assert public.imu.gyro_bias_deg_h == 0.05


@pytest.mark.parametrize(
    "change",
    [
        {"gps": {"vel_std_mps": 0.1001}},
        {"imu": {"preset": "thesis-white", "arw_deg_sqrt_h": 0.01001}},
        {"latitude_deg": 39.9601},
        {"vibration": True},
        {"heading_deg": 30.001},
    ],
)
def test_digest_sees_small_changes(change):
    task = get_task("sway-white-v0")
    changed = dataclasses.replace(task, kwargs={**task.kwargs, **change})
    assert digest(changed) != digest(task)
    assert digest(dataclasses.replace(task, kwargs=dict(task.kwargs))) == digest(task)


@pytest.mark.parametrize(
    "change",
    [
        {"profile": "sun2012-physical"},  # another course from 100 s on
        {"imu": {"arw_deg_sqrt_h": 0.1001}},
        {"gps": {"pos_std_m": 10.01}},
        {"gps": {"outages_s": [[505.0, 515.0]]}},
        {"attitude_std_deg": [3.0, 3.0, 10.01]},
        {"errors": "fixed"},
    ],
)
def test_digest_of_a_flight_sees_small_and_late_changes(change):
    task = get_task("flight-sun2012-v0")
    assert digest(dataclasses.replace(task, kwargs={**task.kwargs, **change})) != DIGESTS[task.name]


def test_digest_sees_where_a_flight_begins():
    """A metre of height, or 1e-5 rad of latitude, in a field whose other numbers are hundreds of metres."""
    task = get_task("flight-sun2012-v0")
    flight = {"latitude_deg": 34.2, "longitude_deg": 108.9, "height_m": 380.0, "segments": [[30.0]]}
    digests = {
        digest(dataclasses.replace(task, kwargs={"profile": {**flight, **change}}))
        for change in ({}, {"latitude_deg": 34.2006}, {"longitude_deg": 108.9006}, {"height_m": 381.0})
    }
    assert len(digests) == 4


def test_runs_of_records_go_round_with_draws_of_their_own():
    """vehicle-v0: run i is record i modulo 30, ten at each heading of 000 chapter 6; static8-v0: eight headings."""
    vehicle, static = get_task("vehicle-v0"), get_task("static8-v0")
    for task, runs, headings in (
        (vehicle, (0, 9, 10, 29, 30, 40), (149.4, 149.4, -28.8, -26.3, 149.4, -28.8)),
        (static, (0, 1, 7, 8, 9), (0.0, 45.0, -45.0, 0.0, 45.0)),
    ):
        env = task.make(len(runs), reveal_truth=True)
        _, info = task.reset(env, runs)
        heading = attitude.to_euler(attitude.to_dcm(info["truth"]["q_nb"]))[0]
        np.testing.assert_allclose(np.degrees(heading), headings, atol=1e-9)
        assert len(np.unique(env.unwrapped.episode.world.imu.gyro.bias[:, 0])) == len(runs)
        assert len(task.kwargs["heading_deg"]) == task.records
        assert task.max_runs is None
    scenes = vehicle.kwargs["events"]
    assert scenes == ["doors"] * 10 + ["rocking"] * 2 + ["people"] * 18


def test_seeds():
    """Golden: SeedSequence(suite seed, spawn_key=(crc32(task), run)); every pair of runs differs."""
    task = get_task("sway-white-v0")
    seeds = {run_seed(task, run) for run in range(1000)}
    assert len(seeds) == 1000
    assert run_seed(task, 0) == SEED_0
    assert run_seed(task, 0, 1) != SEED_0
    assert run_seed(get_task("sway-markov-v0"), 0) != SEED_0
    draws = {solver_rng(task, solver, run).random() for solver in ("ckf", "ukf") for run in range(50)}
    assert len(draws) == 100
    assert suite_hash(task) == suite_hash(task, 0) != suite_hash(task, 1)


def test_kwargs_are_json():
    for name in tasks.names():
        task = get_task(name)
        assert json.loads(json.dumps(dict(task.kwargs))) == dict(task.kwargs)
        with pytest.raises(dataclasses.FrozenInstanceError):
            task.suite_seed = 1
        assert isinstance(task, EvaluationTask)


@pytest.fixture
def added(tmp_path, monkeypatch):
    """Write a file into the suite; what the catalogue then finds."""
    monkeypatch.setattr(suite, "__path__", [*suite.__path__, str(tmp_path)])

    def add(name, text):
        (tmp_path / name).write_text(text)
        return tasks.collect()

    return add


def test_a_new_task_is_one_new_file(added):
    """It stands with those of its environment, in the order of the environments; the others stay as they are."""
    found = added("99-mine.yaml", "name: sway-mine-v0\nscore: {azimuth_deg: 1, level_arcsec: 60}\n")
    assert [name for name in found if name != "sway-mine-v0"] == tasks.names()
    assert list(found).index("sway-mine-v0") == list(found).index("sway-anyheading-v0") + 1
    assert list(dict.fromkeys(task.env_id for task in found.values())) == [*ENV_IDS[:-1]]  # the last one is Scenario-v0


def test_a_file_of_the_suite_has_thresholds(added):
    with pytest.raises(ValueError, match=r"empty.yaml: no delta_azimuth_deg; allowed in the suite: both thresholds"):
        added("empty.yaml", "")


def test_two_tasks_of_one_name(added):
    with pytest.raises(ValueError, match=r"twin.yaml: a second task sway-white-v0"):
        added("twin.yaml", tasks.file_of("sway-white-v0").read_text())


def test_sources_are_documents_or_pages_that_exist():
    for name in tasks.names():
        source = get_task(name).source
        page, _, anchor = source.partition("#")
        if page.endswith(".md"):
            titles = [line.strip("# \n").lower() for line in (ROOT / page).read_text().splitlines() if line[:1] == "#"]
            assert anchor.replace("-", " ") in titles, name
        else:
            assert source[:3] in ("000", "001", "002", "003", "004"), name
