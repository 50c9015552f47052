"""What is kept of a run is told once, by the fields of its record: file, export and comparison follow."""

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
from places import ROOT, TESTS

from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.records import FIELDS, Records
from sins_env.evaluation.show import plain_tables
from sins_env.evaluation.store import export
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.schema import SCHEMA_VERSION
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.store.verify import compare_runs

DATA = Path(__file__).with_name("data")
RUNS = 3
ALIGN = Criteria(0.1, 1000, 0, np.full(3, 1e-2), np.ones(3), 60.0)
NAVIGATE = dataclasses.replace(ALIGN, limit=np.ones(9), navigates=True)
KEY = Key.of("sway-white-v0", "s", "one", {}, "1")


def made(criteria):
    """Records with other values in every field, every part and every run."""
    rng = np.random.default_rng(0)
    out = {"run": np.arange(RUNS), "status": np.array(["ok", "raised", "diverged"])}
    out["history"] = rng.normal(size=(RUNS, len(criteria.history_t), criteria.components)).astype(np.float32)
    for name, one in FIELDS.items():
        if one.kind == "count":
            out.setdefault(name, rng.integers(1, 100, RUNS))
        elif one.kind == "text":
            out[name] = tuple(f"{name} {i}" for i in range(RUNS))
        elif one.kind == "number":
            there = not one.navigates or criteria.navigates
            out[name] = rng.normal(size=(RUNS, one.width) if one.parts else RUNS) if there else one.absent(RUNS)
    return Records(criteria, **out)


@pytest.fixture(params=[ALIGN, NAVIGATE], ids=["alignment", "navigation"])
def records(request):
    return made(request.param)


def test_every_field_says_what_it_is():
    assert list(FIELDS) == [one.name for one in dataclasses.fields(Records)][1:]
    for one in FIELDS.values():
        assert len(one.units) == len(one.columns) == one.width
        assert len(one.components) in (0, one.width)
    columns = [name for one in FIELDS.values() for name in one.columns]
    assert len(columns) == len(set(columns))


def test_every_field_comes_back(records, tmp_path):
    with Store(tmp_path / "r.sqlite") as db:
        db.add(KEY, records)
        found = db.results(KEY).records
    for name in FIELDS:
        one, other = getattr(found, name), getattr(records, name)
        np.testing.assert_array_equal(one, other, err_msg=name)
        assert type(one) is type(other)
        assert getattr(one, "dtype", None) == getattr(other, "dtype", None) or FIELDS[name].kind == "word"


def test_every_part_is_exported_under_its_name_and_unit(records, tmp_path):
    navigates = records.criteria.navigates
    with Store(tmp_path / "r.sqlite") as db:
        db.add(KEY, records)
        export.export(db, [KEY], "csv", tmp_path / "r.csv")
    rows = list(csv.DictReader((tmp_path / "r.csv").read_text().splitlines()))
    there = [one for one in FIELDS.values() if one.kind != "curve" and (navigates or not one.navigates)]
    for one in there:
        for row, value in zip(rows, getattr(records, one.name), strict=True):
            assert [row[heading] for heading in one.headings] == [str(part) for part in np.atleast_1d(value).tolist()]
    assert {heading for one in there for heading in one.headings} <= set(rows[0])
    assert ("rms_vel_e_mps" in rows[0]) is navigates


def changed(records, one, part):
    """The same, but for a part of a field of the last run."""
    values = list(getattr(records, one.name))
    if one.kind in ("word", "text"):
        values[-1] = "frozen"
    elif one.parts:
        values[-1] = values[-1] + np.where(np.arange(one.width) == part, 1.0, 0.0)
    else:
        values[-1] = values[-1] + 1
    return dataclasses.replace(records, **{one.name: one.of_runs(values)})


@pytest.mark.parametrize("one", [one for one in FIELDS.values() if one.name != "run"], ids=lambda one: one.name)
def test_a_changed_part_is_a_difference(one):
    records = made(dataclasses.replace(NAVIGATE, limit=np.full(9, 1e-3)))
    assert compare_runs(records, records) == []
    for part, name in enumerate(one.columns if one.kind == "number" else [one.name]):
        found = compare_runs(records, changed(records, one, part))
        if not one.compared:
            assert found == []
        elif one.kind == "number" and not one.name.startswith("nees"):
            (text,) = found
            assert text.startswith(f"run 2: {name}")
        elif not one.name.startswith("nees"):
            assert found == [f"run 2: {one.name} {getattr(records, one.name)[-1]} stored, "
                             f"{getattr(changed(records, one, part), one.name)[-1]} now (reason 2)"]  # fmt: skip


def test_times_and_traces_of_errors_alone_are_not_compared():
    assert {name for name, one in FIELDS.items() if not one.compared} == {"reason", "traceback", "step_s", "history"}


# ---- files that are there already ----


@pytest.fixture
def fourth(tmp_path):
    """A file that version 0.1.0 wrote, as text: an alignment and a flight."""
    path = tmp_path / "fourth.sqlite"
    db = sqlite3.connect(path)
    db.executescript((DATA / "schema4.sql").read_text())
    db.close()
    return path


def columns_in(path):
    db = sqlite3.connect(path)
    out = {table: db.execute(f"PRAGMA table_info({table})").fetchall() for table in ("runs", "spans", "histories")}
    (index,) = db.execute("SELECT sql FROM sqlite_master WHERE name = 'troubles'").fetchone()
    db.close()
    return out, index


def test_the_fourth_schema_is_what_version_0_1_0_wrote(fourth, tmp_path):
    """Later fields say so by ``since``; without it they would be sought in files that do not have them."""
    Store(tmp_path / "new.sqlite").close()
    (there, index), (now, new_index) = columns_in(fourth), columns_in(tmp_path / "new.sqlite")
    later = {name for one in FIELDS.values() if one.since > 4 for name in one.columns}
    for table, columns in there.items():
        assert [column[1:] for column in now[table] if column[1] not in later] == [column[1:] for column in columns]
    assert SCHEMA_VERSION > 4 or index == new_index


def test_an_older_file_gets_the_columns_and_the_index_of_a_new_one(tmp_path):
    path = tmp_path / "third.sqlite"
    third = sqlite3.connect(path)
    third.executescript((DATA / "schema3.sql").read_text())
    third.close()
    for name in (path, tmp_path / "new.sqlite"):
        Store(name).close()
    (there, index), (now, new_index) = columns_in(path), columns_in(tmp_path / "new.sqlite")
    assert index == new_index
    for table, columns in now.items():  # later columns stand at the end of an older file
        assert sorted(column[1:] for column in there[table]) == sorted(column[1:] for column in columns)


def test_a_file_of_version_0_1_0_gives_the_same_table_and_export(fourth, tmp_path):
    with Store(fourth, read_only=True) as db:
        keys = db.keys()
        assert len(keys) == 2
        table = plain_tables.as_csv([db.results(key) for key in keys])
        export.export(db, keys, "csv", tmp_path / "runs.csv")
    for now, name in ((table, "schema4.csv"), ((tmp_path / "runs.csv").read_text(), "schema4_runs.csv")):
        rows, before = (list(csv.DictReader(io.StringIO(text))) for text in (now, (DATA / name).read_text()))
        names = [name for name in before[0] if name not in ("rank", "below_bound")]  # which scoring 2 decides anew

        def told(lines, names=names):
            found = [{name: row[name] for name in names} for row in lines]  # there may be more columns now
            return sorted(found, key=lambda row: (row["solver"], row["settings"], float(row.get("run", 0))))

        assert told(rows) == told(before)


def test_tables_need_no_field_that_is_not_read_for_them(fourth):
    """Every column gives the same from what is read for tables as from all; if not, its field must say ``in_tables``."""
    with Store(fourth, read_only=True) as db:
        for key in list(db.keys()):
            tables, whole = db.results(key, whole=False), db.results(key)
            assert np.isnan(tables.records.hold_max).all()
            assert plain_tables.as_csv([tables]) == plain_tables.as_csv([whole])
            assert plain_tables.as_json([tables]) == plain_tables.as_json([whole])
            assert plain_tables.as_markdown([tables]) == plain_tables.as_markdown([whole])


_MORE = """
import dataclasses, sys
import numpy as np
from sins_env.evaluation.play import fields, records

@dataclasses.dataclass(frozen=True)
class More(records.Records):
    peak: object = dataclasses.field(metadata=fields.error_of(since=5))
    sleeps: object = dataclasses.field(metadata=fields.kept(kind="count", usual=0, since=5))
    drift: object = dataclasses.field(metadata=fields.kept(units=("m/s",), navigates=True, since=5))

records.Records = More
for one in dataclasses.fields(More)[-3:]:
    records.FIELDS[one.name] = dataclasses.replace(one.metadata["is"], name=one.name)

from sins_env.evaluation.store import export
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.store.verify import compare_runs

old, new = sys.argv[1:]
with Store(old, read_only=True) as db:
    assert all(np.isnan(db.results(key).records.peak).all() for key in db.keys())
for path in (old, new, new):
    with Store(path) as db:
        if path == old:
            keys = db.keys()
            found = [db.results(key).records for key in keys]
        for key, one in zip(keys, found):
            assert path != old or (np.isnan(one.peak).all() and (one.sleeps == 0).all() and np.isnan(one.drift).all())
            n, navigates = len(one), one.criteria.navigates
            drift = np.arange(n) + 0.5 if navigates else np.full(n, np.nan)
            one = dataclasses.replace(one, peak=np.arange(3.0 * n).reshape(n, 3), sleeps=np.arange(n), drift=drift)
            known = "flight-lu-gauss-v0" if navigates else "sway-white-v0"  # the new file has no definition of a task
            key = dataclasses.replace(key, code="2", task=key.task if path == old else known)
            db.add(key, one)
            again = db.results(key).records
            np.testing.assert_array_equal(again.peak, one.peak)
            np.testing.assert_array_equal(again.sleeps, one.sleeps)
            np.testing.assert_array_equal(again.drift, one.drift)
            np.testing.assert_array_equal(again.span_final, one.span_final)
            assert compare_runs(one, again) == []
            (text,) = compare_runs(one, dataclasses.replace(one, peak=one.peak + [[0, 1, 0]] * (one.run[:, None] == 1)))
            assert text.startswith("run 1: peak_n_rad 4 stored, 5 now"), text
names = export.headings(True)
assert [name for name in names if name.startswith(("peak", "sleeps", "drift"))] == [
    "sleeps", "peak_e_rad", "peak_n_rad", "peak_u_rad", "drift_mps"]
"""


def test_a_new_field_is_a_declaration(fourth, tmp_path):
    """Three new fields, as somebody would declare them: new files have them, older files get them, rows stay."""
    third = sqlite3.connect(tmp_path / "third.sqlite")
    third.executescript((DATA / "schema3.sql").read_text())
    third.close()
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (ROOT, TESTS)))}
    for old in (fourth, tmp_path / "third.sqlite"):
        command = [sys.executable, "-c", _MORE, str(old), str(old.with_suffix(".new"))]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
