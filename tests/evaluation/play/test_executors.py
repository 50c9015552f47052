"""Any executor gives the same table: Dask on a real cluster of two processes, threads and processes of the user's own."""

import os
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context

import numpy as np
import pytest
from evaluation import plugins
from evaluation.test_monte_carlo import HERE, assert_same, run
from threadpoolctl import threadpool_info, threadpool_limits

from sins_env.evaluation import evaluate
from sins_env.evaluation.play.cluster import dask_client
from sins_env.evaluation.show.plain_tables import as_csv

WAIT_S = 120.0


def threads():
    """Of every BLAS in this process."""
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.fixture
def healthy(short):
    return run(short, "DeadReckoning").records


@pytest.fixture(scope="module")
def client():
    pytest.importorskip("distributed")
    with dask_client(2) as client:
        yield client


@pytest.fixture
def dask(client):
    """Its two workers, both alive again after whatever the last test did to them."""
    client.wait_for_workers(2, timeout=WAIT_S)
    return client.get_executor()


def test_dask_gives_the_same_table(short, dask, healthy):
    seen = []
    given = {"chunk": 2, "cost": False}
    found = evaluate(short, HERE + "DeadReckoning", 6, executor=dask, progress=lambda *p: seen.append(p), **given)
    assert_same(found.records, healthy)
    assert as_csv([found]) == as_csv([run(short, "DeadReckoning", workers=1, chunk=2)])
    assert_same(run(short, "Noisy", chunk=4, executor=dask).records, run(short, "Noisy", chunk=4).records, rtol=0)
    assert_same(run(short, "OneByOne", executor=dask).records, run(short, "OneByOne").records, rtol=0)
    assert [done for done, _ in seen] == pytest.approx([40.0, 80.0, 120.0, 120.0])  # chunk by chunk
    assert dask.submit(os.getpid, pure=False).result() != os.getpid()  # still open


def test_dask_workers_have_one_blas_thread(short, client, dask):
    assert len(client.run(os.getpid)) == 2
    assert list(run(short, "CountsThreads", 4, chunk=1, executor=dask).records.status) == ["ok"] * 4


def test_a_chunk_that_kills_every_dask_worker(short, dask, healthy, start_of):
    settings = {"q": start_of(2), "how": "kill"}
    records = run(short, "At", chunk=2, executor=dask, settings=settings).records
    assert list(records.status) == ["ok", "ok", "lost", "lost", "ok", "ok"]
    assert "died twice" in records.reason[2]
    np.testing.assert_allclose(records.final[[0, 1, 4, 5]], healthy.final[[0, 1, 4, 5]], rtol=1e-9)


def test_a_limit_within_dask(short, dask, start_of):
    """Its workers are daemons, which may have no children unless one asks."""
    settings = {"q": start_of(0), "how": "hang"}
    records = run(short, "At", 2, chunk=1, executor=dask, settings=settings, epoch_timeout_s=1.0).records
    assert list(records.status) == ["raised", "ok"]


def test_executor_by_the_name_of_dask(short, healthy):
    """Its cluster is closed even after Ctrl-C, or pytest would say what has been left open."""
    pytest.importorskip("distributed")
    parts = []

    def interrupt(records):
        parts.append(records)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(short, "DeadReckoning", executor="dask", workers=1, on_records=interrupt)
    assert_same(parts[0], healthy)


def test_threads_and_processes_of_the_users_own(short, healthy):
    with ThreadPoolExecutor(2) as executor:
        for size in (1, 4):
            assert_same(run(short, "DeadReckoning", chunk=size, executor=executor).records, healthy)
        assert executor.submit(int).result() == 0  # not shut down
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        assert_same(run(short, "DeadReckoning", chunk=2, executor=executor).records, healthy)
        assert executor.submit(int).result() == 0


def test_a_pool_of_the_users_own_that_breaks(short, tmp_path):
    """It takes no more jobs; what had ended was handed over."""
    parts = []
    with (
        ProcessPoolExecutor(1, get_context("spawn")) as executor,
        pytest.raises(RuntimeError, match="the executor broke and takes no more jobs"),
    ):
        run(short, "KillsAfter", 3, chunk=1, executor=executor, settings={"folder": str(tmp_path), "runs": 1},
            on_records=parts.append)  # fmt: skip
    assert [list(part.run) for part in parts] == [[0]]


class Scripted(ThreadPoolExecutor):
    """Loses at once what holds a run of ``once``, the first time, or of ``always``. Remembers what it was asked."""

    def __init__(self, once, always):
        super().__init__(1)
        self.once, self.always, self.asked, self.others = once, always, [], []

    def submit(self, function, job, attempt):
        self.asked.append((job.runs, attempt, sum(not other.done() for other in self.others)))
        if set(job.runs) & ({*self.always, *self.once} if attempt == 1 else {*self.always}):
            future = Future()
            future.set_exception(BrokenProcessPool("gone"))
        else:
            future = super().submit(function, job, attempt)
        self.others.append(future)
        return future


def test_what_was_lost_is_run_again_when_all_else_has_ended(short, healthy):
    with Scripted(once=(0,), always=(3,)) as executor:
        records = run(short, "DeadReckoning", chunk=2, executor=executor).records
    assert list(records.status) == ["ok", "ok", "lost", "lost", "ok", "ok"]
    np.testing.assert_allclose(records.final[[0, 1, 4, 5]], healthy.final[[0, 1, 4, 5]], rtol=1e-9)
    again = [(runs, others) for runs, attempt, others in executor.asked if attempt == 2]
    assert sorted(again) == [((0, 1), 0), ((2, 3), 0)]
    assert len(executor.asked) == 5


def test_a_job_that_was_cancelled_behind_our_back(short):
    class Cancels(ThreadPoolExecutor):
        def submit(self, *_):
            future = Future()
            future.cancel()
            future.set_running_or_notify_cancel()
            return future

    with Cancels(1) as executor, pytest.raises(RuntimeError, match="the executor cancelled a job"):
        run(short, "DeadReckoning", 2, executor=executor)


def test_no_executor(short):
    for bad in (3, object(), ThreadPoolExecutor):
        with pytest.raises(
            ValueError, match=r"allowed: 'processes', 'dask', 'tcp://HOST:PORT', or a concurrent.futures.Executor"
        ):
            run(short, "DeadReckoning", 2, executor=bad)


def test_blas_threads_are_as_before_though_threads_overlap(short):
    """The limit belongs to the process: the first thread to end must not lift it for the others, nor the last keep it."""
    before = threads()
    with ThreadPoolExecutor(2) as executor:
        for _ in range(2):
            assert run(short, "CountsThreads", 4, chunk=1, executor=executor).records.reason == ("",) * 4
    assert threads() == before


def test_workers_have_one_blas_thread(short):
    assert list(run(short, "CountsThreads", 4, chunk=2, workers=2).records.status) == ["ok"] * 4
    assert list(run(short, "CountsThreads", 2).records.status) == ["ok"] * 2
    with threadpool_limits(2), pytest.raises(ArithmeticError, match="2 BLAS threads"):
        plugins.CountsThreads().step(None)
