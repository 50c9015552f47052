"""benchmarks/peers.py: the problem that other packages get, those of them that CI has, and what docs/peers.md says of them."""

import importlib
import json
import math
import os
import sys
from dataclasses import replace
from pathlib import Path

import filterpy
import numpy as np
import pyins
import pytest
from places import ROOT

RESULT = json.loads((ROOT / "benchmarks" / "peers.json").read_text())
MODULES = [
    "by_hand",
    "environment",
    "features",
    "flight",
    "measuring",
    "on_filterpy",
    "on_pyins",
    "ours",
    "plain_map",
    "problem",
    "tables",
]


@pytest.fixture(scope="module")
def peers():
    """The modules of benchmarks/peers by name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks")
        yield {name: importlib.import_module(f"peers.{name}") for name in MODULES}
        for name in [name for name in sys.modules if name.split(".")[0] in ("peers", "markers", "costs")]:
            del sys.modules[name]


@pytest.fixture(scope="module")
def problem(peers):
    return peers["problem"].record("sway-white-v0", 4, 12)


def test_the_page_says_what_was_measured(peers):
    markers = importlib.import_module("markers")
    assert markers.between((ROOT / "docs" / "peers.md").read_text(), "peers") == peers["tables"].section(RESULT)


def test_fix_by_fix_and_whole_records_are_told_apart(peers):
    """With times made up for both ways of dynamax, the text says which is faster, and where."""
    ours = [row for row in RESULT["rows"] if row["peer"] == "sins_env"]
    rows = list(ours)
    for row in ours:
        for stepped, longer in ((True, 1.5), (False, 0.5)):
            speeds = {runs: speed / longer for runs, speed in row["steps_per_s"].items()}
            told = {"peer": "dynamax", "numbers": "JAX", "stepped": stepped, "first_call_s": 1.0, "steps_per_s": speeds}
            rows.append({**row, **told, "us_per_step": longer * row["us_per_step"]})
    text = "\n".join(peers["tables"].faster({**RESULT, "rows": rows}))
    assert "Fix by fix, faster than sins_env with one run: none. With 1,024 runs: none." in text
    assert "with 1,024 runs, in times of ours: KF 1.5 (dynamax, JAX), EKF 1.5 (dynamax, JAX)" in text
    assert "in one call, faster than sins_env with one run: dynamax, JAX, whole record KF 2.0, EKF 2.0" in text


def test_the_plain_map_is_the_map_of_the_pipeline(problem, peers):
    """In floats and in arrays, from errors of many standard deviations."""
    x = 3.0 * np.random.default_rng(0).standard_normal((4, 10)) * np.sqrt(np.diagonal(problem.P0))
    for k, f in enumerate(problem.maps(slice(None))):
        expected, epochs = f(x), problem.epochs[k]
        apart = np.sqrt(np.diagonal(problem.P0)) * 1e-14
        for run in range(4):
            assert np.all(np.abs(peers["plain_map"].plain(epochs[run], math)(x[run]) - expected[run]) < apart)
        assert np.all(np.abs(np.stack(peers["plain_map"].advance(x.T, epochs.T, np), -1) - expected) < apart)


def test_the_runs_of_the_problem_are_those_of_the_pipeline(problem, peers):
    """One run alone is the same as among others, and the filters learn: the fixes belong to the epochs."""
    for entry in peers["ours"].entries():
        together, alone = entry.make(problem, 4)(), entry.make(problem, 1)()
        assert max(peers["measuring"].differences(together, alone)) < 1e-9
        later = np.diagonal(together.cov, axis1=1, axis2=2)
        assert np.all(later[:, 2:4] < 0.5 * np.diagonal(problem.P0)[2:4])  # level is seen by the velocity


@pytest.mark.parametrize("noise", [1.0, 1e4])
def test_filterpy_solves_the_same_problem_but_for_its_ckf(problem, peers, noise):
    problem = replace(problem, Q=noise * problem.Q)
    ours = {entry.filter: entry.make(problem, 2)() for entry in peers["ours"].entries()}
    for entry in peers["on_filterpy"].entries():
        apart = max(peers["measuring"].differences(ours[entry.filter], entry.make(problem, 2)()))
        if entry.filter == "CKF":
            assert noise * 1e-9 < apart < noise * 1e-6, "with Q in its update the remark on filterpy is out of date"
        else:
            assert apart < 1e-8, entry.filter


@pytest.mark.filterwarnings("ignore:The copy keyword is deprecated")  # raised inside pyins 1.0.1
def test_pyins_flies_the_same_record(peers):
    """Its linearisation and frames are its own: the ends agree to a fraction of a standard deviation, from 10 m and 1 deg."""
    tape = peers["flight"].record(30)
    ours = peers["flight"].ours(tape, 30)()
    assert peers["flight"].apart(ours, ours) == 0.0
    theirs = peers["on_pyins"].feedback_filter(tape, 30)()
    assert 0.0 < peers["flight"].apart(ours, theirs) < 0.3
    assert peers["flight"].apart(peers["flight"].ours(tape, 29)(), theirs) > 1.0, "an epoch earlier it was elsewhere"


@pytest.mark.filterwarnings("ignore:The copy keyword is deprecated")
def test_what_is_not_installed_or_fails_is_said_and_the_others_are_measured(peers, monkeypatch):
    def broken(self, *args, **kwargs):
        raise TypeError("on purpose")

    monkeypatch.setattr(peers["measuring"], "BLOCK_S", 1e-4)
    monkeypatch.setattr(peers["by_hand"], "entries", list)  # its compilation takes seconds
    for name in ("jax", "dynamax", "stonesoup", "kalman_py"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(peers["on_filterpy"].EKF, "update", broken)
    result = peers["measuring"].measured(steps=2, rounds=1, sizes=[2])
    assert {row["peer"] for row in result["rows"]} == {"sins_env", "filterpy"}
    assert set(result["absent"]) == {"PSINS", "Stone Soup", "kalman-py", "dynamax", "filterpy EKF (NumPy)"}
    assert "Stone Soup: not measured, cannot be imported" in " ".join(peers["tables"].notes(result))
    assert "filterpy EKF (NumPy): not measured, TypeError: on purpose." in peers["tables"].notes(result)
    assert -0.1 < result["others_busy_cores"] < os.cpu_count()
    assert all(row["us_per_step"] > 0 and row["steps_per_s"]["2"] > 0 for row in result["rows"])
    assert result.keys() == RESULT.keys()
    assert result["rows"][0].keys() == RESULT["rows"][0].keys()
    rows = peers["tables"].document(result).splitlines()
    assert sum(line.startswith("| filterpy") for line in rows) == 3


def test_a_package_that_cannot_be_installed_is_one_line(peers, monkeypatch, capsys):
    environment = peers["environment"]
    monkeypatch.setattr(environment, "PYTHON", Path(sys.executable))
    reason = environment.install("--no-index", "no-such-package-anywhere")
    assert "No matching distribution found for no-such-package-anywhere" in reason
    asked = []
    monkeypatch.setattr(environment, "installed", lambda: {"sins-env", "filterpy", "jax"})
    monkeypatch.setattr(environment, "install", lambda *what: asked.append(what) or "ERROR: offline")
    environment.prepare()
    assert asked == [("stonesoup",), ("python-ins",), ("jax", "kalman-py"), ("dynamax", "jax")]
    assert "Stone Soup could not be installed: ERROR: offline" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("package", "folder"),
    [("sins_env", ROOT), ("filterpy", Path(filterpy.__file__).parents[1]), ("pyins", Path(pyins.__file__).parents[1])],
)
def test_the_evidence_of_the_feature_table_is_there(peers, package, folder):
    assert peers["features"].missing_evidence(package, folder) == []


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ("--steps 1", "--steps 1: must be 2 or more"),
        ("--runs 64 8", "--runs 64 8: must be 2 or more, in ascending order"),
        ("--rounds 0", "--rounds 0: must be 1 or more"),
    ],
)
def test_bad_arguments_are_one_line(peers, capsys, words, problem):
    import runpy

    main = runpy.run_path(str(ROOT / "benchmarks" / "peers.py"))["main"]
    with pytest.raises(SystemExit):
        main(words.split())
    assert problem in capsys.readouterr().err
