"""Runners on machines and in executors of others: any ``concurrent.futures.Executor``, and Dask here or elsewhere.

A worker that dies costs only its job, which runs once more, alone. If that worker dies, too, the runs of the job are lost.
A cluster elsewhere was made by somebody else. Its workers are compared with this process before they get work, and each
compares itself once more before its first job, because workers may join at any time.
"""

from __future__ import annotations

import importlib
import ipaddress
import logging
import re
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from typing import Any

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.evaluation.estimators import finding, version
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.playing import run_job
from sins_env.evaluation.play.pool import Finished, Progress
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.kernels.warming import ready

CONNECT_S = 10.0  #: longest wait for the answer of a scheduler, s
NO_WORKERS_S = 60.0  #: longest time that jobs wait while a scheduler has no worker, s
POLL_S = 2.0  #: time between two looks at a scheduler while jobs run, s
_ADDRESS = re.compile(r"(?:tcp|tls)://(?:([a-z0-9][a-z0-9._-]*)|\[([^\]]*)\]):(\d{1,5})", re.ASCII | re.IGNORECASE)


class ClusterError(RuntimeError):
    """Error of a cluster elsewhere, in one line: it does not answer, is gone, or has another environment."""


def check_address(address: str) -> None:
    """Check the address of a Dask scheduler.

    Raises:
        ValueError: another protocol, no host, or no port from 1 to 65535.
    """
    found = _ADDRESS.fullmatch(address)
    fits = found is not None and 1 <= int(found[3]) <= 65535
    if fits and found and found[2] is not None:
        try:
            ipaddress.IPv6Address(found[2])
        except ValueError:
            fits = False
    if not fits:
        raise ValueError(
            f"executor {address!r}; allowed: tcp://HOST:PORT or tls://HOST:PORT of a Dask scheduler, port 1 to 65535"
        )


class Borrowed:
    """Runner in any executor, which its owner closes; progress moves when jobs end.

    Jobs that ran when a worker died run again when all others have ended, one at a time, which shows the one at fault.
    """

    def __init__(self, executor: Executor) -> None:
        self.executor = executor

    def run(self, jobs: Sequence[Job], progress: Progress) -> Iterator[Finished]:
        with _one_blas_thread:  # for threads of this process: the limit is set and lifted in one and the same
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
                for future in self._ended(running):
                    job, first = running.pop(future)
                    try:
                        records: Records | None = future.result()
                    except _worker_died():
                        if first:
                            suspects.append(job)
                            continue
                        records = None
                    except CancelledError as error:
                        raise self._cancelled() from error
                    total += len(job.runs) * (records.criteria.num_epochs if records else 0)
                    progress(total)
                    yield job, records
        finally:
            for future in running:
                future.cancel()

    def _submit(self, job: Job, attempt: int = 1) -> Future[Records]:
        try:
            return self.executor.submit(_run_quietly, job, attempt)
        except BrokenExecutor as error:
            raise RuntimeError(f"the executor broke and takes no more jobs: {error}") from error

    def _ended(self, running: Iterable[Future[Records]]) -> set[Future[Records]]:
        return wait(running, return_when=FIRST_COMPLETED).done

    def _cancelled(self) -> RuntimeError:
        return RuntimeError("the executor cancelled a job that nobody asked it to cancel")


class Elsewhere(Borrowed):
    """Runner on a Dask cluster that runs elsewhere, by a connected client."""

    def __init__(self, client: Any, address: str) -> None:
        super().__init__(client.get_executor())
        self.client, self.address = client, address
        self._needed: dict[int, dict[str, str]] = {}  #: what a worker must have, by the job

    def run(self, jobs: Sequence[Job], progress: Progress) -> Iterator[Finished]:
        """Yield jobs with their records, in the order in which they end.

        Raises:
            ClusterError: no workers, workers with another environment, or a scheduler that is gone.
            ValueError: a solver of a script, which workers cannot import.
        """
        self._compare(jobs)
        yield from super().run(jobs, progress)

    def _compare(self, jobs: Sequence[Job]) -> None:
        """Compare the environment of every worker with that of this process."""
        pairs = {(finding.solver_name(job.solver), job.task.name): job for job in jobs}
        for job in pairs.values():
            if getattr(job.solver, "__module__", "") == "__main__":
                raise ValueError(
                    f"{finding.solver_name(job.solver)}: workers of {self.address} cannot import a script; "
                    "allowed: a solver by name or module:Factory, from a module that they have"
                )
        wanted = {pair: environment(pair[0], job.task) for pair, job in pairs.items()}
        self._needed = {id(job): wanted[finding.solver_name(job.solver), job.task.name] for job in jobs}
        try:
            self.client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError as error:
            raise self._without_workers(CONNECT_S) from error
        asked = [(solver, pairs[solver, task].task) for solver, task in pairs]
        try:
            answers = self.client.run(_environments, asked, on_error="return")
        except OSError as error:
            raise self._cancelled() from error
        found = {worker: has for worker, has in answers.items() if not isinstance(has, OSError)}  # the others are gone
        told = [text for worker, has in found.items() if (text := _difference(worker, has, list(wanted.values())))]
        if told:
            more = f" ({len(told)} of {len(found)} workers differ)" if len(told) > 1 else ""
            raise ClusterError(f"{self.address}: {told[0]}{more}; install the same there and restart the workers")

    def _submit(self, job: Job, attempt: int = 1) -> Future[Records]:
        return self.executor.submit(_run_elsewhere, job, attempt, self._needed[id(job)])

    def _ended(self, running: Iterable[Future[Records]]) -> set[Future[Records]]:
        """Return the futures that have ended; look meanwhile whether the scheduler still answers and has workers."""
        seen = time.monotonic()
        while True:
            if done := wait(running, POLL_S, FIRST_COMPLETED).done:
                return done
            try:
                workers = self.client.sync(self.client.scheduler.ncores, workers=None, callback_timeout=CONNECT_S)
            except Exception as error:  # whatever its connection makes of it
                raise self._cancelled() from error
            seen = time.monotonic() if workers else seen
            if time.monotonic() - seen > NO_WORKERS_S:
                raise self._without_workers(NO_WORKERS_S)

    def _cancelled(self) -> RuntimeError:
        return ClusterError(f"{self.address}: the scheduler is gone")

    def _without_workers(self, seconds: float) -> ClusterError:
        return ClusterError(
            f"{self.address}: no worker for {seconds:.0f} s; dask worker {self.address} --nthreads 1 starts one"
        )


def environment(solver: str, task: EvaluationTask) -> dict[str, str]:
    """Return what decides the scores of a solver on a task: versions of packages and code, and the digest of the world.

    What cannot be found out is told in words.
    """
    found = version.packages(version.COMPUTING)
    for name, ask in (
        (f"code of {solver}", lambda: version.code_version(solver)),
        (f"world of {task.name}", lambda: digest(task)),
    ):
        try:
            found[name] = ask()
        except (ValueError, OSError) as error:
            found[name] = f"none ({error})"
    return found


_environments_here: dict[tuple[str, str], dict[str, str]] = {}


def _environment_here(solver: str, task: EvaluationTask) -> dict[str, str]:
    """Return the environment of a worker when it was first asked: code that has changed since is not what it runs."""
    key = solver, repr(task)
    if key not in _environments_here:
        _environments_here[key] = environment(solver, task)
    return _environments_here[key]


def _environments(asked: Sequence[tuple[str, EvaluationTask]]) -> list[dict[str, str]]:
    return [_environment_here(solver, task) for solver, task in asked]


def _difference(worker: str, has: Any, needed: Sequence[Mapping[str, str]]) -> str:
    """Return how the environment of a worker differs from the one needed; empty if it does not."""
    if isinstance(has, BaseException):
        return f"worker {worker} cannot run sins_env ({type(has).__name__}: {has})"
    for there, here in zip(has, needed, strict=True):
        for name, wanted in here.items():
            if there.get(name) != wanted:
                return f"worker {worker} has {name} {there.get(name, 'not at all')}, needed {wanted}"
    return ""


def _run_elsewhere(job: Job, attempt: int, needed: Mapping[str, str]) -> Records:
    """Run a job on a worker with the environment that is ``needed``.

    Raises:
        ClusterError: the worker has another one.
    """
    distributed: Any = importlib.import_module("distributed")
    has = _environment_here(finding.solver_name(job.solver), job.task)
    if text := _difference(distributed.get_worker().address, [has], [needed]):
        raise ClusterError(f"{text}; install the same there and restart the worker")
    if not finding.is_foreign(job.solver):
        finding.find(job.solver)  # imports its kernels
    ready()
    return _run_quietly(job, attempt)


def _worker_died() -> tuple[type[BaseException], ...]:
    """Return the exceptions of a future whose worker died; Dask has one of its own."""
    distributed: Any = sys.modules.get("distributed")
    killed = getattr(distributed, "KilledWorker", None)
    return (BrokenExecutor, killed) if killed else (BrokenExecutor,)


def _run_quietly(job: Job, attempt: int) -> Records:
    """Run a job with one BLAS thread. Another ``attempt`` is a new task to Dask, which remembers how the first ended."""
    with _one_blas_thread:
        return run_job(job)


class _OneBlasThread:
    """Limit of BLAS to one thread in this process, from the first job that begins to the last that ends.

    The limit belongs to the process, but several threads of it may run jobs at once.
    """

    def __init__(self) -> None:
        self._lock, self._inside, self._limits = threading.Lock(), 0, None

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._limits = threadpool_limits(1)
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside and self._limits is not None:
                self._limits.restore_original_limits()


_one_blas_thread = _OneBlasThread()

_DASK = {
    # The first death of a worker is ours to judge; Dask would try its task four times, and its neighbours with it.
    "distributed.scheduler.allowed-failures": 0,
    # A busy machine may take longer than 15 s to start a new worker, which Dask would then give up for good.
    "distributed.deploy.lost-worker-timeout": "1h",
}


def _distributed(executor: str) -> Any:
    """Import and return the package distributed.

    Raises:
        ValueError: it is not installed.
    """
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise ValueError(f"executor {executor!r} needs the package distributed: pip install distributed") from error


@contextmanager
def dask_client(workers: int) -> Iterator[Any]:
    """Yield a client of a new Dask cluster on this machine, with one thread in each of its processes.

    Raises:
        ValueError: Dask is not installed.
    """
    distributed = _distributed("dask")
    dask: Any = importlib.import_module("dask")
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


@contextmanager
def elsewhere(address: str) -> Iterator[Elsewhere]:
    """Yield the runner on the Dask cluster whose scheduler has this address; the cluster goes on when the context ends.

    Raises:
        ValueError: Dask is not installed.
        ClusterError: no scheduler answers.
    """
    distributed = _distributed(address)
    log = logging.getLogger("distributed")
    level = log.level
    log.setLevel(logging.CRITICAL)  # the error says what it would say, in one line
    try:
        try:
            client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except Exception as error:  # of its connection, or of the certificates in Dask's configuration
            raise ClusterError(f"{address}: no Dask scheduler answers ({error})") from error
        try:
            yield Elsewhere(client, address)
        finally:
            client.close(timeout=CONNECT_S)
    finally:
        log.setLevel(level)
