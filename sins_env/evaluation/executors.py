"""Where jobs run: in this process, in worker processes, or in any ``concurrent.futures.Executor``.

A worker that dies costs only its job, which is run again once, alone; the second time it is handed back as
lost.
"""

from __future__ import annotations

import importlib
import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager, nullcontext
from multiprocessing.context import SpawnContext, SpawnProcess
from types import TracebackType
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.errors import unknown
from sins_env.evaluation.episode import Job, run_job
from sins_env.evaluation.records import Records
from sins_env.evaluation.spawning import CANNOT_START, interrupts_held, prepare

T = TypeVar("T")
POLL_S = 0.1
EXECUTORS = ("processes", "dask")
#: A job and what came of it; None: its worker died twice.
Finished = tuple[Job, Records | None]
Progress = Callable[[float], None]  #: run-epochs done so far, of all jobs


class Runner(Protocol):
    def run(self, jobs: Sequence[Job], progress: Progress) -> Iterator[Finished]:
        """Jobs with their records, in the order in which they end."""
        ...


class InProcess:
    """One job after the other, with one BLAS thread."""

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
    """Any executor, which whoever made it closes; progress moves as jobs end.

    What ran when a worker died is tried again when all else has ended, one job at a time: the next death names its cause.
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
    """What a future raises if its worker died; Dask has an exception of its own."""
    distributed: Any = sys.modules.get("distributed")
    killed = getattr(distributed, "KilledWorker", None)
    return (BrokenExecutor, killed) if killed else (BrokenExecutor,)


def _run_quietly(job: Job, attempt: int, parent: int) -> Records:
    """``attempt`` makes a job that is run again another task to Dask, which remembers how the first one ended."""
    with nullcontext() if os.getpid() == parent else threadpool_limits(1):
        return run_job(job)


class _Spawn(SpawnContext):
    """Spawns processes, and remembers which, so that they can be ended."""

    def __init__(self) -> None:
        self.started: list[SpawnProcess] = []

    def Process(self, *arguments: Any, **settings: Any) -> SpawnProcess:  # type: ignore[override]
        process = SpawnProcess(*arguments, **settings)
        self.started.append(process)
        return process


class Processes:
    """A pool of worker processes (spawned), one BLAS thread each; a context manager."""

    def __init__(self, workers: int | None = None) -> None:
        if workers is not None and workers < 1:
            raise ValueError(f"workers = {workers!r}; allowed: at least 1")
        self.workers = workers or available_cores()
        self._context = _Spawn()
        #: run-epochs done by the job in each slot; the last element tells the workers to stop
        self._shared = self._context.RawArray("q", self.workers + 1)
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Processes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop the workers: at their next block of epochs, or by force after two seconds."""
        if self._pool is None:
            return
        self._shared[self.workers] = 1
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in self._context.started:
            process.join(2.0)
            if process.is_alive():
                process.kill()
        self._pool = None

    def call(self, function: Callable[..., T], *arguments: Any) -> T | None:
        """What a function gives in a worker; None if the worker dies of it."""
        try:
            with interrupts_held():
                future = self._ready_pool().submit(function, *arguments)
            return future.result()
        except BrokenExecutor:
            self._pool = None
            return None

    def run(self, jobs: Sequence[Job], progress: Progress) -> Iterator[Finished]:
        waiting = [(job, True) for job in reversed(jobs)]  # a stack; True: a first attempt
        suspects: list[tuple[Job, bool]] = []
        running: dict[Future[Records], tuple[Job, bool, int]] = {}
        finished = 0.0
        while waiting or suspects or running:
            # What ran when a worker died is tried again alone: the next death names its cause.
            limit = self.workers if waiting or any(first for _, first, _ in running.values()) else 1
            source = waiting or suspects
            while source and len(running) < limit:
                job, first = source.pop()
                slot = min(set(range(self.workers)) - {taken for _, _, taken in running.values()})
                self._shared[slot] = 0
                try:
                    with interrupts_held():
                        running[self._ready_pool().submit(_in_worker, job, slot)] = (job, first, slot)
                except BrokenExecutor:
                    source.append((job, first))
                    break
            for future in wait(running, timeout=POLL_S, return_when=FIRST_COMPLETED).done:
                job, first, slot = running.pop(future)
                try:
                    records = future.result()
                except BrokenExecutor:
                    self._pool = None
                    if first:
                        suspects.append((job, False))
                        continue
                    yield job, None
                    continue
                finished += len(job.runs) * records.criteria.num_epochs
                yield job, records
            progress(finished + sum(self._shared[slot] for _, _, slot in running.values()))

    def _ready_pool(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._shared[self.workers] = 0
            self._context.started.clear()
            pool = ProcessPoolExecutor(self.workers, self._context, _init_worker, (self._shared,))
            try:
                pool.submit(os.getpid).result()
            except BrokenExecutor as error:
                raise RuntimeError(CANNOT_START) from error
            self._pool = pool
        return self._pool


def available_cores() -> int:
    """The cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Stopped(Exception):
    """The parent wants no more results."""


_shared: Any = None


def _init_worker(shared: Any) -> None:
    global _shared
    _shared = shared
    prepare()


def _in_worker(job: Job, slot: int) -> Records:
    def tick(count: int) -> None:
        _shared[slot] = count
        if _shared[len(_shared) - 1]:
            raise _Stopped

    return run_job(job, tick)


def check_executor(name: str | None) -> None:
    """Raises ValueError for a name that is none; the nearest is offered."""
    if name is not None and name not in EXECUTORS:
        raise unknown("executor", name, EXECUTORS)


@contextmanager
def runner(
    executor: Executor | Runner | str | None, workers: int | None, jobs: int, apart: bool = False
) -> Iterator[Runner]:
    """The runner for ``jobs`` jobs: what is given, or processes; one worker or one job stays in this one.

    What is made here is closed in the end; what was given stays open.

    Args:
        apart: a worker process even for one: this one outlives whatever a solver does to its process.

    Raises:
        ValueError: no executor, or fewer than one worker.
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
    if executor == "dask":
        with dask_client(workers) as client:
            yield Borrowed(client.get_executor())
    elif min(workers, jobs) > 1 or apart:
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
    """A client of a cluster of its own on this machine: one thread in each of its processes.

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
