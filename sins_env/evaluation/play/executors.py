"""Runners of jobs: this process, worker processes, or any ``concurrent.futures.Executor``.

A worker that dies costs only its job, which runs once more, alone. If that worker dies, too, the runs of the job are lost.
"""

from __future__ import annotations

import importlib
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager, nullcontext
from typing import Any, Protocol

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.checks import unknown
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.playing import run_job
from sins_env.evaluation.play.pool import Finished, Processes, Progress, available_cores
from sins_env.evaluation.play.records import Records
from sins_env.kernels.warming import ready

EXECUTORS = ("processes", "dask")


class Runner(Protocol):
    """A place where jobs run."""

    def run(self, jobs: Sequence[Job], progress: Progress) -> Iterator[Finished]:
        """Yield jobs with their records, in the order in which they end."""
        ...


class InProcess:
    """Runner in this process: one job after the other, with one BLAS thread."""

    def run(self, jobs: Sequence[Job], progress: Progress) -> Iterator[Finished]:
        before = 0

        def tick(count: int) -> None:
            progress(before + count)

        for job in jobs:
            with threadpool_limits(1):
                records = run_job(job, tick)
            before += len(job.runs) * records.criteria.num_epochs
            progress(before)
            yield job, records


class Borrowed:
    """Runner in any executor, which its owner closes; progress moves when jobs end.

    Jobs that ran when a worker died run again when all others have ended, one at a time, which shows the one at fault.
    """

    def __init__(self, executor: Executor) -> None:
        self.executor = executor

    def run(self, jobs: Sequence[Job], progress: Progress) -> Iterator[Finished]:
        with threadpool_limits(1):  # for threads, none of which may change what belongs to the whole process
            yield from self._run(jobs, progress)

    def _run(self, jobs: Sequence[Job], progress: Progress) -> Iterator[Finished]:
        running = {self._submit(job): (job, True) for job in jobs}  # True: a first attempt
        suspects: list[Job] = []
        total = 0
        try:
            while running or suspects:
                if not running:
                    job = suspects.pop()
                    running[self._submit(job, 2)] = (job, False)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    job, first = running.pop(future)
                    try:
                        records: Records | None = future.result()
                    except _worker_died():
                        if first:
                            suspects.append(job)
                            continue
                        records = None
                    except CancelledError as error:
                        raise RuntimeError("the executor cancelled a job that nobody asked it to cancel") from error
                    total += len(job.runs) * (records.criteria.num_epochs if records else 0)
                    progress(total)
                    yield job, records
        finally:
            for future in running:
                future.cancel()

    def _submit(self, job: Job, attempt: int = 1) -> Future[Records]:
        try:
            return self.executor.submit(_run_quietly, job, attempt, os.getpid())
        except BrokenExecutor as error:
            raise RuntimeError(f"the executor broke and takes no more jobs: {error}") from error


def _worker_died() -> tuple[type[BaseException], ...]:
    """Return the exceptions of a future whose worker died; Dask has one of its own."""
    distributed: Any = sys.modules.get("distributed")
    killed = getattr(distributed, "KilledWorker", None)
    return (BrokenExecutor, killed) if killed else (BrokenExecutor,)


def _run_quietly(job: Job, attempt: int, parent: int) -> Records:
    """Run a job with one BLAS thread. Another ``attempt`` is a new task to Dask, which remembers how the first ended."""
    with nullcontext() if os.getpid() == parent else threadpool_limits(1):
        return run_job(job)


def check_executor(name: str | None) -> None:
    """Check the name of an executor.

    Raises:
        ValueError: an unknown name; the error offers the nearest one.
    """
    if name is not None and name not in EXECUTORS:
        raise unknown("executor", name, EXECUTORS)


@contextmanager
def runner(executor: Executor | Runner | str | None, workers: int | None, jobs: int) -> Iterator[Runner]:
    """Yield the runner for a number of jobs; it is closed with the context, but a given executor stays open.

    Args:
        executor: a runner, an executor, "dask", "processes" or None. The last two make worker processes, but one worker
            or one job stays in this process.
        workers: number of processes; None takes one per core.
        jobs: number of jobs.

    Raises:
        ValueError: an unknown executor, or fewer than one worker.
    """
    if executor is not None and not isinstance(executor, str):
        if hasattr(executor, "run"):
            yield executor
        elif isinstance(executor, Executor):
            yield Borrowed(executor)
        else:
            allowed = "'processes', 'dask', or a concurrent.futures.Executor, such as Client.get_executor() of Dask"
            raise ValueError(f"executor = {executor!r}; allowed: {allowed}")
        return
    if workers is not None and workers < 1:
        raise ValueError(f"workers = {workers!r}; allowed: at least 1")
    check_executor(executor)
    workers = workers or available_cores()
    ready()  # before workers start, which would wait for each other
    if executor == "dask":
        with dask_client(workers) as client:
            yield Borrowed(client.get_executor())
    elif min(workers, jobs) > 1:
        with Processes(min(workers, jobs)) as processes:
            yield processes
    else:
        yield InProcess()


_DASK = {
    # The first death of a worker is ours to judge; Dask would try its task four times, and its neighbours with it.
    "distributed.scheduler.allowed-failures": 0,
    # A busy machine may take longer than 15 s to start a new worker, which Dask would then give up for good.
    "distributed.deploy.lost-worker-timeout": "1h",
}


@contextmanager
def dask_client(workers: int) -> Iterator[Any]:
    """Yield a client of a new Dask cluster on this machine, with one thread in each of its processes.

    Raises:
        ValueError: Dask is not installed.
    """
    try:
        dask: Any = importlib.import_module("dask")
        distributed: Any = importlib.import_module("distributed")
    except ImportError as error:
        raise ValueError("executor 'dask' needs the package distributed: pip install distributed") from error
    with (
        dask.config.set(_DASK),
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",  # any free port
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


__all__ = ["Borrowed", "InProcess", "Processes", "Runner", "available_cores", "check_executor", "runner"]
