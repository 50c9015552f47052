"""Whatever a stranger's solver does costs its own runs and nothing else, and its reason is on record."""

import ctypes
import dataclasses
import os
import re
import time
from pathlib import Path

import numpy as np
import pytest
from evaluation.short import SHORT

from sins_env.cli.arguments import seed
from sins_env.evaluation import check_estimator, evaluate, run_episode
from sins_env.evaluation.estimators import child, finding
from sins_env.evaluation.estimators.child import Child
from sins_env.evaluation.estimators.guard import EstimatorError
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import TASKS

EVIL = "evaluation.hostile.evil:"
TINY = dataclasses.replace(SHORT, name="tiny-v0", kwargs={**SHORT.kwargs, "duration": 2.0}, hold_s=0.5)
LIMIT_S = 0.4  #: for solvers that hang
NO_ANSWER = "step: its process answered what is no answer"
LATE = f"step took longer than {LIMIT_S} s"

#: What is on record of each solver, before the time.
RAISES = {
    "Raises": "step raised RuntimeError: boom \x1b[31m<script>alert(1)</script>",
    "RaisesStrBomb": "step raised E: (its message raises RuntimeError)",
    "RaisesStrExit": "step raised E: (its message raises SystemExit)",
    "RaisesHuge": "step raised RuntimeError: " + "x" * 1000,
    "Interrupts": "step raised KeyboardInterrupt",
    "Exits": "step raised SystemExit: 0",
    "Group": "step raised BaseExceptionGroup: both (2 sub-exceptions)",
    "DeepGroup": "step raised ExceptionGroup: deep (1 sub-exception)",
    "LongName": "step raised " + "N" * 1000,
    "Unicode": "step raised RuntimeError: ? \u202e \x00 second line",
    "OsExits": "step ended its process (exit code 0)",
    "Crashes": "step ended its process (signal SIGSEGV)",
    "HangsAtExit": "step raised RuntimeError: with a thread that does not end",
    "ForksAndLeaves": "step ended its process (exit code 4)",
    "KillsParent": "step ended its process (its pipe is closed)",
    "KillsGroup": "step ended its process (signal SIGTERM)",
    "ClosesAll": "step ended its process (exit code 1)",
    "Beats": NO_ANSWER,
    "RaisesItsLimit": "step raised ValueError: not allowed to raise maximum limit",
    "SeesSecrets": "step raised RuntimeError: seed False, files /dev/null /memfd pipe pipe pipe pipe socket, readable 0",
}
HANGS = ("LoopsInPython", "LoopsInC", "Sleeps", "IgnoresSignals", "Stops", "ArrayLoops")
#: Solvers whose runs are those of the honest one: what they do, or look for, is not there.
HARMLESS = (
    "Forks", "ForksAndReturns", "ForksAway", "StartsPrograms", "Threads", "KillsStarter", "StopsKeeper", "StopsStarter", "Grows",
    "Prints", "ClosesStandard",
    "Leaves", "PickleBomb", "Shrinks", "Frames", "Collector", "Patches",
)  # fmt: skip
RETURNS = {
    "shape": "step returned shape (4, 4); allowed: (4,)",
    "big": "step returned shape (1000000, 1000000); allowed: (4,)",
    "complex": "step returned a ndarray of complex128; allowed: shape (4,)",
    "bomb": "step ended its process (exit code 3)",
    "interrupting": "step raised KeyboardInterrupt",
    "text": "step returned a str; allowed: shape (4,)",
    "generator": "step returned a generator; allowed: shape (4,)",
    "ints": "step returned a list of object; allowed: shape (4,)",
    "dict": "step returned a dict; allowed: shape (4,)",
}
COVARIANCES = {
    "raises": "covariance raised RuntimeError: c",
    "shape": "covariance returned shape (2, 2); allowed: (3, 3)",
}
HEALTHS = {
    "text": "health returned str without repairs and failed_at",
    "negative": "health returned a negative count; allowed: counts from 0 on, and failed_at from -1 on",
    "big": "health returned type without repairs and failed_at",
}
LIES = {name: NO_ANSWER for name in ("garbage", "zeros", "long", "twice", "flood")} | {
    "half": LATE,
    "trickle": LATE,
    "close": "step ended its process (its pipe is closed)",
}
MADE = {
    "exit": "solver 'evaluation.hostile.evil:Inits' cannot be made: make ended its process (exit code 0)",
    "interrupt": "solver 'evaluation.hostile.evil:Inits' cannot be made: make raised KeyboardInterrupt",
}


def play(name, what=None, limit_s=None, runs=1):
    settings = {} if what is None else {"what": what}
    return evaluate(TINY, EVIL + name, runs, settings=settings, epoch_timeout_s=limit_s, cost=False, workers=1).records


def reason(records):
    """The reason of the only run, without the time."""
    assert records.status[0] == "raised"
    assert len(records.traceback[0].encode()) <= 4096
    assert len(records.reason[0].encode()) <= 4096
    return re.sub(r", at \d\.\d s$", "", records.reason[0])


@pytest.fixture(scope="module")
def honest():
    return play("Honest")


@pytest.fixture(autouse=True)
def _none_is_left():
    """Nothing that a solver has started outlives it."""
    yield
    deadline = time.monotonic() + 5.0
    while (left := descendants(os.getpid(), 2)) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not left


def descendants(process, generation):
    """Processes of that generation; solvers are in the third, their keepers in the second."""
    path = Path(f"/proc/{process}/task/{process}/children")
    try:
        children = path.read_text().split()
    except OSError:  # it has just ended
        return []
    return children if generation == 1 else [one for child in children for one in descendants(child, generation - 1)]


@pytest.mark.parametrize("name", RAISES)
def test_its_reason_is_on_record(name):
    told = reason(play(name))
    assert told.startswith(RAISES[name]) if len(RAISES[name]) > 500 else told == RAISES[name]


@pytest.mark.parametrize("name", HANGS)
def test_whatever_hangs_is_ended(name):
    assert reason(play(name, limit_s=LIMIT_S)) == LATE


@pytest.mark.parametrize("name", HARMLESS)
def test_what_it_does_changes_nothing(name, honest, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.testing.assert_array_equal(play(name).history, honest.history)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "told"), [("Returns", RETURNS), ("Cov", COVARIANCES), ("Health", HEALTHS), ("Lies", LIES), ("Inits", MADE)]
)
def test_what_is_no_answer_is_told(name, told):
    for what, why in told.items():
        assert reason(play(name, what, LIMIT_S if why == LATE else None)) == why


def test_numbers_are_numbers(honest):
    """Whatever they are, they are scored as they are; so is what a thread scribbles into the shared memory."""
    for what in ("nan", "zero", "object", "none"):
        assert play("Returns", what).reason == ("non-finite or zero action at 0.5 s",)
    for what in ("huge", "tiny", "masked", "sub"):
        assert play("Returns", what).status[0] in ("ok", "diverged")
    for what in ("negative", "huge"):
        np.testing.assert_array_equal(play("Cov", what).history, honest.history)
    assert np.isposinf(play("Cov", "negative").nees).all()
    assert play("Races").status[0] in ("ok", "diverged")


def test_memory_has_a_limit(monkeypatch):
    monkeypatch.setenv("SINS_ENV_SOLVER_MEMORY_GB", "1.5")
    assert "MemoryError" in reason(play("Allocates"))
    monkeypatch.setenv("SINS_ENV_SOLVER_MEMORY_GB", "none")
    with pytest.raises(ValueError, match="SINS_ENV_SOLVER_MEMORY_GB='none'; allowed: a positive number of gigabytes"):
        play("Honest")


def test_output_is_bounded_and_goes_to_standard_error(capfd):
    play("Prints")
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("\\x1b[31mA\\u202e\nAAAA")
    assert "the solver's further output is left out" in err
    assert len(err) < 17_000


def test_who_hangs_again_and_again_is_given_up():
    """Three runs in succession; the others of its job are not played."""
    records = play("Sleeps", limit_s=0.1, runs=6)
    assert [why.startswith("step took longer than 0.1 s") for why in records.reason] == [True] * 3 + [False] * 3
    assert records.reason[3] == "not played: the 3 runs before it took too long"


def test_a_clock_that_stands_still_gains_nothing():
    found = evaluate(TINY, EVIL + "Slow", 1, workers=1)
    assert found.records.step_s[0] > 2.9e-3


def test_the_rows_of_others_are_the_same_bits(cli, tmp_path, monkeypatch):
    """In one evaluation; the exit code tells that a solver failed, and standard output has the table only."""
    monkeypatch.setitem(TASKS, TINY.name, TINY)
    evil = ["Raises", "OsExits", "Patches", "ForksAndLeaves", "Inits", "Prints"]
    codes = []
    for name, more in (("alone", []), ("among", [EVIL + one for one in evil])):
        line = ["eval", "--task", TINY.name, "--solver", *more, "ckf", EVIL + "Honest", "--runs", "3", "--workers", "1"]
        code, _, err = cli(*line, "--db", str(tmp_path / name))
        codes.append(code)
    assert codes == [0, 1]
    assert any("Inits on tiny-v0, run 0: solver 'evaluation.hostile.evil:Inits' cannot be made" in line for line in err)
    with Store(tmp_path / "alone", read_only=True) as alone, Store(tmp_path / "among", read_only=True) as among:
        kept, found = alone.keys(), among.keys()
        assert (len(kept), len(found)) == (2, 8)
        for key in kept:
            one, other = alone.results(key).records, among.results(key).records
            for field in dataclasses.fields(one):
                if field.name not in ("criteria", "step_s"):
                    np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))
        (failed,) = (among.results(key).records for key in found if key.solver == EVIL + "OsExits")
        assert failed.reason == ("step ended its process (exit code 0), at 0.5 s",) * 3


def test_every_verb_survives(cli, tmp_path, monkeypatch):
    """Import, listing, constructor and each call end another process, and the verb says so in one line."""
    monkeypatch.chdir(tmp_path)
    Path("leaves.py").write_text("import os; os._exit(9)")
    told = "make ended its process (exit code 9)"
    for verb in (("run", "sway-white-v0"), ("bench",)):
        code, out, err = cli(*verb, "leaves:X")
        assert (code, out) == (1, "")
        assert told in err[-1]
    code, _, (err,) = cli("check", "leaves:X")
    assert (code, err) == (1, "sins-env: leaves:X ended its process in the middle of the checks (exit code 9)")
    code, _, (err,) = cli("describe", "leaves:X")
    assert (code, err) == (
        2,
        "sins-env: solver 'leaves:X' cannot be described: describe ended its process (exit code 9)",
    )
    with pytest.raises(EstimatorError, match=re.escape(told)):
        run_episode(TINY, "leaves:X")
    with pytest.raises(EstimatorError, match=r"a call in the checks took longer than 0\.4 s"):
        check_estimator(EVIL + "Sleeps", epoch_timeout_s=LIMIT_S)
    assert finding.describe(EVIL + "Inits").settings == {"what": "'exit'"}


def test_a_seed_makes_the_process_unreadable():
    """Whether it comes by the command line or by a program; the kernel tells it."""
    control = ctypes.CDLL(None).prctl
    readable, set_readable = 3, 4  # linux/prctl.h: PR_GET_DUMPABLE, PR_SET_DUMPABLE
    for give in (lambda: seed("7"), lambda: evaluate(TINY, "ckf", 1, seed=7, cost=False, workers=1)):
        control(set_readable, 1, 0, 0, 0)
        try:
            give()
            assert control(readable, 0, 0, 0, 0) == 0
        finally:
            control(set_readable, 1, 0, 0, 0)


def test_a_folder_of_a_stranger_shadows_nothing_here(tmp_path, monkeypatch):
    """The current folder is searched for the stranger's module, in its process, and for nothing in this one."""
    monkeypatch.chdir(tmp_path)
    Path("jinja2.py").write_text("raise SystemExit('a stranger')")
    Path("theirs.py").write_text("from evaluation.hostile.evil import Honest")
    assert evaluate(TINY, "theirs:Honest", 1, cost=False, workers=1).records.status[0] in ("ok", "diverged")
    import jinja2

    assert str(tmp_path) not in jinja2.__file__


def test_a_prefix_runs_the_interpreter_of_solvers(monkeypatch, honest):
    """Another user, a container, no network: whatever command it is, standard input stays the way to the evaluation."""
    monkeypatch.setenv("SINS_ENV_SOLVER_PREFIX", "env SEEN=1")
    np.testing.assert_array_equal(play("Honest").history, honest.history)
    monkeypatch.setenv("SINS_ENV_SOLVER_PREFIX", "false")
    with pytest.raises(RuntimeError, match="SINS_ENV_SOLVER_PREFIX='false' does not run /"):
        play("Honest")


def test_why_solvers_cannot_start_is_told(monkeypatch, tmp_path):
    """A module on the search path that shadows one of the starter's."""
    (tmp_path / "threadpoolctl.py").write_text("raise ImportError('a shadow')")
    monkeypatch.setattr(child, "_starter", None)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(RuntimeError, match="the process that starts solvers cannot start: ImportError: a shadow"):
        play("Honest")


def test_a_child_is_made_anew_after_it_was_lost():
    child = Child("sins_env.evaluation.estimators.finding:Served")
    for _ in range(2):
        with pytest.raises(ValueError, match="No module named 'nowhere'"):
            child.call("describe", 10.0, "nowhere:X")
        child.close()
        assert not child.running
