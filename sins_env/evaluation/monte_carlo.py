"""Evaluation of one solver on one task: many runs, in chunks, with the same result wherever they run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from typing import Any

from sins_env.evaluation.estimators import finding, isolation
from sins_env.evaluation.estimators.processes import keep_secrets
from sins_env.evaluation.play.executors import Runner, runner
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.queue import Report, chunks, extent, played
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.show.drawn_results import DrawnResults as Results
from sins_env.evaluation.speed.cost import cost_of
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask, run_numbers, suite_hash
from sins_env.writing import notebook


def evaluate(
    task: str | EvaluationTask,
    solver: finding.Solver,
    runs: int | Iterable[int],
    seed: int | None = None,
    *,
    settings: Mapping[str, Any] | None = None,
    executor: Executor | Runner | str | None = None,
    workers: int | None = None,
    chunk: int | None = None,
    epoch_timeout_s: float | None = None,
    cost: bool = True,
    progress: Report | None = None,
    on_records: Callable[[Records], None] | None = None,
) -> Results:
    """Run a solver on a task and score it.

    Args:
        task: a task or its name.
        solver: a name, ``module:Factory``, or a class or function (at module level, for worker processes).
        runs: number of runs, or their numbers, which begin with 0.
        seed: seed of the suite; None takes that of the task. The hash of a secret seed may be published.
        settings: settings of the solver.
        executor: None or "processes" for worker processes, "dask" for a Dask cluster on this machine,
            ``"tcp://HOST:PORT"`` for the one of a scheduler that runs elsewhere, or any ``concurrent.futures.Executor``,
            which is left open (for Dask: ``Client.get_executor()``).
        workers: number of processes; None takes one per core, 1 stays in this process. Results do not depend on it.
        chunk: runs per batch, by default 64 to 256. Other sizes change results by rounding only (1e-9).
        epoch_timeout_s: longest time of one call of the solver, whatever the number of runs. A batch that takes longer
            is halved, and a run that takes longer alone has failed. With a limit the solver has a process of its own,
            which may hang or crash at the cost of the runs at fault only. None gives that to a stranger's solver, which is
            named as another package's or as ``module:Factory``, with 10 s, and 60 s for a first call. Infinity is no limit.
        cost: whether to measure the time of a step and its ratio to ckf; it is not measured if a run was lost.
        progress: function called with the simulated seconds done and with their total, summed over runs. Without one a notebook
            shows them.
        on_records: function called in this process with the records of each chunk when it ends. A KeyboardInterrupt
            does not undo it.

    Raises:
        ValueError, FileNotFoundError: names, settings or numbers that do not fit; nothing has run then.
        RuntimeError: worker processes cannot start, or (ClusterError) a cluster elsewhere fails.
    """
    task = get_task(task)
    wanted = run_numbers(runs)
    task.check_runs(wanted[-1] + 1)
    given = dict(settings or {})
    if seed is not None:
        keep_secrets()
    isolation.prove(solver, given, epoch_timeout_s)
    jobs = [Job(task, solver, part, given, seed, epoch_timeout_s) for part in chunks(wanted, chunk)]
    jobs[0].rngs()  # refuses a bad seed here rather than in a worker
    parts: list[Records] = []
    name = finding.solver_name(solver)
    shown = progress or notebook.line(f"{name} on {task.name}")
    with runner(executor, workers, len(jobs)) as where:
        for _, records in played(jobs, where, shown):
            parts.append(records)
            if on_records:
                on_records(records)
        together = Records.concat(parts)
        measured = cost_of(jobs[0], where) if cost and not (together.status == "lost").any() else None
    return Results(task, name, given, suite_hash(task, seed), together, measured)


__all__ = ["Report", "Results", "chunks", "evaluate", "extent"]
