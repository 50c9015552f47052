"""benchmarks/board.py: it runs, and what a board of many rows costs is counted: statements, rows and resamples."""

import re
import runpy
import sqlite3

import pytest
from places import ROOT

from sins_env.evaluation.score import metrics
from sins_env.evaluation.store.inspection import _RULES
from sins_env.evaluation.store.schema import SCHEMA

SOLVERS = 5
#: Statements that open a file: 6 find out what it is, 2 begin and end a snapshot, 3 list the tables, and 5 read names, settings,
#: tasks and sessions; columns are asked of all that SCHEMA makes, pages of the tables but histories, and values by rule.
OPENING = 16 + len(SCHEMA) + (sum("CREATE TABLE" in one for one in SCHEMA) - 1) + len(_RULES)


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "benchmarks" / "board.py"))


def counted(cli, path, monkeypatch):
    """The board of a file: what it prints, the statements it asks the file, and the sizes of what it resamples."""
    statements, drawn, connect, intervals = [], [], sqlite3.connect, metrics.rms_intervals

    def traced(*arguments, **settings):
        connection = connect(*arguments, **settings)
        connection.set_trace_callback(
            lambda one: one.startswith("--") or statements.append(one)
        )  # not those inside others
        return connection

    with monkeypatch.context() as patch:
        patch.setattr(sqlite3, "connect", traced)
        patch.setattr(metrics, "rms_intervals", lambda errors: (drawn.append(errors.shape), intervals(errors))[1])
        code, out, err = cli("board", "--db", path)
    assert (code, err) == (0, [])
    return out, statements, drawn


def test_a_board_asks_as_often_whatever_the_runs_and_resamples_solvers_together(script, cli, tmp_path, monkeypatch):
    tasks, asked = script["TASKS"][:2], []
    monkeypatch.setenv("COLUMNS", "120")
    for runs in (20, 60):
        path = tmp_path / f"{runs}.sqlite"
        script["make_file"](path, tasks, SOLVERS, runs)
        out, statements, drawn = counted(cli, path, monkeypatch)
        assert out.count(f"of {runs}") == SOLVERS * len(tasks)
        assert all(name in out for name in tasks)
        assert not any(
            re.search("(FROM|JOIN) histories", one) for one in statements
        )  # most of a file, which no table shows
        assert drawn == [(runs, 3 * SOLVERS)] * len(tasks)
        asked.append(len(statements))
    of_keys, of_tasks, of_solvers = 1, 2 * len(tasks), 4 * len(tasks) * SOLVERS
    assert asked == [OPENING + of_keys + of_tasks + of_solvers] * 2


def test_it_times_a_process(script, tmp_path):
    path = tmp_path / "small.sqlite"
    script["make_file"](path, script["TASKS"][:1], 2, 20)
    text, wall, cpu = script["time_board"](path)
    assert text.count("of 20") == 2
    assert wall > 0
    assert cpu > 0
