"""The same scores whatever the batch and the workers; a failure costs the run at fault and no other."""

import dataclasses
import math
import multiprocessing
import os
import re
import signal
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from evaluation import plugins

from sins_env import attitude
from sins_env.evaluation import Results, compare, evaluate, get_task, run_episode
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.monte_carlo import chunks
from sins_env.evaluation.play.pool import Processes
from sins_env.evaluation.play.records import Records

HERE = "evaluation.plugins:"


def run(task, name, runs=6, **settings):
    """In this process, without timing the step: a class that is handed over is no stranger's."""
    settings.setdefault("workers", 1)
    return evaluate(task, getattr(plugins, name), runs, cost=False, **settings)


def assert_same(a: Records, b: Records, rtol=1e-9, but=("step_s",)):
    for field in dataclasses.fields(Records):
        one, other = getattr(a, field.name), getattr(b, field.name)
        if field.name in ("criteria", *but):
            continue
        if isinstance(one, np.ndarray) and one.dtype.kind == "f":
            tolerance = max(rtol, 1e-6 if field.name == "history" and rtol else 0)
            np.testing.assert_allclose(one, other, rtol=tolerance, atol=0, err_msg=field.name)
        else:
            np.testing.assert_array_equal(one, other, err_msg=field.name)


def only(records, *runs):
    return Records.of_rows(records.criteria, [records.row(i) for i in runs])


@pytest.fixture
def healthy(short):
    return run(short, "DeadReckoning").records


def test_chunk_sizes_and_workers_give_the_same(short, healthy):
    assert_same(run(short, "DeadReckoning", chunk=1).records, healthy)
    assert_same(run(short, "DeadReckoning", chunk=4).records, healthy)
    two = run(short, "DeadReckoning", chunk=3, workers=2).records
    assert_same(two, healthy)
    assert_same(two, run(short, "DeadReckoning", chunk=3).records, rtol=0)
    with ThreadPoolExecutor(1) as executor:
        assert_same(run(short, "DeadReckoning", chunk=3, executor=executor).records, two, rtol=0)


def test_one_by_one_equals_batch(short, healthy):
    assert_same(run(short, "OneByOne").records, healthy, but=("step_s", "nees"))
    assert np.isnan(run(short, "OneByOne", 1).records.nees).all()


def test_each_run_has_its_own_stream(short):
    whole = run(short, "Noisy").records
    assert_same(run(short, "Noisy", chunk=4).records, whole)
    assert_same(run(short, "Noisy", [1, 4]).records, Records.of_rows(whole.criteria, [whole.row(1), whole.row(4)]))
    assert len(np.unique(whole.final[:, 0])) == 6


def test_runs_do_not_depend_on_how_many_there_are(short, healthy):
    first = run(short, "DeadReckoning", 2).records
    assert_same(first, only(healthy, 0, 1))
    other = run(short, "DeadReckoning", 2, seed=5).records
    assert not np.allclose(other.final, first.final)


def test_dead_reckoning_keeps_the_start_error(short, healthy):
    """The whole path: uncorrected, the error stays as drawn but for 20 s of earth rate along wrong axes."""
    env = short.make(6, reveal_truth=True)
    _, info = short.reset(env, range(6))
    drawn = attitude.misalignment(info["start"]["q_nb"], info["truth"]["q_nb"])
    np.testing.assert_allclose(healthy.final, drawn, atol=math.radians(0.06))
    sigma = np.radians([1.0, 1.0, 15.0])
    nees = np.square(drawn / sigma).sum(axis=1)
    np.testing.assert_allclose(healthy.nees[:, 0], nees, rtol=0.05, atol=0.05)


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("raise", "step raised ArithmeticError: no square root, at 0.5 s"),
        ("exit", "step raised SystemExit: 3, at 0.5 s"),
        ("shape", "step returned shape (1, 3); allowed: (1, 4), at 0.5 s"),
        ("text", "step returned a str; allowed: shape (1, 4), at 0.5 s"),
    ],
)
def test_raising_costs_one_run(short, healthy, start_of, how, reason):
    records = run(short, "At", settings={"q": start_of(2), "how": how}).records
    assert list(records.status) == ["ok", "ok", "raised", "ok", "ok", "ok"]
    assert records.reason[2] == reason
    if how == "raise":
        assert "ArithmeticError" in records.traceback[2]
        assert 'raise ArithmeticError("no square' in records.traceback[2]
    np.testing.assert_allclose(records.final[2], [math.pi / 2, math.pi, math.pi])
    others = [0, 1, 3, 4, 5]
    for name in ("final", "steady_rms", "nees", "heading"):
        np.testing.assert_allclose(getattr(records, name)[others], getattr(healthy, name)[others], rtol=1e-9)


def test_raising_one_by_one_costs_one_run(short, start_of):
    found = run(short, "At", settings={"q": start_of(2), "batched": False})
    assert list(found.records.status) == ["ok", "ok", "raised", "ok", "ok", "ok"]
    assert found.summary.counts["raised"] == found.summary.failures == 1
    assert found.summary.rms["U"] > 100_000  # in no mean is the run left out


def test_raising_always(short):
    assert set(run(short, "BadReset", 3).records.reason) == {"reset raised RuntimeError: no memory left, at 0.1 s"}


@pytest.mark.parametrize("how", ["nan", "zero"])
def test_no_attitude_is_a_failed_epoch(short, healthy, start_of, how):
    records = run(short, "At", settings={"q": start_of(2), "how": how}).records
    assert list(records.status) == ["ok", "ok", "diverged", "ok", "ok", "ok"]
    assert records.reason[2] == "non-finite or zero action at 0.5 s"
    np.testing.assert_array_equal(records.final[2], healthy.final[2])


def test_bad_covariance_and_health(short):
    assert run(short, "BadCovariance", 1).records.reason[0].startswith("covariance returned shape (4, 4)")
    found = run(short, "Ailing", 3)
    assert list(found.records.status) == ["ok", "ok", "frozen"]
    assert found.records.reason[2] == "the estimator gave up at 2.0 s"
    np.testing.assert_array_equal(found.records.repairs, [2, 0, 0])
    np.testing.assert_array_equal(found.records.fallbacks, [0, 5, 0])
    assert found.summary.counts["repaired"] == 1
    assert found.summary.failures == 2


def test_killed_worker_is_tried_again(short, healthy, tmp_path):
    marker = tmp_path / "marker"
    marker.touch()
    found = run(short, "DiesOnce", chunk=3, workers=2, settings={"marker": str(marker)})
    assert not marker.exists()
    assert_same(found.records, healthy)


def test_killed_twice_costs_its_chunk(short, healthy, start_of):
    settings = {"q": start_of(2), "how": "kill"}
    records = run(short, "At", chunk=2, workers=2, settings=settings).records
    assert list(records.status) == ["ok", "ok", "lost", "lost", "ok", "ok"]
    assert "died twice" in records.reason[2]
    np.testing.assert_allclose(records.final[[0, 1, 4, 5]], healthy.final[[0, 1, 4, 5]], rtol=1e-9)


def test_interruption_hands_over_what_is_done(short, start_of):
    parts = []
    settings = {"q": start_of(4), "how": "interrupt"}
    with pytest.raises(KeyboardInterrupt):
        run(short, "At", chunk=2, settings=settings, on_records=parts.append)
    assert [list(part.run) for part in parts] == [[0, 1], [2, 3]]


def test_progress_reaches_the_end(short):
    seen = []
    run(short, "DeadReckoning", chunk=2, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (pytest.approx(120.0), pytest.approx(120.0))
    assert len(seen) >= 6
    assert all(a[0] <= b[0] for a, b in pairwise(seen))
    seen.clear()
    run(
        short,
        "Slow",
        4,
        chunk=2,
        workers=2,
        progress=lambda done, total: seen.append(done),
        settings={"seconds": 4e-3},
    )
    assert any(0 < done < 80 for done in seen), "no progress within a chunk"


def test_workers_can_be_shared(short, healthy):
    with Processes(2) as pool:
        for _ in range(2):
            assert_same(run(short, "DeadReckoning", chunk=3, executor=pool).records, healthy)
        pids = [process.pid for process in multiprocessing.active_children()]
        assert len(pids) == 2
        status = [Path(f"/proc/{pid}/status") for pid in pids]
        for text in [path.read_text() for path in status if path.exists()]:  # from birth on they hear no Ctrl-C
            blocked = int(text.split("SigBlk:")[1].split()[0], 16)
            assert blocked >> (signal.SIGINT - 1) & 1
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_solver_as_a_class_and_cost(short):
    found = evaluate(short, plugins.DeadReckoning, 2, workers=1)
    assert isinstance(found, Results)
    assert found.solver == "evaluation.plugins:DeadReckoning"
    assert 0 < found.cost.median_us <= found.cost.p95_us
    assert repr(found) == "<Results of evaluation.plugins:DeadReckoning on short-v0: 2 runs>"
    assert evaluate(short, plugins.BadReset, 1, workers=1).cost is None


def test_cost_is_measured_in_a_worker_where_there_are_some(short):
    """It must not end this process; where a run was lost it is not measured at all."""
    with Processes(1) as processes:
        found = evaluate(short, plugins.TellsProcess, 1, executor=processes)
        assert found.cost.median_us > 0
        assert processes.call(os.getpid) != os.getpid()
        assert processes.call(os._exit, 3) is None
        assert isinstance(processes.call(os.getpid), int)  # a new worker
        gone = evaluate(short, plugins.At, 1, executor=processes, settings={"how": "leave"})
    assert gone.cost is None
    assert list(gone.records.status) == ["lost"]
    monte = evaluate(short, plugins.At, 1, executor=_LosesAll(), settings={"how": "leave"})  # would end pytest
    assert monte.cost is None


class _LosesAll:
    def run(self, jobs, progress):
        yield from ((job, None) for job in jobs)


def ended(process, within=5.0):
    """Whether a process ends in time; asked again and again, for the pool's own thread may be reaping it just now."""
    deadline = time.monotonic() + within
    while process.is_alive() and time.monotonic() < deadline:
        time.sleep(0.02)
    return not process.is_alive()


def test_close_ends_every_worker(short):
    processes = Processes(2)
    run(short, "DeadReckoning", 4, chunk=1, executor=processes)
    started = multiprocessing.active_children()
    assert len(started) == 2
    assert all(process.is_alive() for process in started)
    processes.close()
    assert all(ended(process) for process in started)


def test_close_ends_a_worker_that_is_stuck(short):
    processes = Processes(1)

    def stop(done, total):
        if multiprocessing.active_children():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(short, "Slow", 1, executor=processes, settings={"seconds": 60}, progress=stop)
    (started,) = multiprocessing.active_children()
    processes.close()
    assert ended(started)
    assert started.exitcode == -signal.SIGKILL  # by force, for it would sleep for a minute


def test_without_dask_one_clear_error(short, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match="executor 'dask' needs the package distributed: pip install distributed"):
        run(short, "DeadReckoning", 2, executor="dask", workers=2)


def test_numbers_of_any_kind(short, healthy):
    two = run(short, "DeadReckoning", np.int64(2), seed=np.int64(0)).records
    assert_same(two, only(healthy, 0, 1))
    assert_same(run(short, "DeadReckoning", np.array([3, 1, 3])).records, only(healthy, 1, 3))
    course = run_episode("short-v0", HERE + "DeadReckoning", run=np.int64(3))
    np.testing.assert_allclose(course.phi[-1], healthy.final[3], rtol=1e-9)
    for bad in (-1, 1.5, "1"):
        with pytest.raises(ValueError, match=re.escape(f"runs = [{bad!r}]")):
            run_episode("short-v0", HERE + "DeadReckoning", run=bad)
    with pytest.raises(ValueError, match="did you mean 'short-v0'"):
        run_episode("shrt-v0", HERE + "DeadReckoning")


def test_a_run_that_raised_has_no_heading(short, start_of):
    """Its last action is none at T; its time per epoch is that of the epochs it took."""
    found = run(short, "At", 3, settings={"q": start_of(1), "epoch": 51, "batched": False})
    np.testing.assert_array_equal(np.isnan(found.records.heading), [False, True, False])
    assert found.summary.spread_runs == 2
    assert found.summary.spread_deg > 0
    slow = run(short, "Slow", 1, settings={"seconds": 2e-3, "last": 50}).records
    assert slow.status[0] == "raised"
    assert slow.step_s[0] > 2e-3  # over all 200 epochs it would be a quarter


def test_a_module_that_cannot_be_imported_says_why(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "needs_more.py").write_text("import nosuchpkg\n")
    (tmp_path / "in_folder").mkdir()
    (tmp_path / "in_folder" / "__init__.py").write_text("import in_folder_too\n")
    for name, part in (
        ("needs_more:X", "importing needs_more failed with ModuleNotFoundError: No module named 'nosuchpkg'"),
        ("in_folder.a:X", "importing in_folder.a failed with ModuleNotFoundError: No module named 'in_folder_too'"),
        ("nosuchpkg.a:X", "No module named 'nosuchpkg'; allowed: module:Factory, importable from"),
        ("evaluation.nope:X", "No module named 'evaluation.nope'; allowed: module:Factory, importable from"),
    ):
        with pytest.raises(ValueError, match=re.escape(f"solver {name!r}: {part}")):
            finding.find(name)


def test_the_name_of_a_file_is_offered_as_a_module(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_filter.py").write_text("class Mine: ...\n")
    for name in ("my_filter", "my_filter.py", "./my_filter.py"):
        with pytest.raises(ValueError, match=r"is a module; allowed: my_filter:Factory"):
            finding.find(name)
    with pytest.raises(ValueError, match=r"did you mean 'my_filter:Mine'\?"):
        finding.find("my_filter.py:Mine")


def test_chunks():
    assert [len(part) for part in chunks(range(100))] == [50, 50]
    assert [len(part) for part in chunks(range(1000))] == [125] * 8
    assert [len(part) for part in chunks(range(5000))] == [250] * 20
    assert chunks([7]) == [(7,)]
    assert sum(chunks(range(11), 4), ()) == tuple(range(11))


def test_run_episode(short, healthy):
    course = run_episode(short, HERE + "DeadReckoning", run=3)
    np.testing.assert_allclose(course.phi[-1], healthy.final[3], rtol=1e-9)
    assert course.t[-1] == pytest.approx(20.0)
    np.testing.assert_allclose(course.sigma, np.broadcast_to(np.radians([1, 1, 15]), (200, 3)))
    raised = run_episode(short, HERE + "At", settings={"epoch": 7})
    assert raised.records.status[0] == "raised"
    assert len(raised.t) == 6


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"solver": "evaluation.plugins:DeadReckonin"}, "did you mean 'DeadReckoning'"),
        ({"solver": "evaluation.plugin:X"}, "No module named"),
        ({"solver": "dead_reckoning"}, "unknown solver 'dead_reckoning'"),
        ({"solver": HERE + "EARTH_RATE"}, "is a float"),
        ({"solver": HERE + "Nothing"}, "without batched, reset, step; allowed: batched = False"),
        ({"solver": HERE + "broken_factory"}, "cannot be made with no settings: ZeroDivisionError"),
        ({"settings": {"gian": 2}}, "cannot be made with settings {'gian': 2}"),
        (
            {"solver": HERE + "with_setting", "settings": {"gain": -1}},
            "with_setting' refuses settings {'gain': -1}: ValueError: gain = -1; allowed: not negative",
        ),
        ({"task": "sway-whit-v0"}, "did you mean 'sway-white-v0'"),
        ({"runs": 0}, "runs = 0"),
        ({"runs": [-1, 2]}, "runs = [-1, 2]; allowed: a whole number, at least 1, or the numbers of the runs"),
        ({"runs": []}, "runs = []; allowed"),
        ({"runs": 2.5}, "runs = 2.5; allowed"),
        ({"runs": [0.5]}, "runs = [0.5]; allowed"),
        ({"runs": "12"}, "runs = '12'; allowed"),
        ({"seed": "a"}, "seed of type str; allowed: a whole number"),
        ({"seed": 1.5}, "seed of type float; allowed: a whole number"),
        ({"chunk": 0}, "chunk = 0"),
        ({"workers": 0}, "workers = 0"),
        ({"executor": "proceses"}, "did you mean 'processes'"),
        ({"seed": -3}, "seed below 0; allowed: a whole number"),
    ],
)
def test_wrong_use_is_one_clear_error(short, changes, message):
    given = {"task": short, "solver": HERE + "DeadReckoning", "runs": 2, "workers": 1, **changes}
    with pytest.raises(ValueError, match=re.escape(message)):
        evaluate(given.pop("task"), given.pop("solver"), given.pop("runs"), **given)


def test_windows_limit_the_runs():
    with pytest.raises(ValueError, match="runs = 8 on rlg-car-v0; allowed: up to 7"):
        evaluate("rlg-car-v0", HERE + "DeadReckoning", 8)


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
def test_recording(recorded):
    """Run i is window i: the reference heading at its end differs from window to window."""
    task = dataclasses.replace(
        get_task("rlg-car-v0"),
        kwargs={**get_task("rlg-car-v0").kwargs, "window": [0.0, 12.0], "coarse": 5.0},
    )
    found = run(task, "DeadReckoning", 7, chunk=3)
    assert_same(run(task, "DeadReckoning", [2, 5]).records, only(found.records, 2, 5))
    assert np.isnan(found.records.nees).all()  # no NEES after an unknown start
    assert list(found.records.status) == ["diverged"] * 7  # 90 deg off
    env = task.make(7)
    _, info = task.reset(env, range(7))
    assert not info["start"]["known"].any()


def test_what_it_gives_is_one_short_line(short):
    mine, other = (evaluate(short, HERE + name, 3, workers=1, cost=False) for name in ("DeadReckoning", "Noisy"))
    raised = evaluate(short, HERE + "At", 3, workers=1, cost=False, settings={"epoch": 7}).records
    course = run_episode(short, HERE + "At", run=2, settings={"epoch": 7})
    shown = [repr(one) for one in (mine, mine.records, raised, mine.summary, mine.bound, compare(mine, other), course)]
    assert shown[1:3] == ["<Records of 3 runs: 3 ok>", "<Records of 3 runs: 3 raised>"]
    assert shown[3].startswith("<Summary of 3 runs: ")
    assert shown[4].startswith("<Bound: ")
    assert shown[5].startswith(f"<Comparison of {HERE}DeadReckoning with {HERE}Noisy on short-v0: 3 runs, values alone")
    assert shown[6] == "<Course of run 2: 6 epochs, step raised ArithmeticError: no square root, at 0.7 s>"
    for text in shown:
        assert "\n" not in text
        assert len(text) < 160
