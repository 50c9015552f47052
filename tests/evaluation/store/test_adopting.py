"""Rows of an older code count as made by the present one if it makes the same; if one differs, nothing does."""

import pytest

from sins_env.cli.main import main
from sins_env.evaluation import evaluate
from sins_env.evaluation.estimators import version
from sins_env.evaluation.store import adopting, merging
from sins_env.evaluation.store.database import StoreError
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store

PLUGIN = "evaluation.plugins:"
SOLVERS = [PLUGIN + "DeadReckoning", PLUGIN + "Noisy"]
OLD = "0.0.9+deadbeef"


@pytest.fixture
def path(short, tmp_path, monkeypatch):
    """A file with five rows of each of two solvers, made by an older code."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    with Store("results.sqlite") as store:
        store.add_task(short)
        for solver in SOLVERS:
            found = evaluate(short, solver, 5, workers=1, cost=False)
            store.add(Key.of(short.name, found.suite, solver, {}, OLD), found.records)
    return tmp_path / "results.sqlite"


def change(path, sql):
    with Store(path) as store:
        store.connection.execute(sql)


def adopt(*more, solvers=SOLVERS):
    return main(["verify", "--adopt", "--workers", "1", "--rows", "4", "--solver", *solvers, *more])


def codes(path):
    with Store(path, read_only=True) as store:
        return dict(store.connection.execute("SELECT code, count(*) FROM runs GROUP BY code"))


def test_equal_rows_are_adopted_with_their_provenance(path, capsys):
    assert adopt() == 0
    out, err = capsys.readouterr()
    now = version.code_version(SOLVERS[0])
    assert out.splitlines() == [
        "4 runs made again: equal to 1e-9",
        f"2 pairs of a solver and a task, made with code {OLD}, count as made with {now}",
    ]
    assert err == ""
    assert codes(path) == {now: 10}
    with Store(path, read_only=True) as store:
        assert [len(store.runs_of(key)) for key in list(store.keys())] == [5, 5]
        for key in list(store.keys()):
            (one,) = adopting.adoptions(store, key)
            assert one[:4] == (OLD, now, "0-4", 2)
            (made,) = store.sessions(key)
            assert made.id != one.session
    assert adopt() == 0
    assert capsys.readouterr().out == "results.sqlite: all rows are of the present code\n"


def test_a_row_that_differs_adopts_nothing(path, capsys):
    change(path, f"UPDATE runs SET final_u = 0.3 WHERE solver = '{SOLVERS[1]}'")
    assert adopt() == 1
    err = capsys.readouterr().err.splitlines()
    assert err[0].startswith(f"{SOLVERS[1]} on short-v0, run ")
    assert "final_u_rad 0.3 stored, " in err[0]
    assert err[-1] == "sins-env: results.sqlite: 2 differences in 4 runs; nothing was adopted"
    assert codes(path) == {OLD: 10}


def test_what_cannot_be_run_again_or_is_there_already_is_left(path, short, capsys):
    assert adopt(solvers=SOLVERS[:1]) == 0  # the other one is not named, so it is not imported
    now = version.code_version(SOLVERS[0])
    assert codes(path) == {OLD: 5, now: 5}
    found = evaluate(short, SOLVERS[1], 2, workers=1, cost=False)
    with Store(path) as store:
        store.add(Key.of(short.name, found.suite, SOLVERS[1], {}, now), found.records)
    assert adopt() == 0
    assert codes(path) == {OLD: 2, now: 10}
    with Store(path, read_only=True) as store:
        (key,) = store.keys(solvers=SOLVERS[1:])
        assert [one.runs for one in adopting.adoptions(store, key)] == ["2-4"]
        assert len(store.sessions(key)) == 2


def test_too_few_rows_and_changed_code(path, monkeypatch, capsys):
    assert main(["verify", "--adopt", "--rows", "1", "--solver", *SOLVERS]) == 2
    assert "rows = 1 for 2 pairs of a solver and a task; allowed: at least one row of each" in capsys.readouterr().err
    told = iter("abcdefghijklmnopqrstuvwxyz")
    monkeypatch.setattr(version, "code_version", lambda solver: next(told))
    assert adopt() == 2
    assert "has changed meanwhile; nothing was adopted" in capsys.readouterr().err
    assert codes(path) == {OLD: 10}


def test_a_merge_keeps_adoptions_and_a_file_with_odd_ones_is_refused(path, tmp_path):
    assert adopt() == 0
    merging.merge([path], tmp_path / "all.sqlite")
    with Store(path, read_only=True) as one, Store(tmp_path / "all.sqlite", read_only=True) as other:
        assert [adopting.adoptions(other, key)[0][:4] for key in list(other.keys())] == [
            adopting.adoptions(one, key)[0][:4] for key in list(one.keys())
        ]
        (only,) = one.keys(solvers=SOLVERS[:1])
    merging.merge([path], tmp_path / "some.sqlite", only=[only])
    with Store(tmp_path / "some.sqlite", read_only=True) as some:
        assert some.keys() == [only]
        assert some.connection.execute("SELECT count(*) FROM adoptions").fetchone() == (1,)
    change(path, "UPDATE adoptions SET runs = 'all of them'")
    with pytest.raises(StoreError, match=r"table adoptions, row 1: runs is text of length 11; allowed: ranges such as"):
        Store(path)


def test_ranges():
    assert adopting.ranges([]) == ""
    assert adopting.ranges([205, 0, 1, 2]) == "0-2 205"
