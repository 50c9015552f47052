"""Results files of several machines become one: each run once, conflicts named, nothing half written."""

import contextlib
import json
import shutil
import sqlite3
import zlib
from pathlib import Path

import numpy as np
import pytest
from evaluation import plugins
from evaluation.short import SHORT
from evaluation.test_monte_carlo import assert_same

from sins_env.evaluation import evaluate
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.show.plain_tables import as_csv
from sins_env.evaluation.speed.cost import Cost
from sins_env.evaluation.store.filling import Evaluation, fill
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store

SOLVER = "evaluation.plugins:Told"
OLD = Path(__file__).parent / "data"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two files that share runs 2 and 3, one with all six, and the key."""
    folder = tmp_path_factory.mktemp("made")
    found = evaluate(SHORT, plugins.Told, 6, workers=1, cost=False)
    key = Key.of(SHORT.name, found.suite, SOLVER, {}, "1")
    for name, runs in (("a", range(4)), ("b", range(2, 6)), ("all", range(6))):
        with Store(folder / f"{name}.sqlite") as db:
            db.add_task(SHORT)
            db.add(key, Records.of_rows(found.records.criteria, [found.records.row(i) for i in runs]))
            db.add_cost(key, Cost(100.0 + len(name), 150.0, 1.5))
    return folder, key


@pytest.fixture
def files(made, tmp_path, monkeypatch, short):
    """The two files in this folder; ``change(...)`` runs statements on the second."""
    for name in ("a", "b"):
        shutil.copy(made[0] / f"{name}.sqlite", tmp_path)
    monkeypatch.chdir(tmp_path)

    def change(*statements, name="b"):
        with contextlib.closing(sqlite3.connect(f"{name}.sqlite")) as db, db:
            for one in statements:
                one(db) if callable(one) else db.execute(one)

    return change


def merged(cli, *more):
    return cli("merge", "a.sqlite", "b.sqlite", "--db", "c.sqlite", *more)


def test_each_run_once(made, files, cli, short):
    folder, key = made
    assert merged(cli) == (0, "c.sqlite: 6 runs of 2 files, 2 rows were there already\n", [])
    with Store("c.sqlite") as one, Store(folder / "all.sqlite", read_only=True) as other:
        assert as_csv([one.results(key)]).replace("101", "103") == as_csv([other.results(key)]).replace("101", "103")
        assert_same(one.results(key).records, other.results(key).records, rtol=0, but=())
        assert one.results(key).cost.median_us == 101.0  # of the first file that has one
        assert [session.runs for session in one.sessions(key)] in ([6], [4, 2])
        # --resume goes on from there
        wanted = Evaluation(short, SOLVER, {}, tuple(range(6)), key)
        assert wanted.missing(one) == []
        fill(one, [wanted], workers=1)
    assert sorted(path.name for path in Path().iterdir()) == ["a.sqlite", "b.sqlite", "c.sqlite"]


def history(scale):
    """Change the history of run 3 of the second file."""

    def change(db):
        sql = "SELECT id, history FROM histories JOIN runs USING (id) WHERE run = 3"
        number, blob = db.execute(sql).fetchone()
        values = np.frombuffer(zlib.decompress(blob), dtype="<f4") * np.float32(scale)
        db.execute("UPDATE histories SET history = ? WHERE id = ?", (zlib.compress(values.tobytes(), 1), number))

    return change


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ("UPDATE runs SET final_u = 0.25 WHERE run >= 3", "code 1: run 3: final_u_rad "),
        ("UPDATE runs SET final_u = 0.25 WHERE run = 2", " in a.sqlite, 0.25 in b.sqlite"),
        ("UPDATE runs SET final_u = NULL", "; also run 3"),
        ("UPDATE runs SET status = 'lost', reason = 'x' WHERE run = 2", "status diverged in a.sqlite, lost in b.sqlite"),
        ("UPDATE runs SET repairs = 3 WHERE run = 3", "run 3: repairs 0 in a.sqlite, 3 in b.sqlite"),
        (history(1.001), "run 3: history in a.sqlite and in b.sqlite"),
        ("UPDATE tasks SET digest = 'other'", "another world, digest "),
        ("UPDATE tasks SET criteria = replace(criteria, '\"hold_s\": 5', '\"hold_s\": 6')", "hold_s = 5.0 in a.sqlite, 6.0"),
        ("UPDATE tasks SET definition = replace(definition, '20.0', '21.0')", "another definition, kwargs = "),
        (lambda db: bound(db, 1.01), "another bound, in "),
    ],
)  # fmt: skip
def test_conflicts_are_named_and_nothing_is_written(files, cli, change, text):
    files(change)
    code, out, err = merged(cli)
    assert (code, out) == (1, "")
    assert text in err[0]
    assert "short-v0" in err[0]
    assert err[-1].startswith("sins-env: 1 conflict, c.sqlite is not written: leave a file out; ")
    assert sorted(path.name for path in Path().iterdir()) == ["a.sqlite", "b.sqlite"]


def bound(db, factor):
    ((text,),) = db.execute("SELECT bound FROM tasks").fetchall()
    given = json.loads(text)
    given["final"] = [factor * one for one in given["final"]]
    db.execute("UPDATE tasks SET bound = ?", (json.dumps(given),))


def test_rounding_times_and_messages_are_no_conflict(files, cli):
    files(
        "UPDATE runs SET final_u = final_u * (1 + 1e-12), step_s = 7, reason = 'slow'",
        history(1 + 1e-6),
        lambda db: bound(db, 1 + 1e-9),
    )
    assert merged(cli)[0] == 0


def test_other_code_and_other_versions_are_told(made, files, cli):
    """The latest code is that of the latest session, whatever the order of the files."""
    files("UPDATE runs SET code = '0'", "UPDATE sessions SET started = '2001-01-01 00:00:00'")
    code, out, err = merged(cli)
    assert (code, out) == (0, "c.sqlite: 8 runs of 2 files\n")
    text = f"{SOLVER} on short-v0: made with several codes, 1 in a.sqlite, 0 in b.sqlite; tables show the latest"
    assert err == [text]
    with Store("c.sqlite", read_only=True) as store:
        assert [one.code for one in Store.keys(store)] == ["1"]
    later = [f"UPDATE {table} SET task = 'short-v1'" for table in ("runs", "costs", "tasks")]
    files(*later, "UPDATE tasks SET definition = replace(definition, 'short-v0', 'short-v1')")
    Path("c.sqlite").unlink()
    code, _, err = merged(cli)
    assert (code, len(err)) == (0, 1)
    assert "several versions of a task, which do not compare: short-v0 in a.sqlite, short-v1 in b.sqlite" in err[0]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ("CREATE TRIGGER t AFTER INSERT ON runs BEGIN SELECT 1; END", "b.sqlite: it has the trigger 't'"),
        ("UPDATE runs SET final_u = 1e9", "b.sqlite: table runs, row 1: final_u is"),
        ("UPDATE histories SET history = x'00'", f"b.sqlite: rows of {SOLVER} on short-v0 cannot be read"),
        ("DELETE FROM histories", f"b.sqlite: rows of {SOLVER} on short-v0 cannot be read"),
        ("PRAGMA user_version = 99", "b.sqlite: results of schema 99"),
    ],
)
def test_a_file_of_a_stranger(files, cli, change, text):
    files(change)
    code, _, (line,) = merged(cli)
    assert code == 2
    assert text in line
    assert not Path("c.sqlite").exists()


def test_a_file_of_version_010(files, cli):
    with contextlib.closing(sqlite3.connect("old.sqlite")) as db:
        db.executescript((OLD / "version010.sql").read_text())
    assert cli("merge", "a.sqlite", "old.sqlite", "--db", "c.sqlite")[0] == 0
    tables = {}
    for name in ("a", "old", "c"):
        with Store(f"{name}.sqlite", read_only=True) as store:
            tables[name] = {(key, as_csv([store.results(key)])) for key in Store.keys(store)}
    assert tables["c"] == tables["a"] | tables["old"]


def test_an_existing_file_stays(files, cli):
    Path("c.sqlite").write_text("mine")
    code, _, (line,) = merged(cli)
    assert (code, "c.sqlite exists, and a merge changes no file" in line) == (2, True)
    assert Path("c.sqlite").read_text() == "mine"
    code, _, (line,) = cli("merge", "a.sqlite", "none.sqlite", "--db", "d.sqlite")
    assert (code, "none.sqlite: no such results file" in line) == (2, True)
    code, _, (line,) = cli("merge", "a.sqlite", "--db", "none/d.sqlite")
    assert (code, "none/d.sqlite" in line, ".part" in line) == (2, True, False)


def test_interrupted(files, cli, monkeypatch):
    insert, rows = Store.insert, []

    def interrupted(self, *row):
        rows.append(row)
        if len(rows) == 3:
            raise KeyboardInterrupt
        return insert(self, *row)

    monkeypatch.setattr(Store, "insert", interrupted)
    assert merged(cli)[0] == 130
    assert sorted(path.name for path in Path().iterdir()) == ["a.sqlite", "b.sqlite"]
