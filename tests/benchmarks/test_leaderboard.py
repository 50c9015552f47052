"""benchmarks/leaderboard.py and readme.py: the tables of README are what registry and results say."""

import dataclasses
import importlib
import json
import sys
from types import SimpleNamespace

import pytest
from places import ROOT

import solvers
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks import catalogue as tasks


@pytest.fixture(scope="module")
def benchmarks():
    """The scripts as modules, which import each other."""
    folder = str(ROOT / "benchmarks")
    sys.path.insert(0, folder)
    try:
        names = ("leaderboard", "readme", "story", "suite", "zoo")
        yield SimpleNamespace(**{name: importlib.import_module(name) for name in names})
    finally:
        sys.path.remove(folder)


def test_readme_is_what_registry_and_results_say(benchmarks):
    document = benchmarks.readme.README.read_text()
    board = json.loads(benchmarks.readme.JSON.read_text())
    assert benchmarks.readme.written(document, board) == document, "python benchmarks/readme.py"


def test_every_solver_says_in_a_line_what_it_is_and_where_it_is_from(benchmarks):
    zoo = benchmarks.zoo
    assert sorted(zoo.names()) == solvers.names()
    for name in zoo.names():
        idea, source = zoo.idea(name), zoo.source(name)
        assert 10 < len(idea) <= zoo.LONGEST, name
        assert not idea.endswith((".", ":")), name
        assert "doi:" not in source, name
        assert ".md" not in source, name
        assert any(digit in source for digit in "0123456789") or name == "two_pass", name
    assert zoo.idea("ckf").startswith("Cubature Kalman filter: the moments of f and h by ")
    assert zoo.source("ckf").startswith(
        "[Arasaratnam & Haykin (2009)](https://doi.org/10.1109/TAC.2009.2019800); 000 (3.3.71"
    )
    assert zoo.source("ddf1").startswith(
        "[Norgaard, Poulsen & Ravn (2000)](https://doi.org/10.1016/S0005-1098%2800%2900089-3);"
    )


def test_the_suite_has_every_solver_and_the_yardstick_on_each_of_its_tasks(benchmarks):
    suite = benchmarks.suite
    by_task = {}
    for portion in suite.SUITE:
        by_task.setdefault(portion.task, []).extend(portion.solvers)
    assert set(by_task) <= set(tasks.names())
    assert sorted(by_task["sway-white-v0"]) == solvers.names()
    for task, names in by_task.items():
        assert suite.YARDSTICK in names, task
        assert len(names) == len(set(names)), task
        assert set(names) <= set(solvers.names()), task


@pytest.fixture
def brief(benchmarks, monkeypatch):
    """A suite of one short task and two solvers."""
    usual = tasks.get_task("sway-white-v0")
    task = dataclasses.replace(usual, name="brief-v0", hold_s=10.0, kwargs={**usual.kwargs, "duration": 70.0})
    monkeypatch.setitem(tasks.TASKS, task.name, task)
    portion = benchmarks.suite.Portion(task.name, 6, ("ckf", "coarse_inertial"))
    monkeypatch.setattr(benchmarks.suite, "SUITE", (portion,))
    monkeypatch.setattr("sins_env.evaluation.speed.cost.MOST_S", 0.1)
    monkeypatch.setattr(benchmarks.suite, "COSTED", (task.name,))
    monkeypatch.setattr(benchmarks.story, "COSTS", dict.fromkeys([task.name], ("brief", ("ckf",))))
    monkeypatch.setattr(benchmarks.story, "TIMES", dict.fromkeys([task.name], ("brief", ("ckf", "coarse_inertial"))))
    return task.name


def test_a_run_goes_on_where_it_ended_and_says_what_it_found(benchmarks, brief, tmp_path):
    leaderboard, path = benchmarks.leaderboard, tmp_path / "r.sqlite"
    with Store(path) as store:
        leaderboard.run(store, most=3, workers=1)
        assert [len(one.records) for one in leaderboard.results(store)[brief]] == [3, 3]
    leaderboard.main(["--db", str(path), "--out", str(tmp_path), "--workers", "1"])
    board = json.loads((tmp_path / "leaderboard.json").read_text())
    (task,) = board["tasks"]
    ckf, other = sorted(board["results"], key=lambda one: one["solver"])
    with Store(path) as store:
        (found,) = [one for one in leaderboard.results(store)[brief] if one.solver == "ckf"]
    assert (task["task"], task["unit"], task["ranked_by"], task["bound_holds"]) == (brief, "arcsec", "score", True)
    assert (ckf["runs"], ckf["paired"], ckf["cost"]) == (6, None, 1.0)
    assert ckf["score"] == pytest.approx(found.summary.rms["U"], rel=1e-4)
    assert ckf["bound_ratio"] == pytest.approx(ckf["score"] / task["bound"], rel=1e-3)
    assert other["paired"]["runs"] == 6
    assert other["paired"]["ratio"] == pytest.approx(other["score"] / ckf["score"], rel=1e-3)
    for name in ("cost", "time"):
        assert "<svg" in (tmp_path / f"{name}.svg").read_text()
    shown = benchmarks.readme.leaderboard(board)
    assert shown.splitlines()[2].startswith(f"| brief | 6 | {task['bound'] / 3600:.2f}° | ")


def entry(task, solver, ratio=None, ends=(0.1, 0.9), failed=0, fewer=(0.0, (-0.1, 0.1))):
    paired = {"runs": 100, "ratio": ratio, "ratio_interval": ends, "apart": ends[1] < 1}
    paired |= {"failures": fewer[0], "failures_interval": fewer[1]}
    scores = {"success": 1.0, "score": 100 * (ratio or 1), "interval": [90, 110], "bound_ratio": ratio or 1.0}
    known = {"runs": 100, "failed": failed, "cost": 2.04, "paired": paired if ratio else None}
    return {"task": task, "solver": solver, **scores, **known}


def test_a_win_is_beyond_chance_and_worth_the_name(benchmarks):
    kinds = {"sway-white-v0": "score", "sway-jump-v0": "score", "flight-hotstart60-v0": "failures"}
    common = {"unit": "arcsec", "bound": 99.0, "bound_holds": False}
    versions = dict.fromkeys(("python", "numpy", "scipy"), "1")
    board = {
        "tasks": [{"task": name, "ranked_by": kind, **common} for name, kind in kinds.items()],
        "provenance": {"started": ["2026-01-01 1", "2026-01-02 2"], "code": "1", "versions": versions},
        "results": [
            *(entry(name, "ckf", failed=52) for name in kinds),
            entry("sway-white-v0", "ekf", 0.5, (0.2, 1.1)),
            entry("sway-white-v0", "gsf_ekf", 0.995, (0.99, 0.999)),
            entry("sway-white-v0", "filterpy_kf", 0.4) | {"runs": 2},
            entry("sway-jump-v0", "gsf_ekf", 0.341),
            entry("flight-hotstart60-v0", "gsf_ekf", 0.8, (0.2, 1.2), 3, (-0.49, (-0.6, -0.4))),
        ],
    }
    zoo = {line.split("`")[1]: line.split(" | ") for line in benchmarks.readme.zoo_table(board).splitlines()[2:]}
    assert zoo["ekf"][-1] == "- |"
    assert zoo["gsf_ekf"][-2:] == ["2.0", "hotstart60 3 failed, not 52, jump 0.34 |"]
    _, _, white, jump, hot, _, made = benchmarks.readme.leaderboard(board).splitlines()
    assert "| `ekf` 50.0″, ×0.500, 0.50 of ckf, 100 %; " in white
    assert white.endswith("`gsf_ekf` 99.5″, ×0.995, 0.99 of ckf, 100 %; `ckf` 100″, ×1.00, 100 % |")
    assert "| (99.0″) | 100″ [90.0″–110″], ×1.00, 100 % | **`gsf_ekf`** 34.1″" in jump
    assert "**`gsf_ekf`** 80.0″, 3 of 100 failed" in hot
    assert made == "Made 2026-01-01 to 2026-01-02 by code 1 (python 1, numpy 1, scipy 1), suite seed 0."
