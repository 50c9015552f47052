"""An entry from both sides: what submit refuses, what a bundle holds, what judge believes of it, and both suites in one table."""

import dataclasses
import importlib
import json
import math
import shutil
import sqlite3
import sys
import zipfile

import numpy as np
import pytest
from evaluation.short import SHORT

from sins_env.cli.main import main
from sins_env.evaluation import evaluate
from sins_env.evaluation.contest import bundle, judging
from sins_env.evaluation.estimators import version
from sins_env.evaluation.score.losses import scores
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks import catalogue

SOLVER = "mine:Still"
SOURCE = '''
import numpy as np


class Still:
    """The told attitude for ever."""

    batched = True

    def __init__(self, turn=0.0):
        pass

    def reset(self, task, rng, num_runs=1):
        self.q = task.start.q_nb.copy()

    def step(self, obs):
        return self.q.copy()
'''
SECRET = 271828182845904523536028747135266249775724709
RUNS = 24
TASK = dataclasses.replace(SHORT, delta_azimuth_deg=30.0)  #: with errors below and beyond the threshold


def fill(path, task, solver, runs=RUNS, seed=None, **settings):
    """Add runs, played in this process, under the name of the solver."""
    made = evaluate(task, solver, runs, seed, workers=1, settings=settings, cost=False)
    with Store(path) as store:
        store.add_task(task)
        store.add(Key.of(task.name, made.suite, made.solver, settings, version.code_version(made.solver)), made.records)


@pytest.fixture(scope="module")
def entry(tmp_path_factory):
    """A folder with a solver, its rows on the public and on a hidden suite, and the bundle of them."""
    folder = tmp_path_factory.mktemp("entry")
    (folder / "mine.py").write_text(SOURCE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.syspath_prepend(str(folder))
        patch.setenv("COLUMNS", "160")
        patch.setitem(catalogue.TASKS, TASK.name, TASK)
        mine = importlib.import_module("mine").Still
        for solver in (mine, "ckf"):
            fill("rows.sqlite", TASK, solver)
        fill("rows.sqlite", TASK, mine, 2, SECRET)
        fill("hidden.sqlite", TASK, mine, RUNS, SECRET)
        assert main(["submit", "rows.sqlite", SOLVER, "--rows", "2", "--out", "entry.zip", "--workers", "1"]) == 0
        yield folder
    sys.modules.pop("mine", None)


@pytest.fixture
def here(entry, tmp_path, monkeypatch):
    """A fresh folder with copies of these files."""
    for file in entry.glob("*.*"):
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(catalogue.TASKS, TASK.name, TASK)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("COLUMNS", "160")
    return tmp_path


def test_the_bundle_has_the_rows_the_sources_and_what_is_claimed(here, cli):
    with zipfile.ZipFile("entry.zip") as archive:
        assert sorted(archive.namelist()) == ["board.md", "results.sqlite", "solver/mine.py", "submission.json"]
        said = json.loads(archive.read("submission.json"))
        assert archive.read("solver/mine.py").decode() == SOURCE
    assert (said["solver"], said["runs"], said["checked"]) == (SOLVER, {"short-v0": RUNS}, 2)
    assert {one["solver"] for one in said["board"]} == {SOLVER, "ckf"}
    code, out, err = cli("judge", "entry.zip", "--out", "theirs")
    assert (code, err) == (0, [])
    assert f"solver {SOLVER}" in out
    assert bundle.sources_hash(said["files"]) in out
    assert sorted(one.name for one in (here / "theirs").iterdir()) == [
        "board.md", "mine.py", "results.sqlite", "submission.json",
    ]  # fmt: skip
    with Store("theirs/results.sqlite", read_only=True) as store:
        assert [(key.solver, len(store.runs_of(key))) for key in list(store.keys())] == [(SOLVER, RUNS), ("ckf", RUNS)]
    assert cli("judge", "entry.zip", "--out", "theirs")[0] == 2


def test_both_suites_stand_beside_each_other(here, cli):
    code, out, err = cli("judge", "entry.zip", "--db", "hidden.sqlite")
    assert (code, err) == (0, [])
    lines = [line.split() for line in out.splitlines()]
    (public,) = [line for line in lines if "public" in line and "short-v0" in line]
    (hidden,) = [line for line in lines if line[:2] == ["hidden", str(RUNS)]]
    assert public[2] == str(RUNS)
    assert hidden[-2:] == ["they", "agree"]
    with judging.opened(here / "entry.zip") as (said, folder), Store("hidden.sqlite", read_only=True) as store:
        (pair,) = judging.beside(said, folder, store)
        with Store(folder / "results.sqlite", read_only=True) as rows:
            (key,) = rows.keys(solvers=[SOLVER])
            final = rows.results(key).records.steady_rms[:, 2]
    threshold = math.radians(TASK.delta_azimuth_deg)
    assert pair.public.score.value == pytest.approx(math.sqrt(np.mean(np.minimum(final, threshold) ** 2)))
    assert (pair.public.runs, pair.hidden.runs) == (RUNS, RUNS)
    ratio, (low, high) = pair.ratio
    assert low < ratio == pair.hidden.score.value / pair.public.score.value < high
    assert cli("judge", "entry.zip", "--db", "rows.sqlite")[0] == 0  # it has two runs of another suite, too
    code, _, (said,) = cli("judge", "entry.zip", "--db", "results.sqlite")
    assert (code, "no such results file" in said) == (2, True)


def test_the_ratio_of_two_suites_covers_the_truth_in_95_percent():
    """Exponential losses: the standard error of 200 trials is 1.5 %, and the interval of one suite alone would miss 17 %."""
    rng = np.random.default_rng(3)
    missed = 0
    for _ in range(5):
        one, other = (scores(rng.exponential(size=(60, 40))) for _ in range(2))
        for a, b in zip(one, other, strict=True):
            _, (low, high) = judging.ratio_apart(a, b)
            missed += not low <= 1.0 <= high
    assert 0.01 < missed / 200 < 0.095


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ("DELETE FROM runs WHERE run = 3", "run 3 of mine:Still on short-v0 is missing; allowed: all runs from 0 on"),
        ("UPDATE runs SET code = 'old'", "runs cannot be made again: made with code old, this is "),
        ("DELETE FROM runs WHERE suite = (SELECT suite FROM runs WHERE solver = 'ckf')", "no rows of mine:Still on a public"),
    ],
)  # fmt: skip
def test_rows_that_nobody_could_check_are_refused(here, cli, change, text):
    with Store("rows.sqlite") as store:
        store.connection.execute(change)
    code, _, err = cli("submit", "rows.sqlite", SOLVER, "--rows", "1", "--out", "x.zip", "--workers", "1")
    assert code == 2
    assert text in err[-1]
    assert not (here / "x.zip").exists()


def test_other_names_and_settings(here, cli):
    fill("rows.sqlite", TASK, importlib.import_module("mine").Still, 2, turn=1)
    code, _, (said,) = cli("submit", "rows.sqlite", SOLVER)
    assert code == 2
    assert said.startswith(
        f'sins-env: rows.sqlite has the settings {{"turn": 1}}, {{}} of {SOLVER}; allowed: one of those'
    )
    for words, text in (
        (["mine:Stil"], "did you mean 'mine:Still'?"),
        ([SOLVER, "--task", "sway-white-v0"], "unknown task of mine:Still in rows.sqlite 'sway-white-v0'"),
        ([SOLVER, "--set", "turn=2"], 'no rows with the settings {"turn": 2}'),
        ([SOLVER, "--out", "no/where.zip"], "--out no/where.zip: the directory does not exist"),
    ):
        code, _, err = cli("submit", "rows.sqlite", *words)
        assert code == 2
        assert text in err[-1]


def test_a_row_that_differs_is_named_and_nothing_is_written(here, cli):
    with Store("rows.sqlite") as store:
        store.connection.execute("UPDATE runs SET final_u = 0.25 WHERE solver = 'ckf'")
    code, _, err = cli("submit", "rows.sqlite", "ckf", "--rows", "1", "--out", "x.zip", "--workers", "1")
    assert code == 1
    assert "final_u_rad 0.25 stored, " in err[0]
    assert err[-1] == "sins-env: rows.sqlite: 1 differences, and x.zip is not written"
    assert not (here / "x.zip").exists()


def rewritten(source, target, change=lambda members: None, said=None):
    """A bundle with other members; ``said`` are other claims. Hashes are made to fit unless a claim says otherwise."""
    with zipfile.ZipFile(source) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    change(members)
    claim = json.loads(members.pop("submission.json"))
    claim["files"] = {name: bundle.sha256(data) for name, data in members.items()}
    claim.update(said or {})
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("submission.json", json.dumps(claim))
        for name, data in members.items():
            archive.writestr(name, data)


def sql(statement):
    """A change of the rows in a bundle."""

    def change(members):
        data = bytearray(members["results.sqlite"])
        data[18:20] = b"\1\1"  # a file in memory has no write-ahead log
        with sqlite3.connect(":memory:") as db:
            db.deserialize(bytes(data))
            db.execute(statement)
            db.commit()
            members["results.sqlite"] = db.serialize()

    return change


FORGED = {
    "a path": (lambda members: members.update({"../evil.py": b""}), {}, "a file '../evil.py'; allowed in a bundle: "),
    "an absolute path": (lambda members: members.update({"/tmp/evil.py": b""}), {}, "a file '/tmp/evil.py'"),
    "a program": (lambda members: members.update({"solver/run.sh": b""}), {}, "a file 'solver/run.sh'"),
    "no rows": (lambda members: members.pop("results.sqlite"), {}, "it has no results.sqlite"),
    "many files": (lambda members: members.update({f"solver/a{i}.py": b"" for i in range(400)}), {}, "403 files; allowed"),
    "a bomb": (lambda members: members.update({"solver/a.py": bytes(1 << 30)}), {}, "it inflates to "),
    "another hash": (lambda members: None, {"files": {}}, "and the members differ in board.md"),
    "changed files": (
        lambda members: None, {"files": dict.fromkeys(("board.md", "results.sqlite", "solver/mine.py"), "0" * 64)},
        "has the SHA-256 ",
    ),
    "a run left out": (
        sql("DELETE FROM runs WHERE run = 0 AND solver = 'mine:Still'"), {"runs": {"short-v0": RUNS - 1}},
        "allowed: the first runs of the public suite, none left out",
    ),
    "another format": (lambda members: None, {"format": 2}, "of no format that this version reads; allowed: 1"),
    "another kind": (lambda members: None, {"runs": {"short-v0": "many"}}, "submission.json: runs is missing, unknown or of"),
    "an unknown claim": (lambda members: None, {"run": "rm"}, "submission.json: run is missing, unknown or of"),
    "more runs": (lambda members: None, {"runs": {"short-v0": 400}}, "has other tasks and numbers of runs"),
    "another solver": (lambda members: None, {"solver": "kf2"}, "has other tasks and numbers of runs"),
    "another code": (lambda members: None, {"code": "0.1.0+1234"}, "has another code than results.sqlite"),
    "a better board": (lambda members: None, {"board": []}, "its board does not follow from its rows"),
    "better rows": (sql("UPDATE runs SET steady_rms_u = steady_rms_u / 2"), {}, "its board does not follow from its rows"),
    "a trigger": (sql("CREATE TRIGGER t AFTER INSERT ON runs BEGIN SELECT 1; END"), {}, "it has the trigger 't'"),
    "no results file": (lambda members: members.update({"results.sqlite": b"x" * 100}), {}, "not a results file"),
}  # fmt: skip


@pytest.mark.parametrize("kind", FORGED)
def test_a_forged_bundle_is_refused_in_one_line(here, cli, kind):
    change, said, text = FORGED[kind]
    if kind == "a bomb":
        change = lambda members: members.update({"solver/a.py": bytes(2 << 20)})  # noqa: E731
    with pytest.MonkeyPatch.context() as patch:
        if kind == "a bomb":
            patch.setattr(bundle, "MOST_SIZE", 1 << 20)
        rewritten("entry.zip", "forged.zip", change, said)
        code, _, err = cli("judge", "forged.zip", "--out", "theirs")
    assert code == 2
    assert text in err[-1]
    assert not (here / "theirs").exists()


def test_what_is_no_bundle_and_what_a_bundle_may_not_do(here, cli, monkeypatch):
    (here / "text.zip").write_text("text")
    assert "not a readable bundle of sins-env" in cli("judge", "text.zip")[2][-1]
    with zipfile.ZipFile("other.zip", "w") as archive:
        archive.writestr("a.txt", "a")
    assert "it has no submission.json" in cli("judge", "other.zip")[2][-1]
    loud = "import pathlib; pathlib.Path('ran').touch()\n"
    rewritten(
        "entry.zip", "loud.zip", lambda members: members.update({"solver/mine.py": loud.encode()}), {"made": "\x1b[2J"}
    )
    code, out, _ = cli("judge", "loud.zip", "--out", "theirs", "--db", "hidden.sqlite")
    assert code == 0
    assert "\x1b" not in out
    assert not list(here.rglob("ran"))
