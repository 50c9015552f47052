"""Data sets: the arrays are those of the environment with seeds that no suite has; a file is whole or not there."""

import dataclasses
import json
import shutil
from collections import Counter

import gymnasium
import numpy as np
import pytest

import sins_env
from sins_env.evaluation.tasks.catalogue import TASKS, get_task
from sins_env.evaluation.tasks.task import run_seed
from sins_env.learning import npz_form, seeds

SHORT = {
    "name": "short-ferry",
    "motion": {"kind": "sway"},
    "duration_s": 3.0,
    "score": {"azimuth_deg": 0.6, "level_arcsec": 60.0, "hold_s": 1.0},
}
FLIGHT = "flight-hotstart30-v0"


def short_flight():
    task = get_task(FLIGHT)
    return dataclasses.replace(task, name="short-flight", kwargs={**task.kwargs, "duration": 2.0})


def test_seeds_cannot_be_those_of_a_suite():
    """Every suite's seed of a run is below 2**64, a secret suite's too; those to learn from are 2**127 or more."""
    secret = int.from_bytes(b"a suite of 128 b")
    for task in TASKS.values():
        for run in (0, 1, 10**6):
            assert all(run_seed(task, run, suite) < 1 << 64 for suite in (None, 1, secret, secret + run))
            assert 1 << 127 <= seeds.training_seed(task, run, secret % 10**15) < 1 << 128
    white = get_task("sway-white-v0")
    found = {seeds.training_seed(white, run, seed) for run in range(300) for seed in range(3)}
    assert len(found) == 900
    assert seeds.training_seed(get_task("sway-jump-v0"), 0) not in found


def test_numpy_fills_its_pool_one_to_one():
    """The pools of two seeds are mixed alike, each word by a map that has an inverse; shown for one bit at each place."""
    base = 0x123456789ABCDEF
    pools = {tuple(np.random.SeedSequence(base ^ (1 << bit)).pool) for bit in range(128)}
    assert len(pools) == 128


@pytest.mark.parametrize("given", [SHORT, short_flight()], ids=["sway", "flight"])
def test_arrays_are_those_of_the_environment(given, tmp_path):
    task = sins_env.tasks.load(given)
    out = tmp_path / "a.npz"
    said = sins_env.dataset(task, 5, out, seed=3, chunk=2, samples=1)
    data = np.load(out)
    about = json.loads(str(data["about"]))
    K = len(data["t"])
    assert (said.epochs, sum(said.splits.values()), said.bytes) == (K, 5, out.stat().st_size)
    assert about["epoch_s"] * K == pytest.approx(about["duration_s"])
    assert set(about["units"]) == {*data} - {"about", "run", "split", "seed"}
    i = 4
    env = gymnasium.make(about["env_id"], **about["kwargs"], reveal_truth=True)
    obs, info = env.reset(seed=int(str(data["seed"][i]), 16))
    for name in ("q_nb", "vel", "pos"):
        assert np.array_equal(data[f"start_{name}"][i], info["start"][name])
        assert np.array_equal(data[f"truth0_{name}"][i], info["truth"][name])
    action = env.action_space.sample() * 0 + 1e-3
    for k in range(K):
        assert data["t"][k] == pytest.approx(obs["t"][0], abs=1e-12)
        for name in obs.keys() - {"t", "dtheta", "dvel"}:
            assert np.array_equal(data[name][i, k], obs[name])
        for name in ("dtheta", "dvel"):
            assert np.allclose(data[name][i, k, 0], np.sum(obs[name], axis=0), rtol=0, atol=1e-14)
        obs, _, _, over, info = env.step(action)
        for name in ("q_nb", "vel", "pos"):
            assert np.array_equal(data[f"truth_{name}"][i, k], info["truth"][name])
    assert over
    again = tmp_path / "b.npz"
    sins_env.dataset(task, 5, again, seed=3, samples=1)
    assert again.read_bytes() == out.read_bytes()


def test_splits_are_exact_and_stay():
    task = get_task("sway-white-v0")
    first, more = (seeds.split_of(task, range(n), 0, (3, 1, 1)) for n in (10, 25))
    assert np.array_equal(first, more[:10])
    assert all(Counter(block) == {"train": 3, "validation": 1, "test": 1} for block in more.reshape(5, 5).tolist())
    assert len({tuple(block) for block in more.reshape(5, 5).tolist()}) > 1
    assert np.array_equal(seeds.split_of(task, [7, 21], 0, (3, 1, 1)), more[[7, 21]])


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"task": "sway-whit-v0"}, "did you mean 'sway-white-v0'"),
        ({"task": "rlg-car-v0"}, "plays a recording, which cannot be drawn anew; allowed: a simulated task"),
        ({"samples": 7}, "samples = 7; allowed: a divisor of the 30 samples of an epoch: 1, 2, 3, 5, 6, 10, 15, 30"),
        ({"out": "x.csv"}, "out = 'x.csv'; allowed: a file that ends in .npz, or minari:ID"),
        ({"splits": (0, 0, 0)}, "splits = (0, 0, 0); allowed: three whole numbers"),
        ({"runs": 10**13}, "runs = 10000000000000; allowed: 1 to 1000000 runs"),
        ({"runs": [10**20]}, "numbers of runs below 1000000"),
        ({"seed": -1}, "seed = -1; allowed: a whole number from 0 to 1e15"),
        ({"out": "nowhere/x.npz"}, "the directory does not exist"),
    ],
)
def test_what_is_refused(given, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((ValueError, OSError)) as error:
        sins_env.dataset(**{"task": SHORT, "runs": 2, "out": "x.npz", **given})
    assert text in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_nothing_half_written(tmp_path, monkeypatch, cli):
    """A full disk is told before, or when it is met, in one line; the file that was there stays."""
    out = tmp_path / "x.npz"
    out.write_bytes(b"mine")
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(0, 0, 1_000_000))
        code, _, err = cli("dataset", FLIGHT, "--runs", 5, "--out", out)
    assert (code, len(err)) == (2, 1)
    assert "are needed while it is written, 1 MB are free; allowed: fewer runs, or fewer samples" in err[0]

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(npz_form, "_copy", full)
        with pytest.raises(OSError, match=r"x\.npz cannot be written: No space left on device"):
            sins_env.dataset(SHORT, 2, out)
    assert [path.name for path in tmp_path.iterdir()] == ["x.npz"]
    assert out.read_bytes() == b"mine"


def test_verb(cli, tmp_path):
    scenario = tmp_path / "ferry.json"
    scenario.write_text(json.dumps(SHORT))
    out = tmp_path / "x.npz"
    code, said, err = cli(
        "dataset", scenario, "--runs", 4, "--out", out, "--seed", 1, "--samples", 3, "--splits", 2, 1, 1
    )
    assert (code, err) == (0, [])
    assert "4 runs (2 train, 1 validation, 1 test) of 30 epochs" in said
    assert np.load(out)["dtheta"].shape == (4, 30, 3, 3)
    code, _, err = cli("dataset", "rlg-car-v0", "--runs", 4, "--out", out)
    assert (code, len(err)) == (2, 1)


def test_minari(tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    given = {"task": SHORT, "runs": 3, "samples": 2, "splits": (1, 1, 1)}
    sins_env.dataset(out="minari:sins/short-v0", chunk=2, **given)
    sins_env.dataset(out=tmp_path / "x.npz", **given)
    data, made = np.load(tmp_path / "x.npz"), minari.load_dataset("sins/short-v0")
    assert made.total_episodes == 3
    metadata = list(made.storage.get_episode_metadata(range(3)))
    for i, episode in enumerate(made.iterate_episodes()):
        assert made.observation_space.contains({name: value[0] for name, value in episode.observations.items()})
        assert np.array_equal(episode.observations["dtheta"][:-1], data["dtheta"][i])
        assert np.array_equal(episode.actions, data["truth_q_nb"][i])
        assert np.array_equal(episode.infos["truth_vel"][1:], data["truth_vel"][i])
        assert np.array_equal(metadata[i]["start_q_nb"], data["start_q_nb"][i])
        assert (metadata[i]["split"], metadata[i]["run_seed"]) == (data["split"][i], data["seed"][i])
    assert made.recover_environment().unwrapped.env_id == "SINS/AlignSway-v0"
    for name, text in (("sins/short-v0", "which exists at"), ("short", "allowed: minari:NAME-vN")):
        with pytest.raises(ValueError, match=text):
            sins_env.dataset(out=f"minari:{name}", **given)
    assert [path.name for path in (tmp_path / "sins").iterdir() if path.is_dir()] == ["short-v0"]
