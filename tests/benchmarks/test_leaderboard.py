"""benchmarks/suite.py, leaderboard.py, pages.py and story.py: the tables and figures are what registry and results say."""

import dataclasses
import importlib
import itertools
import json
import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.text import Text
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
        names = ("choose", "leaderboard", "pages", "story", "suite", "zoo")
        yield SimpleNamespace(**{name: importlib.import_module(name) for name in names})
    finally:
        sys.path.remove(folder)


@pytest.fixture(scope="module")
def board(benchmarks):
    return json.loads(benchmarks.pages.JSON.read_text())


def test_the_pages_are_what_registry_and_results_say(benchmarks, board):
    pages = benchmarks.pages
    for name, blocks in pages.PAGES.items():
        page = pages.page(name).read_text()
        assert pages.written(page, blocks, board) == page, f"docs/{name}.md is stale: python benchmarks/pages.py"


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


def test_the_suite_has_every_solver_and_on_each_task_the_yardstick_and_the_recommended_solver(benchmarks):
    suite = benchmarks.suite
    assert set(suite.PRELIMINARY) <= set(suite.PLAYED) == set(tasks.names())
    by_task = {name: [*found, *suite.PRELIMINARY.get(name, ())] for name, found in suite.PLAYED.items()}
    assert sorted(by_task["sway-white-v0"]) == solvers.names()
    for task, names in by_task.items():
        assert {suite.YARDSTICK, "gsf_imm"} <= set(names), task
        assert len(names) == len(set(names)), task
        assert set(names) <= set(solvers.names()), task
        assert set(suite.SLOW).isdisjoint(suite.PLAYED[task]), task
    assert {"vb_ckf"} <= {name for task in ("sway-told-wrong-v0", "sway-jump-v0") for name in by_task[task]}


def test_a_portion_has_its_runs_and_its_seed(benchmarks):
    suite = benchmarks.suite
    (first,) = [one for one in suite.first() if one.task == "sway-jump-v0"]
    fresh = suite.confirming("sway-jump-v0", "gsf_imm")
    assert (first.seed, first.suite, fresh.seed, fresh.solvers) == (None, "A", 1, ("gsf_imm", "ckf"))
    assert suite.confirming("sway-jump-v0", "ckf").solvers == ("ckf",)
    assert suite.confirming("rlg-car-v0", "ckf") is None
    one, other = first.evaluations()[0], fresh.evaluations()[-1]
    assert (len(one.runs), len(other.runs), one.key.suite != other.key.suite) == (200, 200, True)
    assert len(first.evaluations(7)[0].runs) == 7
    assert len(suite.Portion("rlg-car-v0", 200, ("ckf",)).evaluations()[0].runs) == 7
    assert first.cpu_s({"sway-white-v0": {"ckf": 10.0}}) == pytest.approx(7.2)  # 3,600 epochs
    assert suite.costed_for("vehicle-v0") == suite.COSTED[0]
    assert suite.costed_for("flight-lu-mixture-v0") == suite.costed_for("navgrade-car-v0") == suite.COSTED[1]


@pytest.fixture
def brief(benchmarks, monkeypatch):
    """A suite of one short task and two solvers."""
    usual = tasks.get_task("sway-white-v0")
    task = dataclasses.replace(usual, name="brief-v0", hold_s=10.0, kwargs={**usual.kwargs, "duration": 70.0})
    monkeypatch.setitem(tasks.TASKS, task.name, task)
    suite = benchmarks.suite
    monkeypatch.setattr(suite, "PLAYED", {task.name: ("ckf", "coarse_inertial")})
    monkeypatch.setattr(suite, "PRELIMINARY", {task.name: ("kf",)})
    monkeypatch.setattr(suite, "SLOW", ("kf",))
    monkeypatch.setattr(suite, "RUNS", 6)
    monkeypatch.setattr(suite, "FEW", 2)
    monkeypatch.setattr("sins_env.evaluation.speed.cost.MOST_S", 0.1)
    monkeypatch.setattr(suite, "COSTED", (task.name,))
    monkeypatch.setattr(benchmarks.story, "COSTS", dict.fromkeys([task.name], ("brief", ("ckf",))))
    monkeypatch.setattr(benchmarks.story, "TIMES", dict.fromkeys([task.name], ("brief", ("ckf", "coarse_inertial"))))
    return task.name


def test_a_run_goes_on_where_it_ended_and_says_what_it_found(benchmarks, brief, tmp_path, capsys):
    leaderboard, path = benchmarks.leaderboard, tmp_path / "r.sqlite"
    with Store(path) as store:
        leaderboard.run(store, most=3, workers=1, stages=1)
        assert [len(one.records) for one in leaderboard.of_task(store, brief)] == [3, 3]
    capsys.readouterr()
    leaderboard.main(["--db", str(path), "--out", str(tmp_path), "--workers", "1"])
    assert "brief, suite A: 2 solvers, 6 runs; about " in capsys.readouterr().err
    made = json.loads((tmp_path / "leaderboard.json").read_text())
    assert made["scoring"] == 2
    (task,) = made["tasks"]
    entries = {(one["suite"], one["solver"]): one for one in made["results"]}
    assert set(entries) == {("A", "ckf"), ("A", "coarse_inertial"), ("A", "kf"), ("B", task["leader"]), ("B", "ckf")}
    ckf, other = entries["A", "ckf"], entries["A", "coarse_inertial"]
    with Store(path) as store:
        (found,) = [one for one in leaderboard.of_task(store, brief) if one.solver == "ckf"]
    assert (task["task"], task["unit"], task["bound_holds"]) == (brief, "rad", True)
    assert (ckf["runs"], ckf["p"], ckf["cost"], entries["A", "kf"]["runs"]) == (6, None, 1.0, 2)
    assert (ckf["preliminary"], ckf["rank"]) == (True, None)
    assert ckf["rms_raw"] == pytest.approx(math.radians(found.summary.rms["U"] / 3600), rel=1e-4)
    assert other["ratio"] == pytest.approx(other["score"] / ckf["score"], rel=1e-3)
    assert entries["B", "ckf"]["rms_raw"] != ckf["rms_raw"]
    for name in ("cost", "failures", "time"):
        assert "<svg" in (tmp_path / f"{name}.svg").read_text()
    shown = benchmarks.pages.leaders(made)
    assert shown.splitlines()[2].startswith(f"| brief | {math.degrees(task['bound']):.2f}° | ")
    assert "### brief-v0" in benchmarks.pages.results(made)
    with Store(path) as store:
        assert json.loads(leaderboard.as_text(leaderboard.as_data(store))) == made


@pytest.mark.parametrize(
    ("factor", "scatter", "runs", "verdict"),
    [(1.0, 0.001, 200, "equal"), (1.5, 0.1, 200, "apart"), (0.914, 0.3, 800, "open"), (0.95, 0.3, 400, "apart")],
)
def test_a_pair_is_looked_at_until_it_is_decided(benchmarks, monkeypatch, factor, scatter, runs, verdict):
    leaderboard, rng = benchmarks.leaderboard, np.random.default_rng(5)
    shared = np.exp(0.3 * rng.normal(size=800))
    errors = {"ckf": factor * shared * np.exp(scatter * rng.normal(size=800)), "ekf": shared}
    asked = []

    def look(store, task, pair, count):
        asked.append(count)
        a, b = (errors[name][:count] ** 2 for name in pair)
        return leaderboard.compared(task, pair, a, b)

    ranked = [(SimpleNamespace(solver=name), SimpleNamespace(rank=1)) for name in ("ekf", "ckf")]
    monkeypatch.setattr(leaderboard, "_look", look)
    (found,) = leaderboard.looks(None, "sway-white-v0", ranked)
    assert (found["runs"], found["verdict"]) == (runs, verdict)
    assert asked == [count for count in (200, 400, 800) if count <= runs]
    assert leaderboard.still_open([found]) == (("ekf", "ckf") if verdict == "open" else ())


# ---- words ----


def entry(task, solver, suite="A", **said):
    """A result as leaderboard.json has it."""
    usual = {"runs": 200, "failed": 0.0, "failed_ci": [0.0, 0.018], "aligned": 1.0, "aligned_ci": [0.98, 1.0]}
    usual |= {"score": 1e-3, "score_ci": [0.9e-3, 1.1e-3], "median": 6e-4, "median_ci": [5e-4, 7e-4], "time_s": 120.0}
    usual |= {"x_bound": 1.1, "x_bound_ci": [1.0, 1.2], "preliminary": False, "nees": 1.0, "cost": 2.04, "rank": 2}
    usual |= dict.fromkeys(("ratio", "ratio_ci", "p", "p_adjusted", "word", "fragile"))
    return {"task": task, "suite": suite, "solver": solver, **usual, **said}


def won(ratio, **said):
    return {
        "ratio": ratio,
        "ratio_ci": [0.9 * ratio, 1.1 * ratio],
        "p": 0.0001,
        "p_adjusted": 0.004,
        "word": "wins",
    } | said


@pytest.fixture
def told(benchmarks):
    """A board of two tasks, as JSON."""
    names = ("sway-white-v0", "flight-hotstart60-v0")
    common = {"what": "a task", "score": "azimuth error", "unit": "rad", "cap": 0.01, "bound": 9e-4, "scored": True}
    return {
        "tasks": [
            {"task": name, "leader": "gsf_imm", "bound_holds": i == 0, **common} for i, name in enumerate(names)
        ],
        "provenance": {
            "started": ["2026-01-01 1", "2026-01-02 2"],
            "code": "1",
            "versions": dict.fromkeys(("python", "numpy", "scipy"), "1"),
            "adopted": [{"before": "0", "compared": 200}],
        },
        "results": [
            *(entry(name, "ckf", suite) for name, suite in itertools.product(names, "AB")),
            entry(names[0], "gsf_imm", rank=1, **won(0.8, fragile=False)),
            entry(names[0], "two_pass", rank=1, score=1.05e-3, **won(0.85, word="undecided", p_adjusted=0.3, fragile=False)),
            entry(names[0], "gpf", runs=40, preliminary=True, rank=None),
            entry(names[0], "gsf_imm", "B", **won(0.9, fragile=False)),
            entry(names[1], "gsf_imm", rank=1, failed=0.015, failed_ci=[0.003, 0.043], **won(0.02, fragile=True)),
            entry(names[1], "gsf_imm", "B", **won(0.97, p=0.3, word="undecided", fragile=False)),
        ],
        "pairs": [
            {"task": names[0], "a": "gsf_imm", "b": "two_pass", "runs": 400, "ratio": 0.97, "ratio_ci": [0.96, 0.98],
             "verdict": "apart"}
        ],
    }  # fmt: skip


def test_the_tables_say_who_wins_and_how_sure_it_is(benchmarks, told):
    pages = benchmarks.pages
    _, _, white, hot, _, claims, _, made = pages.leaders(told).splitlines()
    assert white.startswith(
        "| white | 186″ | 206″ [186″–227″], ×1.10 [1.00–1.20], 0 of 200 failed [0–1.8 %], 120 s | **`gsf_imm`** "
    )
    assert white.endswith("| 0.900 [0.810–0.990], p < 0.001: confirmed | `two_pass` |")
    assert hot.startswith("| hotstart60 | (186″) | ")
    assert hot.endswith("| 0.970 [0.873–1.07], p 0.3: not told apart | - |")
    told["results"] = [one for one in told["results"] if (one["suite"], one["solver"]) != ("B", "gsf_imm")]
    alone = pages.leaders(told).splitlines()[2]  # what selected it does not confirm it
    assert " `gsf_imm` " in alone
    assert "**`gsf_imm`**" not in alone
    assert "on the runs that selected it, not confirmed | `two_pass` |" in alone
    assert claims.startswith("On 2 tasks 3 solvers are compared with `ckf`")
    assert "2 wins, 1 of them fragile" in claims
    assert "wins against `ckf` on 1 of 2 tasks" in claims
    assert made.startswith(
        "Made 2026-01-01 to 2026-01-02 by code 1 (python 1, numpy 1, scipy 1), suite seeds 0 (A) and 1 (B). Rows of code 0"
    )
    zoo = {line.split("`")[1]: line.split(" | ") for line in pages.zoo_table(told).splitlines()[2:]}
    assert zoo["gsf_imm"][-2:] == ["2.0", "hotstart60 0.020 (fragile), white 0.80 |"]
    assert zoo["two_pass"][-1] == "- |"
    page = pages.results(told).splitlines()
    assert (
        "| - | `gpf` | 40 | 0 [0–1.8 %] | 206″ [186″–227″] | ×1.10 [1.00–1.20] | 124″ | 120 | 1.0 | 2.0 | - | preliminary |"
        in page
    )
    (win,) = [line for line in page if "wins, fragile" in line]
    assert "| 3 [0.3–4.3 %] |" in win
    assert "| (×1.10 [1.00–1.20]) |" in win
    assert "| 0.0200 [0.0180–0.0220], p 0.004 | wins, fragile |" in win
    assert "`gsf_imm` and `two_pass` are told apart at 400 runs: 0.970 [0.960–0.980]." in page


def taken(benchmarks, told):
    """The solver that the table takes in each of its rows, and the rows."""
    rows = benchmarks.choose.situations(told).splitlines()[2:]
    return [row.split("`")[1] for row in rows], rows


def test_the_cheapest_solver_that_is_as_good_as_the_leader_is_taken(benchmarks, told):
    """Cost decides among the leader's equals: those that win as it does, and are no worse than one told apart from it."""
    white, (_, two_pass) = "sway-white-v0", told["results"][4:6]
    names, (first, hot) = taken(benchmarks, told)
    assert names == ["gsf_imm", "gsf_imm"]
    assert first.startswith(
        "| [all is as told, base sways](leaderboard.md#sway-white-v0) | **`gsf_imm`** | 2.0 | ×1.10 ["
    )
    assert first.endswith("| 0.900 [0.810–0.990], confirmed on suite B | ×1.10 [1.00–1.20], 0 of 200 [0–1.8 %] |")
    assert "| 0.970 [0.873–1.07], not told apart on suite B |" in hot
    two_pass.update(cost=1.0, word="wins")
    assert taken(benchmarks, told)[0][0] == "gsf_imm"  # the pair is told apart
    told["pairs"] = []
    names, (first, _) = taken(benchmarks, told)
    assert names[0] == "two_pass"
    assert "| `two_pass` | 1.0 |" in first
    assert "wins on suite A | ×" in first
    two_pass["word"] = "undecided"
    assert taken(benchmarks, told)[0][0] == "gsf_imm"  # the leader wins, and it does not
    told["tasks"] = [task for task in told["tasks"] if task["task"] != white]
    assert len(taken(benchmarks, told)[1]) == 1  # nothing is said of what has not been played


def test_one_solver_for_everything_is_the_one_that_is_beaten_least(benchmarks, told):
    for one in told["results"]:
        one["cost"] = {"gsf_imm": 7.0, "ckf": 1.0}.get(one["solver"], 3.0)
    everything, cheap = benchmarks.choose.whole(told).splitlines()[2:]
    assert everything == "| one solver for everything | `gsf_imm` | 7.0 | 2 of 2 tasks | - |"
    assert cheap == "| one that costs at most 2 `ckf` | `ckf` | 1.0 | 0 of 2 tasks | white, hotstart60 |"


def test_every_situation_is_a_task_of_the_suite(benchmarks):
    assert set(benchmarks.choose.SITUATIONS) <= set(tasks.names())


def test_no_label_of_a_figure_covers_another_or_a_line(benchmarks):
    """Eight names beside points that lie close to each other and to lines, in axes of the size of the figure's."""
    story = benchmarks.story
    figure = story.new_figure(story.WIDTH, 6.4)
    axes = figure.subplots(2, 2)[0, 0]
    points = {f"solver_{i}": (1.0 + 0.02 * i, 1.0 + 0.01 * (i % 3)) for i in range(8)}
    axes.set(xscale="log", yscale="log", xlim=(0.5, 5), ylim=(0.8, 3))
    for point in points.values():
        axes.plot(*point, "o")
    axes.axhline(1.04)
    axes.step([0.9, 1.2, 1.6], [1.5, 1.1, 0.95], where="post")
    figure.canvas.draw()
    lines = story.strokes(axes)
    texts = story.labels(axes, points, points.values(), dict.fromkeys(points, "black"))
    figure.canvas.draw()
    boxes = [Text.get_window_extent(text) for text in texts]  # without the line to the point
    assert len(boxes) == 8
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    assert len(lines) == 5  # one, and two steps of two pieces each
    assert not any(box.overlaps(line) for box in boxes for line in lines)
    room = axes.get_window_extent()
    assert all(room.x0 <= box.x0 and box.x1 <= room.x1 and room.y0 <= box.y0 and box.y1 <= room.y1 for box in boxes)
