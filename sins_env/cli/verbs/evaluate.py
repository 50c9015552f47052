"""The verb ``eval``: many runs of solvers on tasks, stored and ranked."""

from __future__ import annotations

from argparse import Namespace

import numpy as np
from rich.console import Console

from sins_env.cli.output import RunFailed, check_plot, remark, save_figure
from sins_env.evaluation.estimators import isolation
from sins_env.evaluation.play.cluster import ClusterError
from sins_env.evaluation.play.executors import check_executor
from sins_env.evaluation.show import error_figure, terminal_tables
from sins_env.evaluation.store.filling import Evaluation, fill
from sins_env.evaluation.store.key import canonical
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask


def _pairs(given: Namespace) -> list[tuple[EvaluationTask, str]]:
    """Return every pair of a task and a solver, each once; all names are checked before anything runs."""
    tasks = [get_task(name) for name in dict.fromkeys(given.task)]
    solvers = list(dict.fromkeys(given.solver))
    for solver in solvers:
        isolation.prove(solver, dict(given.set), given.timeout)
    for task in tasks:
        task.make(1).close()
        if task.max_runs is not None and given.runs > task.max_runs:
            remark(f"{task.name}: {task.max_runs} runs, the windows of its recording")
    return [(task, solver) for task in tasks for solver in solvers]


def evaluate(given: Namespace, console: Console) -> int:
    """Evaluate, store each chunk when it ends, and print the table.

    Raises:
        ValueError: an unknown name, or runs that the file has already without ``--resume``.
        RunFailed: a cluster elsewhere that fails; what it has done is kept.
    """
    check_plot(given.plot)
    check_executor(given.executor, given.workers)
    pairs, settings = _pairs(given), dict(given.set)
    canonical(settings)
    with Store(given.db) as store:
        wanted = [
            Evaluation.of(task, solver, settings, range(min(given.runs, task.max_runs or given.runs)), given.seed)
            for task, solver in pairs
        ]
        for task in {task.name: task for task, _ in pairs}.values():
            store.add_task(task)
        present = next((one for one in wanted if store.runs_of(one.key)), None)
        if present and not given.resume:
            raise ValueError(
                f"{given.db} holds {len(store.runs_of(present.key))} runs of {present.solver} on {present.task.name} already; "
                "they are kept: --resume adds what is missing, --db FILE begins another file"
            )
        try:
            fill(
                store,
                wanted,
                given.seed,
                timed=wanted,
                executor=given.executor,
                workers=given.workers,
                chunk=given.chunk,
                epoch_timeout_s=given.timeout,
                resume="--resume continues",
            )
        except ClusterError as error:
            raise RunFailed(str(error)) from error
        results = [store.results(one.key, range(given.runs)) for one in wanted]
    terminal_tables.print_tables(results, console)
    if given.plot:
        save_figure(error_figure.error_figure(results), given.plot)
    bad = [one for one in results if one.records.broken.any()]
    for one in bad:
        records = one.records
        i = int(np.argmax(records.broken))
        unmeasured = "; its cost was not measured" if one.summary.counts["lost"] and not one.cost else ""
        remark(f"{one.label} on {one.task.name}, run {records.run[i]}: {records.reason[i]}{unmeasured}")
    return 1 if bad else 0
