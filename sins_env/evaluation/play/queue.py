"""Queue of jobs of many runs, which the workers share whatever the task or the solver."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

from sins_env.evaluation.play.executors import Runner
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.playing import lost_records
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.tasks.task import EvaluationTask

#: Function called with the simulated seconds done and with their total, summed over runs.
Report = Callable[[float, float], None]

CHUNK_LEAST, CHUNK_MOST = 64, 256  #: least and most runs of a chunk by default
DIED = "its worker process died twice (out of memory, or a crash)"


def chunks(runs: Sequence[int], size: int | None = None) -> list[tuple[int, ...]]:
    """Return the runs in even chunks of at most ``size``, by default 64 to 256, whatever the number of workers.

    Raises:
        ValueError: a size below one.
    """
    if size is not None and size < 1:
        raise ValueError(f"chunk = {size!r}; allowed: at least 1")
    size = size or min(max(math.ceil(len(runs) / 8), CHUNK_LEAST), CHUNK_MOST)
    count = math.ceil(len(runs) / size)
    edges = [round(i * len(runs) / count) for i in range(count + 1)]
    return [tuple(runs[a:b]) for a, b in pairwise(edges)]


def extent(task: EvaluationTask, runs: int) -> tuple[float, float]:
    """Return the length of an epoch and of all runs together, s."""
    env = task.make(1)
    public = env.unwrapped.task  # type: ignore[attr-defined]
    env.close()
    return public.epoch_s, runs * public.num_epochs * public.epoch_s


def played(jobs: Sequence[Job], where: Runner, report: Report | None = None) -> Iterator[tuple[Job, Records]]:
    """Yield jobs with their records, in the order in which they end; the runs of a job whose worker died twice are lost."""
    runs: dict[str, tuple[EvaluationTask, int]] = {}
    for job in jobs:
        runs[job.task.name] = job.task, runs.get(job.task.name, (job.task, 0))[1] + len(job.runs)
    extents = [extent(task, count) for task, count in runs.values()]
    total_s, epochs = sum(s for _, s in extents), sum(s / epoch_s for epoch_s, s in extents)

    def tell(done: float) -> None:
        if report:
            report(min(done / max(epochs, 1.0), 1.0) * total_s, total_s)

    for job, found in where.run(jobs, tell):
        yield job, found or lost_records(job, DIED)
    tell(epochs)
