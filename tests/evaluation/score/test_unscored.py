"""A recording without a reference: no errors, so no score, no success and no rank, but a spread and failures."""

import csv
import dataclasses
import io
import json
import math

import numpy as np
import pytest
from oracles import recorded
from rich.console import Console

from sins_env.cli.main import main
from sins_env.evaluation import evaluate, run_episode
from sins_env.evaluation.score import ranking
from sins_env.evaluation.show import cells, error_figure, numbers, plain_tables, run_figure, style, terminal_tables
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks import catalogue as tasks
from sins_env.evaluation.tasks.task import EvaluationTask

HERE = "evaluation.plugins:"


@pytest.fixture
def unscored(tmp_path, monkeypatch):
    """Three windows of 40 s of a synthetic recording, as a task."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    still = {"gyro_counts": np.ones((6000, 3), np.int16), "accel_counts": np.full((6000, 3), [0, 0, 8100], np.int16)}
    path = recorded.counts(tmp_path / "still.npz", 6000, ref_t_s=None, ref_q_b2n_wxyz=None, **still)
    kwargs = {"recording": path, "window": [0.0, 40.0], "stride": 5.0, "coarse": 5.0}
    task = EvaluationTask(
        "still-v0", "a recording", "test", "SINS/Replay-v0", 0.3, 90.0, kwargs, hold_s=10.0, windows=3
    )
    monkeypatch.setitem(tasks.TASKS, task.name, task)
    return task


@pytest.fixture
def found(unscored):
    return evaluate(unscored, HERE + "Noisy", 3, workers=1, cost=False)


def test_nothing_is_scored_but_spread_and_failures(found, unscored):
    records, s = found.records, found.summary
    assert records.criteria.scored is False
    for name in ("t_conv", "hold_max", "steady_mean", "steady_std", "steady_rms", "final", "nees", "history"):
        assert np.isnan(getattr(records, name)).all(), name
    assert list(records.status) == ["ok"] * 3
    assert math.isnan(s.success)
    assert math.isnan(s.t_conv_median_s)
    assert math.isnan(s.t_conv_restricted_mean_s)
    assert all(math.isnan(value) for value in (*s.rms.values(), *s.rms_final.values(), *s.success_by_axis.values()))
    assert 0 < s.spread_deg < 1
    assert (s.spread_runs, s.failures, s.scored) == (3, 0, False)


@pytest.mark.parametrize("how", ["nan", "zero", "raise"])
def test_failures_are_counted(unscored, how):
    found = evaluate(unscored, HERE + "UnknownAt", 3, workers=1, cost=False, settings={"how": how})
    assert list(found.records.status) == ["raised" if how == "raise" else "diverged"] * 3
    assert found.records.broken.all()
    assert np.isnan(found.records.final).all()
    assert found.summary.failures == 3
    assert cells.failure_text(found.summary) == ("3 raised" if how == "raise" else "3 diverged")


def test_lost_runs_are_not_scored_either(unscored):
    class LosesAll:
        def run(self, jobs, progress):
            yield from ((job, None) for job in jobs)

    found = evaluate(unscored, HERE + "Noisy", 3, executor=LosesAll(), cost=False)
    assert list(found.records.status) == ["lost"] * 3
    assert np.isnan(found.records.final).all()
    assert np.isnan(found.records.t_conv).all()


def test_every_form_shows_no_score(found):
    other = dataclasses.replace(found, solver="other")
    assert [(rank, one.solver) for rank, one in ranking.ranked([other, found])] == [
        (None, "other"),
        (None, found.solver),
    ]
    for entry in json.loads(plain_tables.as_json([found, other])):
        assert entry["success"] is entry["t_conv_median_s"] is None
        assert set(entry["rms"].values()) == {None}
        assert entry["failures"] == entry["failed"] == 0
        assert entry["score"] is entry["median"] is entry["aligned"] is entry["rank"] is None
        assert entry["scoring"] == 2
    for row in csv.DictReader(io.StringIO(plain_tables.as_csv([found, other]))):
        assert row["rank"] == row["success"] == row["rms_u_arcsec"] == row["t_conv_median_s"] == row["rms_n_low"] == ""
        assert float(row["spread_deg"]) == found.summary.spread_deg
        assert row["diverged"] == "0"
    head, _, row = (line.strip("|").split("|") for line in plain_tables.as_markdown([found]).splitlines()[4:7])
    said = {name.strip(): cell.strip() for name, cell in zip(head, row, strict=True) if cell.strip() != "-"}
    spread = numbers.number_text(found.summary.spread_deg)
    assert said == {"solver": found.solver, "failed": "0 of 3 [0–71 %]", "spread, deg": spread}
    for width in (80, 120):
        console = Console(width=width, file=io.StringIO())
        console.print(terminal_tables.table([found, other], width))
        text = console.file.getvalue()
        assert "no reference" in text
        assert numbers.number_text(found.summary.spread_deg) in text
        for part in ("nan", "never", "score  ", "median"):
            assert part not in text


def test_stored_and_read_back(found, tmp_path):
    key = Key.of("still-v0", found.suite, found.solver, {}, "1")
    with Store(tmp_path / "r.sqlite") as db:
        db.add(key, found.records)
        again = db.results(key)
    assert again.records.criteria.scored is False
    assert again.summary.spread_deg == found.summary.spread_deg
    assert plain_tables.as_json([again]) == plain_tables.as_json([found])


def test_figures(found, unscored):
    figure = error_figure.error_figure([found, dataclasses.replace(found, solver="other")])
    texts = [text.get_text() for axes in figure.subfigs[0].axes for text in axes.texts]
    assert texts == [style.NO_REFERENCE] * 3
    assert not any(line.get_label() == found.label for axes in figure.subfigs[0].axes for line in axes.lines)
    figure.canvas.draw()
    course = run_episode("still-v0", HERE + "Noisy")
    assert np.isnan(course.phi).all()
    figure = run_figure.run_figure(unscored, "Noisy", course)
    figure.canvas.draw()
    assert style.NO_REFERENCE in figure.get_suptitle()


def test_command_line(unscored, capsys):
    assert main(["eval", "--task", "still-v0", "--solver", HERE + "Noisy", "--workers", "1", "--plot", "e.png"]) == 0
    assert "no reference" in capsys.readouterr().out
    assert main(["run", "still-v0", HERE + "Noisy", "--plot", "r.png"]) == 0
    out = capsys.readouterr().out
    assert "no reference to score against; heading at the end" in " ".join(out.split())
    assert "not aligned" not in out
    assert "nan" not in out
