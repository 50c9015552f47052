"""Rows are made again; what was tampered with, or belongs to another code, world or suite, is told from what is equal."""

import io
import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from sins_env.cli.main import main
from sins_env.evaluation import evaluate
from sins_env.evaluation.estimators import version
from sins_env.evaluation.store import verify as verification
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.store.verify import compare_runs, verify
from sins_env.evaluation.tasks import catalogue
from sins_env.evaluation.tasks import task as tasks

PLUGIN = "evaluation.plugins:"
SECRET = 271828182845904523536028747135266249775724709


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")


def fill(short, solver, runs=5, seed=None, code=None, **settings):
    found = evaluate(short, PLUGIN + solver, runs, seed, workers=1, settings=settings, cost=False)
    key = Key.of(short.name, found.suite, PLUGIN + solver, settings, code or version.code_version(PLUGIN + solver))
    with Store("results.sqlite") as db:
        db.add_task(short)
        db.add(key, found.records)
    return key


def check(rows=100, seed=None, **more):
    with Store("results.sqlite", read_only=True) as db:
        keys = db.keys()
        return verify(db, keys, rows, seed, draw=0, trusted={key.solver for key in keys}, **more)


def tamper(sql):
    with Store("results.sqlite") as db:
        db.connection.execute(sql)


def test_what_is_as_stored(short):
    """Sampled solvers, failed runs and other settings included, whatever batch the rows were made in."""
    fill(short, "Noisy", 7)
    fill(short, "At", 3, epoch=150)
    fill(short, "At", 2, how="nan")
    done = []
    found = check(progress=lambda part, total: done.append((part, total)))
    assert (found.runs, found.differences, found.left_out) == (12, (), {})
    assert done[-1] == (12, 12)
    assert all(total == 12 for _, total in done)
    assert check(rows=4).runs == 4


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ("final_u = final_u * (1 + 3e-9)", "run 3: final_u_rad "),
        ("t_conv_e = 4.0", "run 3: t_conv_e_s 4 stored, "),
        ("heading = NULL", "run 3: heading_rad nan stored, "),
        ("status = 'diverged', reason = 'x'", "run 3: status diverged stored, ok now"),
        ("repairs = 2", "run 3: repairs 2 stored, 0 now"),
        ("nees_50 = 3.0", "run 3: nees_50 3 stored, "),
        ("steady_mean_n = -steady_mean_n", "run 3: steady_mean_n_rad "),
    ],
)
def test_a_changed_score_is_found(short, change, text):
    fill(short, "DeadReckoning")
    tamper(f"UPDATE runs SET {change} WHERE run = 3")
    found = check()
    assert found.runs == 5
    (line,) = found.differences
    assert line.startswith(f"{PLUGIN}DeadReckoning on short-v0, {text}")


def test_why_a_run_fails_now_is_said(short):
    fill(short, "At", 1, how="nan")
    with Store("results.sqlite", read_only=True) as db:
        (key,) = db.keys()
        (reason,) = db.results(key).records.reason
    tamper("UPDATE runs SET status = 'ok', reason = ''")
    (line,) = check().differences
    assert reason
    assert line.endswith(f"run 0: status ok stored, diverged now ({reason})")


def test_settings_that_a_file_names_are_played_apart(short, monkeypatch):
    """They may ask for a million particles: what this package's own solvers do with them has limits of memory and time."""
    limits = {}

    def limited(*given, epoch_timeout_s, **more):
        limits[given[1], *more["settings"]] = epoch_timeout_s
        return evaluate(*given, **more)

    with Store("results.sqlite") as db:
        for solver, settings in (("kf", {}), ("iekf", {"iterations": 1}), (PLUGIN + "At", {"epoch": 150})):
            found = evaluate(short, solver, 1, workers=1, settings=settings, cost=False)
            db.add(Key.of(short.name, found.suite, solver, settings, version.code_version(solver)), found.records)
        db.add_task(short)
    monkeypatch.setattr(verification.monte_carlo, "evaluate", limited)
    assert check().differences == ()
    assert limits == {("kf",): None, ("iekf", "iterations"): 60.0, (PLUGIN + "At", "epoch"): None}


def test_rounding_is_no_difference(short):
    fill(short, "DeadReckoning")
    tamper("UPDATE runs SET final_u = final_u * (1 + 3e-10), step_s = 9, heading = heading * (1 - 3e-10)")
    assert check().differences == ()
    found = evaluate(short, PLUGIN + "DeadReckoning", 2, workers=1, cost=False).records
    mean = 1e-6 * found.steady_rms + 1e-11 * found.steady_rms  # a mean that cancels has the rounding of its terms
    one, other = (dict(vars(found), steady_mean=value) for value in (mean, 1e-6 * found.steady_rms))
    assert compare_runs(type(found)(**one), type(found)(**other)) == []
    with pytest.raises(ValueError, match="the same runs"):
        compare_runs(found, evaluate(short, PLUGIN + "DeadReckoning", [1, 2], workers=1, cost=False).records)


def test_what_cannot_be_verified(short, monkeypatch):
    fill(short, "DeadReckoning", 2)
    fill(short, "Noisy", 3, code="0.0.9+deadbeef")
    fill(short, "Told", 4, seed=SECRET)
    fill(short, "Lost", 1)
    tamper(f"UPDATE runs SET solver = 'nobodys' WHERE solver = '{PLUGIN}Lost'")
    found = check()
    assert (found.runs, found.differences) == (2, ())
    assert sorted(found.left_out.values()) == [1, 3, 4]
    reasons = " | ".join(found.left_out)
    for part in ("0.0.9+deadbeef", "no solver nobodys here", "--seed must be given"):
        assert part in reasons
    monkeypatch.delitem(catalogue.TASKS, "short-v0")
    found = check()
    assert found.runs == 0
    assert found.left_out == {"short-v0 is no task of this version; a file of one's own is named with --task FILE": 10}


def test_a_changed_world_is_found(short):
    fill(short, "DeadReckoning", 2)
    tamper("UPDATE tasks SET digest = '0123456789abcdef'")
    (line,) = check().differences
    assert line.startswith("short-v0: its world has changed, digest 0123456789abcdef stored, ")
    tamper("UPDATE tasks SET digest = NULL, definition = replace(definition, '\"hold_s\": 5.0', '\"hold_s\": 7.0')")
    assert check().differences == ("short-v0: its definition has changed",)


def test_changed_yardsticks_are_found(short):
    fill(short, "DeadReckoning", 2)
    assert check().differences == ()
    with sqlite3.connect("results.sqlite") as db:
        criteria, bound = db.execute("SELECT criteria, bound FROM tasks").fetchone()
    wide = json.loads(criteria)
    wide["delta"] = [10 * one for one in wide["delta"]]
    tamper(f"UPDATE tasks SET criteria = '{json.dumps(wide)}'")
    (line, *_) = check().differences
    assert line.startswith(f"short-v0: its criteria have changed, delta = {wide['delta']} stored, ")
    low = json.loads(bound)
    low["steady"] = [one / 10 for one in low["steady"]]
    tamper(f"UPDATE tasks SET criteria = '{criteria}', bound = '{json.dumps(low)}'")
    (line,) = check().differences
    assert line.startswith("short-v0: its bound has changed in steady, <Bound: ")
    tamper("UPDATE tasks SET bound = 'null'")
    (line,) = check().differences
    assert line.startswith("short-v0: its bound has changed, None stored, <Bound: ")


def test_the_command(short, capsys, monkeypatch):
    fill(short, "DeadReckoning", 3)
    named = ["--workers", "1", "--solver", PLUGIN + "DeadReckoning"]
    assert main(["verify", "--rows", "2", *named]) == 0
    out, err = capsys.readouterr()
    assert (out, err) == ("2 runs made again: equal to 1e-9\n", "")
    tamper("UPDATE runs SET final_e = 1.0 WHERE run = 1")
    assert main(["verify", *named]) == 1
    err = capsys.readouterr().err.splitlines()
    assert "run 1: final_e_rad 1 stored, " in err[0]
    assert err[-1] == "sins-env: results.sqlite: 1 differences in 3 runs"
    tamper("UPDATE runs SET code = 'old'")
    assert main(["verify", *named]) == 1
    err = capsys.readouterr().err.splitlines()
    assert err[0].startswith("not verifiable, 3 runs: made with code old, this is ")
    assert err[-1] == "sins-env: results.sqlite: no run could be verified"


def test_compare_command(short, capsys):
    for solver in ("DeadReckoning", "Told"):
        fill(short, solver, 8)
    assert main(["compare", "short-v0", PLUGIN + "Told", PLUGIN + "DeadReckoning"]) == 0
    assert f"{PLUGIN}Told against {PLUGIN}DeadReckoning on short-v0, 8 common runs: " in capsys.readouterr().out
    assert main(["compare", "short-v0", PLUGIN + "Told", "ckf"]) == 2
    fill(short, "Noisy", 8, seed=5)
    assert main(["compare", "short-v0", PLUGIN + "Told", PLUGIN + "Noisy"]) == 2
    assert "no suite in common" in capsys.readouterr().err


# ---- the hidden suite ----


def test_a_secret_seed_stays_secret(short, monkeypatch, capsys):
    """In the file, on the screen, in errors: only the hash; even if the solver puts all it knows into its exception."""
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{SECRET}\n"))
    given = ["eval", "--task", "short-v0", "--solver", PLUGIN + "Noisy", PLUGIN + "Peeking"]
    assert main([*given, "--runs", "3", "--workers", "1", "--seed", "-"]) == 1
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{SECRET}x\n"))
    assert main([*given, "--seed", "-"]) == 2
    assert main([*given, "--seed", f"-{SECRET}"]) == 2
    assert main(["board", "--json"]) == main(["board", "--csv"]) == main(["export", "--json", "r.json"]) == 0
    said = "".join(capsys.readouterr()) + Path("r.json").read_text()
    assert "SeedSequence" in said
    told = said.encode() + b"".join(path.read_bytes() for path in Path().glob("results.sqlite*"))
    assert tasks.seed_hash(SECRET)[:16].encode() in told
    for secret in (SECRET, int(SECRET) & (2**64 - 1)):
        assert str(secret).encode() not in told
        assert f"{secret:x}".encode() not in told
    assert main(["verify", "--workers", "1", "--solver", PLUGIN + "Noisy"]) == 1
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{SECRET}\n"))
    assert main(["verify", "--workers", "1", "--solver", PLUGIN + "Noisy", "--seed", "-"]) == 0
    assert str(SECRET) not in "".join(capsys.readouterr())


def test_a_solver_cannot_make_the_truth_from_its_generator(short):
    """The stream is that of the suite's seed sequence; what it spawns is another for each run."""
    rng = tasks.solver_rng(short, "s", 3, SECRET)
    plain = np.random.default_rng(tasks.seed_sequence(short, SECRET, tasks.zlib.crc32(b"s"), 3))
    np.testing.assert_array_equal(rng.random(5), plain.random(5))
    sequence = rng.bit_generator.seed_seq
    assert SECRET not in (sequence.entropy, *sequence.spawn_key)
    spawned = {tasks.solver_rng(short, "s", run, SECRET).spawn(1)[0].random() for run in range(20)}
    assert len(spawned) == 20


def test_suite_hash(capsys, monkeypatch, short):
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{SECRET}\n"))
    assert main(["suite-hash"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert len(out.strip()) == 64
    assert out.startswith(tasks.suite_hash(short, SECRET))
    assert main(["suite-hash", "--seed", "12"]) == 0
    assert "can be guessed" in capsys.readouterr().err
    for seed in (-SECRET, SECRET + 0.5, str(SECRET)):
        with pytest.raises(ValueError, match="allowed: a whole number") as raised:
            tasks.suite_hash(short, seed)
        assert "2718" not in str(raised.value)
