"""A results file that version 0.1.0 wrote: it opens, gives the same table, and keeps its rows beside new ones."""

import csv
import io
import sqlite3
from pathlib import Path

import pytest

from sins_env.evaluation.estimators.version import code_version
from sins_env.evaluation.show import plain_tables
from sins_env.evaluation.store.store import Store

CODE = "0.1.0+26d22ab5"


@pytest.fixture
def old(tmp_path):
    """The path of the file, made from its text; and the rows that 0.1.0 printed of it."""
    path, data = tmp_path / "old.sqlite", Path(__file__).with_name("data")
    db = sqlite3.connect(path)
    db.executescript((data / "version010.sql").read_text())
    db.close()
    return path, list(csv.DictReader(io.StringIO((data / "version010.csv").read_text())))


def keys(path):
    with Store(path, read_only=True) as db:
        return db.keys()


def table(path):
    with Store(path, read_only=True) as db:
        text = plain_tables.as_csv([db.results(key) for key in keys(path)])
    return list(csv.DictReader(io.StringIO(text)))


def test_its_table_is_the_same(old):
    """But for what needs more runs since: a rank, and whether the error is below the bound."""
    path, printed = old
    for now, then in zip(table(path), printed, strict=True):
        assert {name: now[name] for name in then} == then | {"rank": "", "below_bound": ""}


def test_its_rows_are_kept_as_stale_ones(old, cli, short):
    path, _ = old
    before = keys(path)
    assert {key.code for key in before} == {CODE}
    code, _, err = cli("verify", "--db", path, "--rows", 1)
    assert (code, err[-1]) == (1, f"sins-env: {path}: no run could be verified")
    assert f"made with code {CODE}, this is {code_version('ckf')}" in err[0]
    assert cli("eval", "--task", "short-v0", "--solver", "ckf", "--runs", 2, "--workers", 1, "--db", path)[0] == 0
    with Store(path, read_only=True) as db:
        assert [db.runs_of(key) for key in before] == [{0, 1, 2}, {0, 1}]
    assert {(key.solver, key.code) for key in keys(path)} == {("kf", CODE), ("ckf", code_version("ckf"))}
