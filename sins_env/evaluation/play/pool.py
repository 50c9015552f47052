"""Worker processes that play jobs. A job whose worker dies runs once more, alone; so does any other call, and the start."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from types import TracebackType
from typing import Any, TypeVar

from sins_env.evaluation.estimators.processes import CANNOT_START, interrupts_held, prepare
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.playing import run_job
from sins_env.evaluation.play.records import Records

T = TypeVar("T")
POLL_S = 0.1
ATTEMPTS = 2  #: number of times that work is tried whose worker dies: the second death is its own fault

#: A job with its records; None if its worker died twice.
Finished = tuple[Job, Records | None]
Progress = Callable[[float], None]  #: function called with the run-epochs done so far in all jobs


class _Spawn(SpawnContext):
    """Context that spawns processes and remembers them, so that they can be ended."""

    def __init__(self) -> None:
        self.started: list[SpawnProcess] = []

    def Process(self, *arguments: Any, **settings: Any) -> SpawnProcess:  # type: ignore[override]
        process = SpawnProcess(*arguments, **settings)
        self.started.append(process)
        return process


class Processes:
    """Runner in a pool of spawned worker processes with one BLAS thread each; it is a context manager."""

    def __init__(self, workers: int | None = None) -> None:
        if workers is not None and workers < 1:
            raise ValueError(f"workers = {workers!r}; allowed: at least 1")
        self.workers = workers or available_cores()
        resource_tracker.ensure_running()  # which unblocks Ctrl-C when it starts, for the workers after it too
        self._context = _Spawn()
        #: Run-epochs done by the job in each slot; the last element tells the workers to stop.
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
                process.join()
        self._pool = None

    def call(self, function: Callable[..., T], *arguments: Any) -> T | None:
        """Call a function in a worker and return its result; None if the worker dies twice.

        Raises:
            RuntimeError: worker processes cannot start.
        """
        for _ in range(ATTEMPTS):
            try:
                with interrupts_held():
                    future = self._ready_pool().submit(function, *arguments)
                return future.result()
            except BrokenExecutor:
                self._pool = None
        return None

    def run(self, jobs: Sequence[Job], progress: Progress) -> Iterator[Finished]:
        """Yield jobs with their records, in the order in which they end.

        Raises:
            RuntimeError: worker processes cannot start.
        """
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
        attempts = 0
        while self._pool is None:
            attempts += 1
            self._shared[self.workers] = 0
            self._context.started.clear()
            pool = ProcessPoolExecutor(self.workers, self._context, _init_worker, (self._shared,))
            try:
                pool.submit(os.getpid).result()
                self._pool = pool
            except BrokenExecutor as error:
                if attempts == ATTEMPTS:
                    raise RuntimeError(CANNOT_START) from error
        return self._pool


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Stopped(Exception):
    """Stop of a worker whose parent wants no more results."""


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
