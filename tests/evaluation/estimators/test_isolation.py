"""A solver that hangs or ends its process costs the runs at fault and nothing else, wherever the runs are played."""

import math
import multiprocessing
import os
import re
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from evaluation import plugins
from evaluation.test_monte_carlo import HERE, assert_same, run

from sins_env.evaluation import evaluate, run_episode
from sins_env.evaluation.play.pool import Processes

LONG = 60.0  #: s: no limit that a busy machine reaches
SHORT_S = 1.0  #: s: one that a solver which hangs does


@pytest.fixture(autouse=True)
def _none_is_left():
    """Whatever a test did, its processes have ended with it."""
    yield
    deadline = time.monotonic() + 5.0
    while (grandchildren() or multiprocessing.active_children()) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not grandchildren()
    assert not multiprocessing.active_children()


def grandchildren():
    """Processes of solvers, which are not children of this process but of the one that starts them."""
    return [two for one in children(os.getpid()) for two in children(one)]


def children(process):
    return Path(f"/proc/{process}/task/{process}/children").read_text().split()


@pytest.fixture
def healthy(short):
    return run(short, "DeadReckoning").records


def test_apart_changes_nothing(short):
    """The same bits: the observations, the task and the streams arrive as they are."""
    assert_same(run(short, "Noisy", epoch_timeout_s=math.inf).records, run(short, "Noisy").records, rtol=0)
    assert_same(evaluate(short, HERE + "Noisy", 6, workers=1, cost=False).records, run(short, "Noisy").records, rtol=0)
    assert_same(run(short, "OneByOne", 2, epoch_timeout_s=LONG).records, run(short, "OneByOne", 2).records, rtol=0)
    ailing = run(short, "Ailing", 3, epoch_timeout_s=LONG).records
    assert_same(ailing, run(short, "Ailing", 3).records, rtol=0)
    assert list(ailing.status) == ["ok", "ok", "frozen"]


def test_its_own_time_is_taken_there(short):
    """2 ms asleep each epoch for both runs together."""
    slow = run(short, "Slow", 2, settings={"seconds": 2e-3}, epoch_timeout_s=LONG).records
    assert (slow.step_s > 1e-3).all()
    reckoned = run(short, "DeadReckoning", 1, epoch_timeout_s=LONG).records
    assert reckoned.step_s[0] > 0


@pytest.mark.parametrize(("how", "batched"), [("stuck", True), ("hang", False)])
def test_a_run_that_hangs(short, healthy, start_of, how, batched):
    settings = {"q": start_of(1), "how": how, "batched": batched}
    records = run(short, "At", 3, settings=settings, epoch_timeout_s=SHORT_S).records
    assert list(records.status) == ["ok", "raised", "ok"]
    assert records.reason == ("", "step took longer than 1 s, at 0.5 s", "")
    np.testing.assert_allclose(records.final[1], [math.pi / 2, math.pi, math.pi])
    np.testing.assert_allclose(records.final[[0, 2]], healthy.final[[0, 2]], rtol=1e-9)


def test_the_limit_is_on_one_call_and_whoever_keeps_it_is_not_late(short, healthy):
    """200 epochs of 10 ms are longer than the limit of one."""
    slow = run(short, "Slow", 2, settings={"seconds": 0.01}, epoch_timeout_s=1.5).records
    np.testing.assert_allclose(slow.final, healthy.final[:2], rtol=1e-9)


def test_late_by_its_own_clock_though_it_answers(short):
    records = run(short, "Slow", 1, settings={"seconds": 0.3}, epoch_timeout_s=0.2).records
    assert records.reason == ("step took longer than 0.2 s, at 0.1 s",)


@pytest.mark.parametrize(
    ("how", "reason"),
    [("leave", "step ended its process (exit code 3)"), ("kill", "step ended its process (signal SIGKILL)")],
)
def test_a_run_that_ends_its_process(short, healthy, start_of, how, reason):
    settings = {"q": start_of(2), "how": how}
    records = run(short, "At", 4, settings=settings, epoch_timeout_s=math.inf).records
    assert list(records.status) == ["ok", "ok", "raised", "ok"]
    assert records.reason[2] == f"{reason}, at 0.5 s"
    others = [0, 1, 3]
    np.testing.assert_allclose(records.final[others], healthy.final[others], rtol=1e-9)


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("raise", "step raised ArithmeticError: no square root, at 0.5 s"),
        ("interrupt", "step raised KeyboardInterrupt, at 0.5 s"),
        ("text", "step returned a str; allowed: shape (1, 4), at 0.5 s"),
    ],
)
def test_what_it_raises_and_returns_is_told(short, start_of, how, reason):
    records = run(short, "At", 2, settings={"q": start_of(1), "how": how}, epoch_timeout_s=LONG).records
    assert list(records.status) == ["ok", "raised"]
    assert records.reason[1] == reason
    if how == "raise":
        assert 'raise ArithmeticError("no square' in records.traceback[1]


def test_reset_and_covariance_are_limited_too(short):
    for when in ("reset", "covariance", "health"):
        (reason,) = run(short, "HangsIn", 1, settings={"when": when}, epoch_timeout_s=SHORT_S).records.reason
        assert reason.startswith(f"{when} took longer than 1 s")


@pytest.mark.parametrize("where", ["threads", "processes"])
def test_wherever_the_runs_are_played(short, healthy, start_of, where):
    settings = {"q": start_of(1), "how": "hang"}
    given = {"chunk": 2, "settings": settings, "epoch_timeout_s": SHORT_S}
    with ThreadPoolExecutor(2) if where == "threads" else Processes(2) as executor:
        found = evaluate(short, HERE + "At", 4, executor=executor, cost=where == "processes", **given)
    assert list(found.records.status) == ["ok", "raised", "ok", "ok"]
    np.testing.assert_allclose(found.records.final[[0, 2, 3]], healthy.final[[0, 2, 3]], rtol=1e-9)
    assert (found.cost is not None) == (where == "processes")  # of run 0, which is well


def test_cost_of_a_solver_that_hangs_is_not_measured(short):
    assert evaluate(short, HERE + "At", 1, settings={"how": "hang"}, epoch_timeout_s=SHORT_S, workers=1).cost is None
    found = evaluate(short, HERE + "DeadReckoning", 1, epoch_timeout_s=LONG, workers=1)
    assert 0 < found.cost.median_us <= found.cost.p95_us


@pytest.mark.parametrize(("solver", "how", "limit"), [("DeadReckoning", {}, LONG), ("At", {"how": "stuck"}, SHORT_S)])
def test_an_episode_has_one_process_and_leaves_none(short, solver, how, limit):
    """Neither of a solver that is well, nor of one that hangs."""
    seen = []
    course = run_episode(
        short, HERE + solver, settings=how, epoch_timeout_s=limit,
        observer=lambda *epoch: seen.append(len(grandchildren())),
    )  # fmt: skip
    assert set(seen) == {1}
    assert course.records.reason == ("step took longer than 1 s, at 0.5 s" if how else "",)
    assert len(course.t) == (4 if how else 200)


@pytest.mark.parametrize("bad", [0, -1.0, math.nan, "1", True])
def test_wrong_limits(short, bad):
    with pytest.raises(ValueError, match=re.escape(f"epoch_timeout_s = {bad!r}; allowed: a positive number")):
        evaluate(short, HERE + "DeadReckoning", 1, epoch_timeout_s=bad)
    with pytest.raises(ValueError, match=re.escape(f"epoch_timeout_s = {bad!r}")):
        run_episode(short, HERE + "DeadReckoning", epoch_timeout_s=bad)


def test_what_cannot_be_sent_is_one_clear_error(short):
    class Local(plugins.DeadReckoning):
        pass

    with pytest.raises(ValueError, match="Local' cannot be sent"):
        evaluate(short, Local, 1, epoch_timeout_s=LONG, workers=1)
