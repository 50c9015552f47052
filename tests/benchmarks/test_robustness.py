"""benchmarks/robustness.py: a few trials of the campaign, which must also find what is wrong."""

import os
import runpy
import shutil
import sqlite3
import sys
from contextlib import closing

import pytest
from places import ROOT

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="it looks for processes in /proc")
ROBUSTNESS = runpy.run_path(str(ROOT / "benchmarks" / "robustness.py"))


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    return ROBUSTNESS["Trials"](tmp_path_factory.mktemp("robustness"), runs=4, solvers=("ckf",), workers=1, copies=100)


@pytest.mark.parametrize("kind", ["parent", "export"])
def test_a_kill_loses_nothing(trials, kind):
    assert ROBUSTNESS["campaign"](trials, kind, 1, seed=0) == []


def test_what_is_lost_or_left_is_found(trials, monkeypatch):
    def loses(trials, rng):
        shutil.copy(trials.keep / "whole.sqlite", trials.folder / "r.sqlite")
        with closing(sqlite3.connect(trials.folder / "r.sqlite")) as db, db:
            db.execute("DELETE FROM histories WHERE id = 3")
            db.execute("DELETE FROM runs WHERE id = 3")
        trials.check_evaluated("r.sqlite")

    def leaves(trials, rng):
        (trials.folder / "r.sqlite-journal").touch()
        trials.check_left("r.sqlite")

    kinds = ROBUSTNESS["KINDS"]
    monkeypatch.setitem(kinds, "parent", (loses, 1))
    monkeypatch.setitem(kinds, "export", (leaves, 1))
    assert ROBUSTNESS["campaign"](trials, "parent", 1, seed=0) == ["parent 0: another table"]
    assert ROBUSTNESS["campaign"](trials, "export", 1, seed=0) == ["export 0: files left: ['r.sqlite-journal']"]
    assert sorted(os.listdir(trials.folder)) == ["kept", "mine.py", "tmp"]
