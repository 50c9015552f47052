"""Every verb; wrong use is exit code 2 and one line with the nearest name, a failed run is 1, Ctrl-C 130."""

import dataclasses
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest
from places import ROOT

import sins_env
from sins_env.cli.describe import layout, listing, named
from sins_env.evaluation.estimators import offers, version
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks import catalogue as tasks
from sins_env.types import Observation

PLUGIN = "evaluation.plugins:"
GOOD = PLUGIN + "DeadReckoning"
SLOW, LEAVES = PLUGIN + "Slow", PLUGIN + "Leaves"


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")


_COMMAND = """
import sys
from evaluation.short import SHORT
from sins_env.evaluation import tasks
from sins_env.cli.main import main
tasks.TASKS[SHORT.name] = SHORT
sys.exit(main())
"""


def spawn(*arguments, **settings):
    """A process of its own, as a user starts it."""
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
    command = [sys.executable, "-c", _COMMAND, *map(str, arguments)]
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **settings
    )


def evaluation(*more, runs=4, solver=GOOD):
    return ("eval", "--task", "short-v0", "--solver", solver, "--runs", runs, "--workers", 1, *more)


def table(cli, *more):
    code, out, _ = cli("board", "--json", *more)
    assert code == 0
    return [{name: value for name, value in entry.items() if name != "cost_ratio"} for entry in json.loads(out)]


def test_list_fits_one_screen_and_names_everything(cli, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, err = cli("list")
    assert (code, err) == (0, [])
    lines = out.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    words = out.replace(",", " ").split()
    for title, kind in listing.KINDS.items():
        names = list(kind.names())
        assert set(names) <= set(words)  # whole
        assert f"{title} {len(names)}" in " ".join(words)
    assert "SINS/AlignSway-v0" in words
    assert "sins-env list KIND" in out


@pytest.mark.parametrize(
    ("kind", "name", "what"),
    [
        ("environments", "SINS/Replay-v0", "A recording of an IMU, with its fixes, or zero-velocity updates"),
        ("tasks", "sway-told-wrong-v0", '0.6 deg, 60"'),
        ("solvers", "ckf", "The cubature Kalman filter."),
        ("flights", "hotstart30", "told heading wrong by 30 deg"),
        ("tables", "6.interference", "one disturbance of a parked car"),
        ("aids", "dvl", "dp-d300a"),
        ("presets", "perfect", "IMU and GPS"),
        ("presets", "dgps", "GPS"),
    ],
)
@pytest.mark.parametrize("columns", ["60", "200"])
def test_list_of_a_kind(cli, monkeypatch, kind, name, what, columns):
    monkeypatch.setenv("COLUMNS", columns)
    code, out, err = cli("list", kind)
    assert (code, err) == (0, [])
    row, *again = [line for line in out.splitlines() if line.split()[:1] == [name]]
    assert columns == "60" or not again  # a wide table stands in pieces
    assert columns == "60" or what in row
    first = [line.split()[0] for line in out.splitlines() if line.split()]
    assert set(listing.KINDS[kind].names()) <= set(first)


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("sway-white-v0", "0.7 deg"),
        ("SINS/AlignSway-v0", "misalignment_deg"),
        ("SINS/AlignSway-v0", "gps_valid (1,)"),
        ("SINS/NavFlight-v0", "action (10,)"),
        ("SINS/Replay-v0", "recording"),
        ("SINS/NavFlight-v0", "velocity_std_mps"),
        ("lu-mixture", "contamination 0.2"),
        ("flight-lu-gauss-v0", "from 100 s on; order: score of the position"),
        ("flight-hotstart60-v0", "from 0 s on; order: score of the heading error at the end"),
        ("zhao2010", "roll + turn"),
        ("tactical", "arw_deg_sqrt_h"),
        ("dgps", "rate_hz"),
        ("perfect", "GPS preset"),
        ("dvl", "noise_mps 0.003"),
        (PLUGIN + "with_setting", "gain"),
        (GOOD, "The told attitude, carried on by the gyros."),
    ],
)
def test_describe(cli, name, part):
    code, out, err = cli("describe", name)
    assert (code, err) == (0, [])
    assert part in " ".join(out.split())


def test_describe_names_all_that_an_observation_holds():
    assert set(named.OBSERVATION) == set(Observation.__annotations__)


def test_describe_preset_with_allan(cli, tmp_path):
    code, _, err = cli("describe", "mems", "--allan", "a.png")
    assert (code, err) == (0, ["figure: a.png"])
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_describe_draws_a_flight(cli, tmp_path):
    text = "{latitude_deg: 50, longitude_deg: 8, speed_mps: 30, segments: [[cruise, 5], [turn, 20, 3]]}"
    (tmp_path / "own.yaml").write_text(text)
    code, out, err = cli("describe", "own.yaml", "--plot", "own.png")
    assert (code, err) == (0, ["figure: own.png"])
    assert "turn" in out
    assert (tmp_path / "own.png").stat().st_size > 10_000


def test_describe_says_that_a_file_is_not_there(cli):
    code, _, err = cli("describe", "boat.yaml")
    assert (code, err) == (2, ["sins-env: no file 'boat.yaml'; allowed: the path of a scenario or a flight"])


def test_describe_a_track(cli, tmp_path):
    """A table with places and no room for an IMU is a track, unless it has the mapping of a recording."""
    rows = "\n".join(f"{i},{i},{i * i / 50},0" for i in range(20))
    (tmp_path / "trip.csv").write_text(f"time,east,north,up\n{rows}\n")
    code, out, err = cli("describe", "trip.csv")
    assert (code, err) == (0, [])
    assert "track" in out
    assert "19" in out
    (tmp_path / "trip.json").write_text("{}")
    code, out, err = cli("describe", "trip.csv")
    assert (code, "trip.json" in " ".join(err)) == (2, True)


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
def test_describe_recording(cli, recorded):
    code, out, _ = cli("describe", recorded)
    assert code == 0
    assert "100 Hz" in out


def test_run(cli, short, tmp_path):
    code, out, err = cli("run", "short-v0", GOOD, "--plot", "run.png")
    assert (code, err) == (0, ["figure: run.png"])
    assert "azimuth" in out
    assert (tmp_path / "run.png").stat().st_size > 20_000


@pytest.mark.parametrize(
    ("solver", "settings", "reason"),
    [
        ("At", {"how": '"nan"'}, "non-finite or zero action at 0.5 s"),
        ("At", {"how": '"zero"', "epoch": 200}, "non-finite or zero action at 20.0 s"),
        ("Ailing", {}, "the estimator gave up at 2.0 s"),
    ],
)
def test_run_with_failed_epochs_or_frozen_exits_with_1(cli, short, solver, settings, reason):
    given = [part for name, value in settings.items() for part in ("--set", f"{name}={value}")]
    code, out, err = cli("run", "short-v0", PLUGIN + solver, *given)
    assert code == 1
    assert "at the end" in out  # the table is there all the same
    assert err == [f"sins-env: {PLUGIN}{solver} on short-v0, run 0: {reason}"]


def test_exit_codes_of_eval(cli, short, monkeypatch):
    """A failed epoch is a failed run; one that the solver gave up, or that diverged, is a result."""
    code, _, err = cli(*evaluation("--set", 'how="nan"', solver=PLUGIN + "At", runs=2))
    assert code == 1
    assert err[0].endswith("run 0: non-finite or zero action at 0.5 s")
    assert cli(*evaluation(solver=PLUGIN + "Ailing", runs=2))[::2] == (0, [])
    far = dataclasses.replace(short, name="far-v0", kwargs={**short.kwargs, "start": "unknown", "coarse": 2.0})
    monkeypatch.setitem(tasks.TASKS, "far-v0", far)
    code, out, err = cli("eval", "--task", "far-v0", "--solver", PLUGIN + "Lost", "--runs", 2, "--workers", 1)
    assert "2 diverged" in out
    assert (code, err) == (0, [])
    for verb in ("run", "eval"):
        assert "Exit code 1: " in " ".join(cli(verb, "--help")[1].split())


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("run", "short-v0", LEAVES), "on short-v0, run 0: step ended its process (exit code 7), at 0.5 s"),
        (("replay", "parked.npz", LEAVES, "--coarse", 1), "on parked.npz: step ended its process (exit code 7)"),
        (("bench", LEAVES, "--task", "short-v0"), "on short-v0: step ended its process (exit code 7)"),
        (("check", LEAVES), "ended its process in the middle of the checks (exit code 7)"),
        (
            ("eval", "--task", "short-v0", "--solver", LEAVES, "--runs", 2, "--workers", 1),
            "on short-v0, run 0: step ended its process (exit code 7), at 0.5 s",
        ),
    ],
)
def test_no_verb_ends_with_its_solver(cli, short, parked, monkeypatch, arguments, told):
    """os._exit(7) in a plug-in is exit code 1 and one line, with one worker, too."""
    monkeypatch.setattr(os, "_exit", lambda code: pytest.fail(f"it plays in this process, which would end with {code}"))
    code, _, err = cli(*arguments)
    assert (code, [line.removeprefix("sins-env: ") for line in err]) == (1, [f"{LEAVES} {told}"])


def test_a_solver_that_hangs(cli, short, start_of):
    at, limit = PLUGIN + "At", ("--set", 'how="hang"', "--timeout", 1)
    assert cli("run", "short-v0", at, *limit)[::2] == (
        1, [f"sins-env: {at} on short-v0, run 0: step took longer than 1 s, at 0.5 s"],
    )  # fmt: skip
    code, out, err = cli(*evaluation(*limit, "--set", f"q={json.dumps(start_of(1))}", solver=at, runs=2))
    assert code == 1
    assert "1 raised" in out
    assert err == [f"{at} (how=hang, q={start_of(1)}) on short-v0, run 1: step took longer than 1 s, at 0.5 s"]
    for bad in ("0", "-1", "nan", "inf", "soon"):
        code, _, err = cli(*evaluation("--timeout", bad))
        assert (code, len(err)) == (2, 1)
        assert "allowed: a positive number" in err[0]


def test_run_that_raises(cli, short):
    given = ("run", "short-v0", PLUGIN + "At", "--set", "epoch=7")
    code, out, err = cli(*given)
    assert (code, out) == (1, "")
    why = "step raised ArithmeticError: no square root, at 0.7 s; --traceback shows where"
    assert err == [f"sins-env: {PLUGIN}At on short-v0, run 0: {why}"]
    code, _, err = cli(*given, "--traceback")
    assert err[0] == "Traceback (most recent call last):"


def test_eval_and_board(cli, short, tmp_path):
    code, out, err = cli(*evaluation("--db", "r.sqlite", "--plot", "e.png", solver=PLUGIN + "OneByOne"))
    assert (code, err) == (0, ["figure: e.png"])
    assert "OneByOne" in out
    assert (tmp_path / "e.png").stat().st_size > 20_000
    (entry,) = table(cli, "--db", "r.sqlite")
    assert (entry["task"], entry["solver"], entry["runs"]) == ("short-v0", PLUGIN + "OneByOne", 4)
    for form, part in (("--md", "| - |"), ("--csv", "task,suite,rank"), ("--json", '"t_conv_median_s"')):
        code, out, _ = cli("board", "--db", "r.sqlite", form)
        assert code == 0
        assert part in out
    code, out, _ = cli("board", "--db", "r.sqlite", "--plot", "b.png")
    assert "of 4" in out
    assert (tmp_path / "b.png").exists()
    code, _, err = cli("board", "--db", "r.sqlite", "--solver", PLUGIN + "OneByTwo")
    assert code == 2
    assert f"did you mean '{PLUGIN}OneByOne'" in err[0]


def test_existing_rows_are_kept_and_resumed(cli, short):
    assert cli(*evaluation(runs=6))[0] == 0
    complete = table(cli)
    db = sqlite3.connect("results.sqlite")
    db.execute("DELETE FROM runs WHERE run IN (1, 4, 5)")
    db.commit()
    db.close()
    code, out, err = cli(*evaluation(runs=6))
    assert (code, out) == (2, "")
    assert len(err) == 1
    assert "holds 3 runs" in err[0]
    assert "--resume" in err[0]
    assert table(cli)[0]["runs"] == 3
    code, out, _ = cli(*evaluation("--resume", runs=6))
    assert code == 0
    assert_tables(table(cli), complete)
    assert cli(*evaluation("--resume", "--seed", 3, runs=2))[0] == 0
    assert [entry["runs"] for entry in table(cli)] == [6, 2]


def assert_tables(found, expected):
    """Equal to 1e-9."""
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        for axis in "ENU":
            assert one["rms"][axis] == pytest.approx(other["rms"][axis], rel=1e-9)
            assert one["rms_ci"][axis] == pytest.approx(other["rms_ci"][axis], rel=1e-9)
        assert {k: v for k, v in one.items() if "rms" not in k} == {k: v for k, v in other.items() if "rms" not in k}


def test_interrupted_evaluation_resumes_to_the_same_table(cli, short, monkeypatch):
    add, kept = Store.add, []

    def interrupted(self, key, records):
        if len(kept) == 2:
            raise KeyboardInterrupt
        kept.append(records)
        add(self, key, records)

    with monkeypatch.context() as patch:
        patch.setattr(Store, "add", interrupted)
        code, _, err = cli(*evaluation("--chunk", 2, runs=6))
    assert code == 130
    assert err == ["sins-env: interrupted: 4 of 6 runs are in results.sqlite; --resume continues"]
    assert table(cli)[0]["runs"] == 4
    assert cli(*evaluation("--chunk", 2, "--resume", runs=4))[0] == 0


def test_failed_runs_are_shown_and_exit_with_1(cli, short, start_of):
    given = ("--set", f"q={json.dumps(start_of(1))}")
    code, out, err = cli(*evaluation(*given, solver=PLUGIN + "At"))
    assert code == 1
    assert "1 raised" in out
    assert len(err) == 1
    assert err[0].endswith("run 1: step raised ArithmeticError: no square root, at 0.5 s")


def test_check(cli):
    code, out, err = cli("check", GOOD)
    assert (code, err) == (0, [])
    assert "meets the contract" in out
    code, out, err = cli("check", PLUGIN + "GlobalRandom")
    assert code == 1
    assert "FAIL  draws from its rng only" in out
    assert err == [f"sins-env: {PLUGIN}GlobalRandom fails 1 of 13 checks"]
    code, out, err = cli("check", GOOD, "--tolerance", 1e-6)
    assert (code, err) == (0, [])
    assert "the same rng gives the same result  to 1e-06" in out


def test_bench(cli, monkeypatch):
    from sins_env.evaluation.speed import bench

    monkeypatch.setattr(bench, "SECONDS", 0.2)
    code, out, err = cli("bench", GOOD, "--runs", 4, 1)
    assert (code, err) == (0, [])
    assert out.count("whole chain") == 2
    assert "the estimator's in a process of its own" in " ".join(out.split())
    code, out, err = cli("bench", GOOD, "--runs", 4, "--json")
    found = json.loads(out)
    assert (code, err, set(found["versions"])) == (0, [], {"sins-env", "numpy", "numba"})
    assert [one["part"] for one in found["cpu_time"]] == ["whole chain", "environment", "estimator"]
    assert all(one["runs"] == 4 and one["epoch_us"] > 0 for one in found["cpu_time"])
    code, out, err = cli("bench", PLUGIN + "OneByOne", "--runs", 4, 1)
    assert (code, err) == (0, [f"{PLUGIN}OneByOne takes one run at a time: 1 run instead of 4"])
    assert out.count("whole chain") == 1
    code, out, err = cli("bench", PLUGIN + "BadReset", "--runs", 1)
    assert (code, out) == (1, "")
    assert err == [f"sins-env: {PLUGIN}BadReset on sway-white-v0: reset raised RuntimeError: no memory left"]


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
def test_bench_of_a_recording_has_its_windows_only(cli, monkeypatch, recorded):
    from sins_env.evaluation.speed import bench

    monkeypatch.setattr(bench, "SECONDS", 0.05)
    code, out, err = cli("bench", GOOD, "--task", "rlg-car-v0")
    assert (code, err) == (0, ["rlg-car-v0: 7 runs instead of 256, the windows of its recording"])
    assert [line.split()[2] for line in out.splitlines() if "whole chain" in line] == ["7", "1"]


def test_bench_of_a_task_that_is_too_short(cli, short, monkeypatch):
    monkeypatch.setitem(tasks.TASKS, "s", dataclasses.replace(short, kwargs={**short.kwargs, "duration": 3.0}))
    code, _, err = cli("bench", GOOD, "--task", "s", "--runs", 1)
    assert (code, len(err)) == (2, 1)
    assert "too short to be timed" in err[0]


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("evall",), "unknown command 'evall'; did you mean 'eval'?"),
        (("run", "sway-whit-v0", GOOD), "did you mean 'sway-white-v0'?"),
        (("run", "sway-white-v0", GOOD + "s"), "did you mean 'DeadReckoning'?"),
        (("run", "sway-white-v0", GOOD, "--seed", "-1"), "--seed"),
        (("run", "sway-white-v0", GOOD, "--plot", "a.xyz"), "allowed: a file that ends in"),
        (("run", "sway-white-v0", GOOD, "--plot", "no/a.png"), "the directory does not exist"),
        (("run", "sway-white-v0", GOOD, "--set", "gain"), "allowed: NAME=VALUE"),
        (("eval", "--task", "sway-white-v0"), "--solver"),
        (("eval", "--task", "sway-white-v0", "--solver", GOOD, "--runs", "0"), "at least 1"),
        (("eval", "--task", "sway-white-v0", "--solver", GOOD, "--executor", "daks"), "did you mean 'dask'?"),
        (("eval", "--task", "sway-white-v0", "--solver", GOOD, "--db", "no/r.sqlite"), "no such directory"),
        (("eval", "--task", "sway-white-v0", GOOD, "--solver", GOOD), "unknown task 'evaluation.plugins"),
        (("board",), "no such results file"),
        (("describe", "sway-markof-v0"), "did you mean 'sway-markov-v0'?"),
        (("describe", "missing.npz"), "missing.npz"),
        (("describe", "dgps", "--allan", "a.png"), "allowed: an IMU preset"),
        (("describe", "dgps", "--plot", "a.png"), "--plot for 'dgps'; allowed: a flight (sun2012,"),
        (("describe", "gone.yaml"), "gone.yaml"),
        (("describe", "sun212"), "did you mean 'sun2012'?"),
        (("check", PLUGIN + "Nothing"), "without batched, reset, step"),
        (("bench", "--frobnicate"), "unrecognized arguments: --frobnicate (see sins-env bench --help)"),
        (("run", "sway-white-v0", GOOD, "--ploy=3"), "--ploy=3; did you mean '--plot'? (see sins-env run --help)"),
        (("run", "sway-white-v0", GOOD, "more"), "unrecognized arguments: more (see sins-env run --help)"),
        (("--frobnicate",), "(see sins-env --help)"),
        (
            ("list", "solver"),
            "unknown kind 'solver'; did you mean 'solvers'? Allowed: aids, environments, flights, presets",
        ),
    ],
)
def test_wrong_use(cli, tmp_path, arguments, part):
    refused(cli, tmp_path, arguments, part)


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
def test_wrong_use_of_a_recording(cli, tmp_path, recorded):
    refused(cli, tmp_path, ("run", "rlg-car-v0", GOOD, "--run", "7"), "allowed: up to 7")


def refused(cli, tmp_path, arguments, part):
    """One line that says why, and nothing else."""
    code, out, err = cli(*arguments)
    assert (code, out) == (2, "")
    assert len(err) == 1
    assert part in err[0]
    assert not list(tmp_path.iterdir())


def test_no_command_shows_help(cli):
    code, out, err = cli()
    assert (code, out) == (2, "")
    assert any("eval" in line for line in err)
    assert cli("--help")[0] == 0
    assert cli("--version")[:2] == (0, f"sins-env {sins_env.__version__}\n")


def test_names_of_installed_solvers(cli, monkeypatch):
    """Entry points are found, loaded late, and offered when a name is misspelt."""
    from importlib.metadata import EntryPoint

    points = [
        EntryPoint("dead", PLUGIN + "DeadReckoning", offers.GROUP),
        EntryPoint("gone", "no_such_module:X", offers.GROUP),
    ]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: points)
    assert cli("describe", "dead")[0] == 0
    assert "cannot be loaded" in cli("list", "solvers")[1]
    assert "did you mean 'dead'?" in cli("run", "sway-white-v0", "deat")[2][0]
    assert "cannot be loaded" in cli("describe", "gone")[2][0]
    assert version.code_version("dead") == version.code_version(GOOD)


def test_descriptions_are_whole_sentences(cli, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    out = "".join(cli("list", kind)[1] for kind in ("environments", "tasks"))
    assert "see ReplaySettings" not in out
    assert "A recording of an IMU, with its fixes, or zero-velocity updates where it has none." in out
    assert "The swaying base of 000 section 2.5.1." in out
    assert "swaying base, told attitude wrong by 1/1/15 deg (1 sigma), Gauss-Markov IMU errors" in out
    assert layout.summary("First: with ``a: b`` in it, e.g. this. Second.") == "First: with a: b in it, e.g. this."
    for task in tasks.TASKS.values():
        assert "the same" not in task.what
    _, _, err = cli("describe", "prefect")
    assert err[0].count("perfect") == 2  # offered once, listed once


def test_the_package_is_the_command(tmp_path):
    """``python -m sins_env`` and ``sins-env`` are one, and say their version without the evaluation."""
    for command in ([sys.executable, "-m", "sins_env"], [str(Path(sys.executable).parent / "sins-env")]):
        done = subprocess.run([*command, "--version"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stdout) == (0, f"sins-env {sins_env.__version__}\n")
        done = subprocess.run([*command, "lits"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stderr[:60]) == (
            2,
            "sins-env: unknown command 'lits'; did you mean 'list'? Allow",
        )


def test_process_pipe_and_piped_reader(tmp_path):
    done = spawn("list", cwd=tmp_path)
    out, err = done.communicate(timeout=60)
    assert (done.returncode, err) == (0, "")
    assert "sway-white-v0" in out
    done = spawn("list", cwd=tmp_path)
    done.stdout.close()  # the reader has gone
    _, err = done.communicate(timeout=60)
    assert (done.returncode, err) == (0, "")


def listens():
    """SIGINT is ignored by what a shell runs in the background, and by all that it starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_keeps_what_is_done(tmp_path):
    """A real SIGINT to the whole process group, workers included."""
    slow = spawn(
        "eval", "--task", "short-v0", "--solver", PLUGIN + "Slow", "--set", "seconds=0.003", "--runs", 60,
        "--chunk", 1, "--workers", 2, cwd=tmp_path, start_new_session=True,
        preexec_fn=listens,
    )  # fmt: skip
    path = tmp_path / "results.sqlite"
    deadline = time.monotonic() + 180  # of a loaded machine
    while count(path) < 2 and time.monotonic() < deadline:
        time.sleep(0.1)
    os.killpg(slow.pid, signal.SIGINT)
    _, err = slow.communicate(timeout=120)
    assert slow.returncode == 130
    kept = count(path)
    assert kept >= 2
    what = f"{kept} of 60 runs are in results.sqlite"
    assert err == f"sins-env: interrupted: {what}; --resume continues\n"
    assert emptied(slow.pid), "a worker is left"


def emptied(group):
    """Whether the processes of a group end within a few seconds."""
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_killed_evaluation_resumes_and_shares_its_file(cli, short, tmp_path):
    """kill -9 of the parent leaves whole rows and no workers; two evaluations into one file lose nothing."""
    given = ("eval", "--task", "short-v0", "--runs", 6, "--chunk", 1, "--set", "seconds=0.001")
    slow = spawn(*given, "--solver", SLOW, "--workers", 2, cwd=tmp_path, start_new_session=True)
    path = tmp_path / "results.sqlite"
    deadline = time.monotonic() + 180  # of a loaded machine
    while count(path) < 1 and time.monotonic() < deadline:
        time.sleep(0.05)
    slow.kill()
    slow.communicate(timeout=120)
    assert emptied(slow.pid), "a worker is left"
    assert 1 <= count(path) < 6
    both = [
        spawn(*given, "--solver", SLOW, "--resume", "--workers", 1, cwd=tmp_path),
        spawn(*given[:-2], "--solver", PLUGIN + "Noisy", "--workers", 1, cwd=tmp_path),
    ]
    assert [process.communicate(timeout=60)[1] for process in both] == ["", ""]
    kept = {entry["solver"]: entry for entry in table(cli)}
    assert [entry["runs"] for entry in kept.values()] == [6, 6]
    assert cli(*given, "--solver", SLOW, "--workers", 1, "--db", "fresh.sqlite")[0] == 0
    assert_tables([kept[SLOW]], table(cli, "--db", "fresh.sqlite"))


def count(path):
    """Rows of a results file that others write to."""
    if not path.exists():
        return 0
    db = sqlite3.connect(path, timeout=5)
    try:
        return db.execute("SELECT count(*) FROM runs").fetchone()[0]
    except sqlite3.OperationalError:  # just being created
        return 0
    finally:
        db.close()
