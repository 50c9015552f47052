"""The results file: what is written is read back, by several at once; what cannot be is one clear error."""

import csv
import dataclasses
import io
import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sins_env.evaluation import evaluate
from sins_env.evaluation.bound import bounds
from sins_env.evaluation.show import plain_tables
from sins_env.evaluation.store import database, store
from sins_env.evaluation.store.database import StoreError
from sins_env.evaluation.store.key import Key, canonical
from sins_env.evaluation.store.schema import SCHEMA_VERSION
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks import catalogue, fingerprint
from sins_env.evaluation.tasks.task import EvaluationTask


@pytest.fixture
def results(short):
    return evaluate(short, "evaluation.plugins:At", 4, workers=1, settings={"epoch": 150}, cost=False)


@pytest.fixture
def key(results):
    return Key.of("short-v0", results.suite, results.solver, results.settings, "1")


def test_round_trip(tmp_path, results, key):
    with Store(tmp_path / "r.sqlite") as db:
        db.add(key, results.records)
        db.add(key, results.records)  # what is there stays
        assert db.runs_of(key) == {0, 1, 2, 3}
        assert db.runs_of(dataclasses.replace(key, code="2")) == set()
    with Store(tmp_path / "r.sqlite", read_only=True) as db:
        assert db.keys() == [key]
        found = db.results(key)
        assert len(db.results(key, range(2)).records) == 2
    assert found.settings == {"epoch": 150}
    for field in dataclasses.fields(found.records):
        one, other = getattr(found.records, field.name), getattr(results.records, field.name)
        if field.name == "criteria":
            assert vars(one).keys() == vars(other).keys()
            np.testing.assert_array_equal(one.delta, other.delta)
        else:
            np.testing.assert_array_equal(one, other, err_msg=field.name)
    assert found.summary.rms == results.summary.rms
    assert not list(tmp_path.glob("*-wal"))  # closed properly, one file remains


def test_a_run_too_short_to_hold_is_read_again(tmp_path, monkeypatch, short, key):
    """Its largest error in the last hold_s is not known, inf, which no other angle may be."""
    task = dataclasses.replace(short, hold_s=1000.0)
    monkeypatch.setitem(catalogue.TASKS, task.name, task)
    found = evaluate(task, "evaluation.plugins:Told", 1, workers=1, cost=False).records
    assert np.isinf(found.hold_max).all()
    with Store(tmp_path / "r.sqlite") as db:
        db.add(key, found)
    with Store(tmp_path / "r.sqlite", read_only=True) as db:
        np.testing.assert_array_equal(db.results(key).records.hold_max, found.hold_max)


def test_rows_that_are_there_stay_as_they_are(tmp_path, results, key):
    records = results.records
    others = dataclasses.replace(records, final=2 * records.final, history=2 * records.history)
    with Store(tmp_path / "r.sqlite") as db:
        db.add(key, records.of_rows(records.criteria, [records.row(0)]))
        db.add(key, others)
        found = db.results(key).records
    for name in ("final", "history"):
        one, other = getattr(records, name), getattr(others, name)
        np.testing.assert_array_equal(getattr(found, name), np.concatenate([one[:1], other[1:]]))


def test_latest_code_only(tmp_path, results, key):
    with Store(tmp_path / "r.sqlite") as db:
        for code in ("1", "2"):
            db.add(dataclasses.replace(key, code=code), results.records)
        (found,) = db.keys()
        assert found.code == "2"
        assert db.keys(tasks=["other"]) == db.keys(solvers=["other"]) == []


def test_nothing_half_written(tmp_path, results, key):
    """A row that fails takes the whole chunk with it."""
    with Store(tmp_path / "r.sqlite") as db:
        db.connection.execute("CREATE TRIGGER full BEFORE INSERT ON runs WHEN new.run = 2 "
                       "BEGIN SELECT RAISE(ABORT, 'database or disk is full'); END")  # fmt: skip
        with pytest.raises(StoreError, match=r"r\.sqlite: the disk is full"):
            db.add(key, results.records)
        assert db.runs_of(key) == set()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"time,heading\n" * 1000, "not a results file"),
        (b"SQLite format 3\0" + bytes(2000), "(not a results file|damaged)"),
        (None, "no such directory, or no permission"),
    ],
)
def test_what_is_no_results_file(tmp_path, content, message):
    path = tmp_path / "r.sqlite" if content else tmp_path / "missing" / "r.sqlite"
    if content:
        path.write_bytes(content)
    with pytest.raises(StoreError, match=message):
        Store(path)
    if content:
        assert path.read_bytes() == content
        with pytest.raises(StoreError, match=message):
            Store(path, read_only=True)


def test_full_device():
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with pytest.raises(StoreError, match="/dev/full: "):
        Store("/dev/full")


def test_someone_elses_sqlite_and_other_schema(tmp_path):
    path = tmp_path / "r.sqlite"
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE prices (a)")
    db.close()
    with pytest.raises(StoreError, match="not a results file of sins-env"):
        Store(path)
    Store(tmp_path / "n.sqlite").close()
    db = sqlite3.connect(tmp_path / "n.sqlite")
    db.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    db.close()
    with pytest.raises(StoreError, match=f"schema {SCHEMA_VERSION + 1}; this version reads"):
        Store(tmp_path / "n.sqlite")


_AXES = [f"{name}_{axis}" for name in ("t_conv", "hold_max", "steady_mean", "steady_std", "steady_rms", "final")
         for axis in "enu"]  # fmt: skip
_NUMBERS = [*_AXES, "heading", "step_s", "nees_25", "nees_50", "nees_75", "nees_100"]
_OLD_COLUMNS = ["task", "suite", "solver", "settings_hash", "code", "run", "settings", "session", "status", "reason",
                "traceback", "repairs", *_NUMBERS]  # fmt: skip


@pytest.fixture(params=[1, 2])
def old_file(request, tmp_path, results, key):
    """As the first and second schema had it: histories in the table of runs, no definitions of tasks."""
    with Store(tmp_path / "new.sqlite") as db:
        db.add(key, dataclasses.replace(results.records, fallbacks=np.full(4, 9)))
    path = tmp_path / "old.sqlite"
    db = sqlite3.connect(path)
    fallbacks = ["fallbacks"] * (request.param > 1)
    words = ["task", "suite", "solver", "settings_hash", "code", "settings", "status", "reason", "traceback"]
    kinds = {name: "TEXT" for name in words} | {name: "REAL" for name in _NUMBERS}
    columns = [*_OLD_COLUMNS, *fallbacks]
    table = ", ".join(f"{name} {kinds.get(name, 'INTEGER')}" for name in columns)
    db.executescript(f"""
        CREATE TABLE sessions (
            id INTEGER PRIMARY KEY, started TEXT DEFAULT CURRENT_TIMESTAMP, versions TEXT, machine TEXT);
        CREATE TABLE runs ({table}, history BLOB, PRIMARY KEY (task, suite, solver, settings_hash, code, run));
        CREATE TABLE tasks (task TEXT PRIMARY KEY, criteria TEXT);
        CREATE TABLE costs (
            task TEXT, solver TEXT, settings_hash TEXT, code TEXT, session INTEGER, median_us REAL, p95_us REAL,
            ratio REAL, PRIMARY KEY (task, solver, settings_hash, code));
        ATTACH '{tmp_path / "new.sqlite"}' AS new;
        INSERT INTO runs ({", ".join([*columns, "history"])})
            SELECT {", ".join([*columns, "history"])} FROM new.runs JOIN new.histories USING (id) ORDER BY run DESC;
        INSERT INTO tasks SELECT task, criteria FROM new.tasks;
        INSERT INTO sessions SELECT * FROM new.sessions;
        PRAGMA application_id = {database.APPLICATION_ID};
        PRAGMA user_version = {request.param};
        """)
    db.close()
    return path, 9 * (request.param > 1)


def test_a_file_of_an_older_schema_is_read_and_left_as_it_is(old_file, results, key):
    path, fallbacks = old_file
    before = path.read_bytes()
    with Store(path, read_only=True) as db:
        found = db.results(key)
    np.testing.assert_array_equal(found.records.final, results.records.final)
    np.testing.assert_array_equal(found.records.history, results.records.history)
    np.testing.assert_array_equal(found.records.fallbacks, fallbacks)
    assert found.task == results.task  # of the present code, for want of another
    assert found.bound is not None
    assert path.read_bytes() == before


def test_a_file_of_an_older_schema_is_brought_up_to_date(old_file, results, key):
    path, fallbacks = old_file
    for _ in range(2):
        with Store(path) as db:
            db.add(dataclasses.replace(key, code="2"), dataclasses.replace(results.records, fallbacks=np.arange(4)))
            db.add_task(results.task)
    with Store(path, read_only=True) as db:
        assert db.connection.execute("PRAGMA user_version").fetchone() == (SCHEMA_VERSION,)
        found = db.results(key).records
        np.testing.assert_array_equal(found.fallbacks, fallbacks)
        np.testing.assert_array_equal(found.history, results.records.history)
        np.testing.assert_array_equal(db.results(dataclasses.replace(key, code="2")).records.fallbacks, range(4))
        assert db.digest_of(key.task) == fingerprint.digest(results.task)


@pytest.fixture
def third(tmp_path):
    """A file that the code of the third schema wrote, as text; and the table that it made of it."""
    path, data = tmp_path / "third.sqlite", Path(__file__).with_name("data")
    db = sqlite3.connect(path)
    db.executescript((data / "schema3.sql").read_text())
    db.close()
    return path, (data / "schema3.csv").read_text()


def as_csv(db, keys):
    return plain_tables.as_csv([db.results(key) for key in keys])


def figures(text, names=None):
    """The figures of a table by solver and settings, in these columns; what scoring 2 decides anew is left out."""
    rows = list(csv.DictReader(io.StringIO(text)))
    kept = [name for name in names or rows[0] if name not in ("rank", "below_bound")]
    return {(row["solver"], row["settings"]): {name: row[name] for name in kept} for row in rows}


def test_a_file_of_the_third_schema_gives_the_same_table(third):
    path, table = third
    before = path.read_bytes()
    with Store(path, read_only=True) as db:
        keys = db.keys()
        told = figures(table)
        assert figures(as_csv(db, keys), table.split("\n")[0].split(",")) == told  # there may be more columns now
    assert path.read_bytes() == before


def test_a_file_of_the_third_schema_goes_on(third, short):
    path, table = third
    with Store(path) as db:
        (key, told) = db.keys()
        db.add_task(short)
        more = evaluate(short, key.solver, [3], workers=1, settings={"epoch": 150}, cost=False).records
        db.add(key, more)
        assert db.runs_of(key) == {0, 1, 2, 3}
        (row,) = figures(as_csv(db, [told]), table.split("\n")[0].split(",")).items()
        assert row in figures(table).items()
        assert db.results(key).records.reason[3] == more.reason[0]
        assert db.connection.execute("PRAGMA user_version").fetchone() == (SCHEMA_VERSION,)


# ---- from the file alone ----


def test_a_table_needs_no_definition_and_no_bound_but_those_in_the_file(tmp_path, monkeypatch, results, key, short):
    """Neither the task is known any more, nor may anything be simulated."""
    bound = bounds.find(short)
    with Store(tmp_path / "r.sqlite") as db:
        db.add_task(short)
        db.add(key, results.records)
    monkeypatch.delitem(catalogue.TASKS, "short-v0")
    monkeypatch.setattr(EvaluationTask, "make", None)
    with Store(tmp_path / "r.sqlite", read_only=True) as db:
        found = db.results(key)
    assert found.task == short
    np.testing.assert_array_equal(found.bound.sigma, bound.sigma)
    assert found.bound.fits(found.records.criteria)
    assert found.bound_ratio["U"] > 0
    assert plain_tables.as_json([found])
    with Store(tmp_path / "old.sqlite") as db:
        db.add(key, results.records)
        with pytest.raises(StoreError, match="definition of short-v0 cannot be read"):
            db.results(key)


def test_for_tables_only_what_they_show_is_read(tmp_path, results, key):
    with Store(tmp_path / "r.sqlite") as db:
        db.add(key, results.records)
        db.connection.execute("UPDATE histories SET history = x'00'")
        found = db.results(key, whole=False)
    assert found.records.history.shape == (4, 0, 3)
    assert np.isnan(found.records.hold_max).all()
    whole = results.summary
    for name in ("success", "t_conv_ci_s", "rms", "rms_ci", "counts", "fallbacks"):
        assert getattr(found.summary, name) == getattr(whole, name), name
    assert found.summary.rms_final["U"] == whole.rms_final["U"]
    assert found.summary.nees == whole.nees
    assert found.records.reason == results.records.reason
    assert found.records.traceback == results.records.traceback
    form = {"as_csv", "as_json", "as_markdown"}
    found, given = (dataclasses.replace(one, stored_bound=None) for one in (found, results))
    assert all(getattr(plain_tables, name)([found]) == getattr(plain_tables, name)([given]) for name in form)


def test_a_changed_task_is_refused(tmp_path, monkeypatch, results, key, short):
    with Store(tmp_path / "r.sqlite") as db:
        db.add_task(short)
        db.add_task(dataclasses.replace(short, what="in other words", source="elsewhere"))
        for change in ({"hold_s": 6.0}, {"delta_azimuth_deg": 0.8}, {"kwargs": {**short.kwargs, "latitude_deg": 41.0}}):
            with pytest.raises(ValueError, match=r"short-v0 has changed .*, its definition; .* needs a new version"):
                db.add_task(dataclasses.replace(short, **change))
        monkeypatch.setattr(store, "digest", lambda task: "0123456789abcdef")  # the code of the world was edited
        with pytest.raises(ValueError, match=r"its world \(digest \w{16}, now 0123456789abcdef\)"):
            db.add_task(short)


def test_runs_scored_by_other_criteria_are_refused(tmp_path, results, key, short):
    with Store(tmp_path / "r.sqlite") as db:
        db.add_task(short)
        db.add(key, results.records)
        wide = dataclasses.replace(results.records.criteria, delta=2 * results.records.criteria.delta)
        with pytest.raises(
            ValueError, match=r"short-v0 were scored by other criteria, delta = \[.*\] stored, \[.*\] now"
        ):
            db.add(key, dataclasses.replace(results.records, criteria=wide))


def test_missing_and_empty(tmp_path):
    with pytest.raises(StoreError, match="no such results file"):
        Store(tmp_path / "r.sqlite", read_only=True)
    assert not (tmp_path / "r.sqlite").exists()
    (tmp_path / "r.sqlite").touch()
    with pytest.raises(StoreError, match="no results"):
        Store(tmp_path / "r.sqlite", read_only=True)


def test_locked(tmp_path, monkeypatch, results, key):
    path = tmp_path / "r.sqlite"
    Store(path).close()
    monkeypatch.setattr(database, "BUSY_S", 0.05)
    other = sqlite3.connect(path, isolation_level=None)
    with Store(path) as db:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreError, match="locked by another program"):
            db.add(key, results.records)
        other.execute("ROLLBACK")
        db.add(key, results.records)
    other.close()


def test_read_only_directory(tmp_path, results, key):
    folder = tmp_path / "sealed"
    folder.mkdir()
    with Store(folder / "r.sqlite") as db:
        db.add(key, results.records)
    folder.chmod(0o555)
    (folder / "r.sqlite").chmod(0o444)
    try:
        with Store(folder / "r.sqlite", read_only=True) as db:
            assert len(db.results(key).records) == 4
        if os.geteuid() == 0:
            pytest.skip("root may write anywhere")
        with pytest.raises(StoreError, match=r"cannot be (written|opened)"):
            Store(folder / "r.sqlite")
        with pytest.raises(StoreError, match="cannot be opened"):
            Store(folder / "n.sqlite")
    finally:
        folder.chmod(0o755)


def test_a_file_that_may_only_be_read_stays_alone(tmp_path, monkeypatch, results, key):
    """Nothing is made beside it, by those who read it or by those who may not write it."""
    path = tmp_path / "r.sqlite"
    with Store(path) as db:
        db.add(key, results.records)
    access = os.access
    monkeypatch.setattr(os, "access", lambda file, mode, **more: mode != os.W_OK and access(file, mode, **more))
    path.chmod(0o444)
    with Store(path, read_only=True) as db:
        assert len(db.results(key).records) == 4
        assert os.listdir(tmp_path) == ["r.sqlite"]
    with pytest.raises(StoreError, match=r"r\.sqlite: cannot be written"):
        Store(path)
    assert os.listdir(tmp_path) == ["r.sqlite"]


@pytest.mark.parametrize("how", ["removed", "replaced"])
def test_a_file_that_another_program_takes_away(tmp_path, results, key, how):
    path, other = tmp_path / "r.sqlite", tmp_path / "other.sqlite"
    Store(other).close()
    with Store(path) as db:
        if how == "removed":
            path.unlink()
        else:
            other.replace(path)
        with pytest.raises(StoreError, match=r"r\.sqlite: removed or replaced by another program; --resume"):
            db.add(key, results.records)
    with Store(path) as db:
        db.add(key, results.records)
        assert db.runs_of(key) == {0, 1, 2, 3}


def test_a_full_disk_takes_nothing_back(tmp_path, results, key):
    with Store(tmp_path / "r.sqlite") as db:
        ((pages,),) = db.connection.execute("PRAGMA page_count").fetchall()
        db.connection.execute(f"PRAGMA max_page_count = {pages}")
        others = [dataclasses.replace(key, solver=f"other{i}") for i in range(20)]
        asked = []

        def add_all():
            for one in others:
                asked.append(one)
                db.add(one, results.records)

        with pytest.raises(StoreError, match="the disk is full; free some space, and --resume continues"):
            add_all()
        assert db.runs_of(asked[-1]) == set()
        db.connection.execute("PRAGMA max_page_count = 1000")
        db.add(key, results.records)
        assert db.runs_of(key) == {0, 1, 2, 3}


def test_rows_may_be_left_unread_when_the_file_is_closed(tmp_path, results, key):
    with Store(tmp_path / "r.sqlite") as db:
        db.add(key, results.records)
        rows = db.rows(key, ["run"])
        assert next(rows) == (0,)
    rows.close()


def test_damaged_row(tmp_path, results, key):
    with Store(tmp_path / "r.sqlite") as db:
        db.add(key, results.records)
        db.connection.execute("UPDATE histories SET history = x'00' WHERE id = 1")
        with pytest.raises(StoreError, match="cannot be read"):
            db.results(key)


def test_settings_must_be_json():
    assert canonical({"b": 1, "a": [2, "x"]}) == '{"a": [2, "x"], "b": 1}'
    with pytest.raises(ValueError, match="allowed in a results file"):
        canonical({"a": {1}})


_WRITER = """
import sys
import numpy as np
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.records import score
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
criteria = Criteria(0.1, 50, 0, np.ones(3), np.ones(3), 1.0)
key = Key.of("sway-white-v0", "s", sys.argv[2], {}, "1")
for run in range(40):
    records = score(np.full((1, 50, 3), 0.5), None, criteria)
    records.run[0] = run
    with Store(sys.argv[1]) as db:
        db.add(key, records)
"""


def test_many_writers_at_once(tmp_path):
    """Opening, creating and writing at the same time loses nothing."""
    path = tmp_path / "r.sqlite"
    command = [sys.executable, "-c", _WRITER, str(path)]
    writers = [subprocess.Popen([*command, name], stderr=subprocess.PIPE) for name in ("a", "b", "a")]
    assert [writer.communicate()[1] for writer in writers] == [b"", b"", b""]
    with Store(path, read_only=True) as db:
        assert sorted((key.solver, len(db.runs_of(key))) for key in list(db.keys())) == [("a", 40), ("b", 40)]
