"""Runners of jobs: this process, worker processes, any ``concurrent.futures.Executor``, or a Dask cluster here or elsewhere.

A worker that dies costs only its job, which runs once more, alone. If that worker dies, too, the runs of the job are lost.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Protocol

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.checks import unknown
from sins_env.evaluation.play.cluster import Borrowed, check_address, dask_client, elsewhere
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.playing import run_job
from sins_env.evaluation.play.pool import Finished, Processes, Progress, available_cores
from sins_env.kernels.warming import ready

EXECUTORS = ("processes", "dask")
ADDRESS = "tcp://HOST:PORT"  #: form of the address of a Dask scheduler that runs elsewhere


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


def check_executor(name: str | None, workers: int | None = None) -> None:
    """Check the name of an executor, or the address of a Dask scheduler, and the number of workers beside it.

    Raises:
        ValueError: an unknown name, of which the error offers the nearest one; an address that is none; or a number of
            workers for a cluster that has its own.
    """
    if name is None or name in EXECUTORS:
        return
    if "://" not in name:
        raise unknown("executor", name, (*EXECUTORS, ADDRESS))
    check_address(name)
    if workers is not None:
        raise ValueError(f"workers = {workers!r} with executor {name!r}; allowed: none, its cluster has its own")


@contextmanager
def runner(executor: Executor | Runner | str | None, workers: int | None, jobs: int) -> Iterator[Runner]:
    """Yield the runner for a number of jobs; it is closed with the context, but a given executor stays open.

    Args:
        executor: a runner, an executor, the address of a Dask scheduler that runs elsewhere, "dask", "processes" or None.
            The last two make worker processes, but one worker or one job stays in this process.
        workers: number of processes; None takes one per core.
        jobs: number of jobs.

    Raises:
        ValueError: an unknown executor, or fewer than one worker.
        ClusterError: no scheduler answers at the address.
    """
    if executor is not None and not isinstance(executor, str):
        if hasattr(executor, "run"):
            yield executor
        elif isinstance(executor, Executor):
            yield Borrowed(executor)
        else:
            allowed = f"'processes', 'dask', '{ADDRESS}', or a concurrent.futures.Executor, such as Client.get_executor() of Dask"
            raise ValueError(f"executor = {executor!r}; allowed: {allowed}")
        return
    if workers is not None and workers < 1:
        raise ValueError(f"workers = {workers!r}; allowed: at least 1")
    check_executor(executor, workers)
    workers = workers or available_cores()
    ready()  # before workers start, which would wait for each other
    if executor and executor not in EXECUTORS:
        with elsewhere(executor) as there:
            yield there
    elif executor == "dask":
        with dask_client(workers) as client:
            yield Borrowed(client.get_executor())
    elif min(workers, jobs) > 1:
        with Processes(min(workers, jobs)) as processes:
            yield processes
    else:
        yield InProcess()


__all__ = ["Borrowed", "InProcess", "Processes", "Runner", "available_cores", "check_executor", "runner"]
