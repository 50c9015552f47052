"""Worker processes: whatever dies with its worker is tried once more."""

import os
import signal
import subprocess
import sys
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor

import pytest
from places import ROOT

from sins_env.evaluation.play import pool
from sins_env.evaluation.play.pool import Processes


def dies_at(marker, times):
    """Kill this process so many times, which files beside the marker count; then return how often it was called."""
    before = len(os.listdir(marker))
    open(os.path.join(marker, str(before)), "w").close()
    if before < times:
        os.kill(os.getpid(), signal.SIGKILL)
    return before + 1


class Threads(ThreadPoolExecutor):
    """A pool in this process; the first ``broken`` ones that are made cannot start."""

    broken = 0

    def __init__(self, workers, context, start, given):
        super().__init__(workers)

    def submit(self, function, *arguments):
        if type(self).broken:
            type(self).broken -= 1
            future = Future()
            future.set_exception(BrokenExecutor("no memory"))
            return future
        if function is not dies_at:
            return super().submit(function, *arguments)
        raise BrokenExecutor("gone")


def test_a_call_whose_worker_dies_once_is_made_again(tmp_path):
    with Processes(1) as where:
        assert where.call(dies_at, str(tmp_path), 1) == 2


HELD = """
import signal
from sins_env.evaluation.play.pool import Processes
if __name__ == "__main__":
    with Processes(1) as where:
        print(signal.SIGINT in where.call(signal.pthread_sigmask, signal.SIG_BLOCK, []))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no signal masks")
def test_a_worker_never_hears_ctrl_c(tmp_path):
    """In a fresh process, where the resource tracker of multiprocessing does not run yet."""
    (tmp_path / "held.py").write_text(HELD)
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "held.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert (done.stdout, done.stderr) == ("True\n", "")


def test_a_call_whose_worker_dies_twice_has_no_result(tmp_path, monkeypatch):
    monkeypatch.setattr(pool, "ProcessPoolExecutor", Threads)
    with Processes(1) as where:
        assert where.call(dies_at, str(tmp_path), 0) is None
        assert where.call(len, "abc") == 3


@pytest.mark.parametrize("broken", [1, 2])
def test_a_worker_that_dies_at_its_start_is_started_again(monkeypatch, broken):
    monkeypatch.setattr(pool, "ProcessPoolExecutor", Threads)
    monkeypatch.setattr(Threads, "broken", broken)
    with Processes(1) as where:
        if broken == 1:
            assert where.call(len, "abc") == 3
        else:
            with pytest.raises(RuntimeError, match="cannot start"):
                where.call(len, "abc")
