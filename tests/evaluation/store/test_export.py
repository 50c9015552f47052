"""Every run in three formats, read back by other programs than the one that wrote them."""

import csv
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from sins_env.cli.main import main
from sins_env.evaluation import evaluate
from sins_env.evaluation.play.criteria import AXES
from sins_env.evaluation.store import export
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store

VECTORS = {"t_conv": "_s", "hold_max": "_rad", "steady_mean": "_rad", "steady_std": "_rad", "steady_rms": "_rad",
           "final": "_rad"}  # fmt: skip


@pytest.fixture
def file(tmp_path, monkeypatch, short):
    """Two solvers, one of which raises; records by solver."""
    monkeypatch.chdir(tmp_path)
    out = {}
    with Store("results.sqlite") as db:
        for solver, settings in (("evaluation.plugins:At", {"epoch": 150}), ("evaluation.plugins:Noisy", {})):
            found = evaluate(short, solver, 3, workers=1, settings=settings, cost=False)
            db.add(Key.of(short.name, found.suite, solver, settings, "1"), found.records)
            out[solver] = found.records
    return out


def check(rows, file, inf):
    """``rows``: dicts of values of their own type."""
    assert len(rows) == 6
    assert list(rows[0]) == export.headings(False)
    for row in rows:
        records = file[row["solver"]]
        i = row["run"]
        for name, unit in VECTORS.items():
            for j, axis in enumerate(AXES):
                expected, found = getattr(records, name)[i, j], row[f"{name}_{axis.lower()}{unit}"]
                assert found == (inf if math.isinf(expected) else expected), name
        assert row["reason"] == records.reason[i]
        assert row["traceback"] == records.traceback[i]
        assert row["status"] == records.status[i]
        for j, name in enumerate(("nees_25", "nees_50", "nees_75", "nees_100")):
            value = records.nees[i, j]
            assert row[name] == (None if np.isnan(value) else inf if np.isinf(value) else value)
        assert row["heading_rad"] == (None if np.isnan(records.heading[i]) else records.heading[i])
    assert {row["status"] for row in rows} == {"ok", "raised"}


def test_csv(file, capsys):
    assert main(["export", "--csv", "r.csv"]) == 0
    assert capsys.readouterr().err == "csv: r.csv, 6 runs\n"
    with open("r.csv", newline="") as f:
        rows = list(csv.DictReader(f))
    words = {"task", "suite", "solver", "code", "settings", "status", "reason", "traceback"}
    for row in rows:
        for name, text in row.items():
            if name in ("run", "repairs", "fallbacks"):
                row[name] = int(text)
            elif name not in words:
                row[name] = float(text) if text else None
    check(rows, file, math.inf)


def test_json(file):
    assert main(["export", "--json", "r.json"]) == 0
    rows = json.loads(Path("r.json").read_text(), parse_constant=pytest.fail)
    check(rows, file, None)
    assert [row["settings"] for row in rows[::3]] == [{"epoch": 150}, {}]
    assert main(["export", "--json", "one.json", "--solver", "evaluation.plugins:Noisy"]) == 0
    assert [row["run"] for row in json.loads(Path("one.json").read_text())] == [0, 1, 2]


def test_parquet(file):
    parquet = pytest.importorskip("pyarrow.parquet")
    assert main(["export", "--parquet", "r.parquet"]) == 0
    table = parquet.read_table("r.parquet")
    check(table.to_pylist(), file, math.inf)
    kinds = {str(kind) for kind in table.schema.types}
    assert kinds == {"string", "int64", "double"}


def test_an_empty_file_and_wrong_use(file, monkeypatch, capsys):
    Store("empty.sqlite").close()
    for form in ("csv", "json"):
        assert main(["export", f"--{form}", f"e.{form}", "--db", "empty.sqlite"]) == 0
    assert json.loads(Path("e.json").read_text()) == []
    assert Path("e.csv").read_text() == ",".join(export.headings(False)) + "\n"
    capsys.readouterr()
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    for arguments, part in (
        (["--parquet", "r.parquet"], "pip install 'sins-env[data]'"),
        (["--csv", "no/r.csv"], "the directory does not exist"),
        (["--csv", "r.csv", "--solver", "evaluation.plugins:Noise"], "did you mean 'evaluation.plugins:Noisy'?"),
        ([], "one of the arguments --csv --json --parquet is required"),
    ):
        assert main(["export", *arguments]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert part in line
    with Store("results.sqlite") as db, pytest.raises(ValueError, match="allowed: csv, json, parquet"):
        export.export(db, [], "xlsx", "r.xlsx")
