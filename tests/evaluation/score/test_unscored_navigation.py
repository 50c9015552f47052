"""A recording without a reference, navigated: no score anywhere, but failures, a page, and what the carrier's phase says."""

import csv
import dataclasses
import io
import json

import numpy as np
import pytest
from evaluation.replay.test_track import drive

from sins_env import recordings
from sins_env.evaluation import compare, evaluate
from sins_env.evaluation.score import ranking
from sins_env.evaluation.show import error_figure, plain_tables
from sins_env.evaluation.tasks import catalogue as tasks
from sins_env.evaluation.tasks.task import EvaluationTask

SOLVER = "evaluation.replay.followers:Driven"


def record(path, **left_out):
    recordings.save(dataclasses.replace(drive(), reference=None, **left_out), path)
    return str(path)


@pytest.fixture
def unscored(tmp_path, monkeypatch):
    """Two windows of 30 s, as a task that would rank by position."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    kwargs = {"recording": record(tmp_path / "drive.npz"), "mode": "navigate", "window": [100.0, 30.0], "stride": 10.0}
    kwargs |= {"coarse": 5.0}
    task = EvaluationTask(
        "drive-v0", "a drive", "test", "SINS/Replay-v0", 0.3, 90.0, kwargs, hold_s=10.0, windows=2, rank_by="position"
    )
    monkeypatch.setitem(tasks.TASKS, task.name, task)
    return task


@pytest.fixture
def found(unscored):
    return evaluate(unscored, SOLVER, 2, workers=1, cost=False)


def test_there_is_nothing_to_compare(found):
    with pytest.raises(ValueError, match="drive-v0 has no truth; allowed: tasks whose errors are scored"):
        compare(found, found)


def test_nothing_is_scored(found):
    records, s = found.records, found.summary
    assert records.status.tolist() == ["ok", "ok"]
    for name in ("t_conv", "final", "span_rms", "span_final", "nees_all", "history"):
        assert np.isnan(getattr(records, name)).all(), name
    assert records.span_rms.shape == (2, 12)
    assert np.isnan([value for value, _ in s.navigation.armse.values()]).all()
    assert np.isnan([value for value, _ in s.navigation.rms.values()]).all()
    assert np.isnan(s.navigation.median_azimuth[0])
    assert found.bound is None
    assert s.counts["any"] == 0


@pytest.mark.parametrize("rank_by", ["position", "failures"])
def test_all_tie_in_every_form(found, rank_by):
    task = dataclasses.replace(found.task, rank_by=rank_by)
    pair = [dataclasses.replace(found, task=task, solver=name) for name in ("one", "other")]
    assert [rank for rank, _ in ranking.ranked(pair)] == [None, None]
    for entry in json.loads(plain_tables.as_json(pair)):
        assert {*entry["armse"].values(), *entry["rms"].values(), entry["bound_ratio"]} == {None}
    for row in csv.DictReader(io.StringIO(plain_tables.as_csv(pair))):
        assert (
            row["rank"] == row["armse_position_h_m"] == row["rms_velocity_m_per_s"] == row["median_heading_deg"] == ""
        )
    assert "nan" not in plain_tables.as_markdown(pair)
    error_figure.error_figure(pair).canvas.draw()


def test_command_line(unscored, tmp_path, cli):
    assert cli("eval", "--task", unscored.name, "--solver", SOLVER, "--runs", 2, "--workers", 1)[0] == 0
    assert cli("report", "--html", "r.html")[0] == 0
    assert "no reference" in (tmp_path / "r.html").read_text()
    assert cli("export", "--csv", "e.csv")[0] == 0
    assert cli("verify", "--workers", 1, "--solver", SOLVER)[0] == 0
    code, _, (said,) = cli("compare", unscored.name, SOLVER, SOLVER)
    assert (code, "against itself; allowed: two solvers, or two settings of one in results.sqlite" in said) == (2, True)
    code, out, _ = cli("run", unscored.name, SOLVER, "--plot", "run.png")
    assert (code, "nan" in out) == (0, False)
    for text in ("position, horizontal", "no reference to score against"):
        assert text in " ".join(out.split())
    assert "nan" not in cli("board")[1]


@pytest.mark.parametrize("displacements", [True, False])
def test_replay(tmp_path, monkeypatch, cli, displacements):
    """Against the phase of the carrier where there is some; otherwise the table says that there is nothing."""
    monkeypatch.setenv("COLUMNS", "120")
    path = record(tmp_path / "drive.npz", **({} if displacements else {"displacements": None}))
    plot = tmp_path / "way.png"
    outage = ["--outage", 6, 8] if displacements else []
    code, out, _ = cli("replay", path, SOLVER, "--mode", "navigate", "--coarse", 5, "--plot", plot, *outage)
    assert code == 0
    assert "nan" not in out
    assert ("displacement, m" in out) is ("withheld" in out) is displacements
    assert ("nothing to compare with" in out) is not displacements
    assert plot.stat().st_size > 20_000
