"""Play of one run with its errors at every epoch, for figures and examples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.play.criteria import PHI
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.playing import Observer, play
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask, run_numbers
from sins_env.states import answered


@dataclass(frozen=True, repr=False)
class Course:
    """Errors of one run at every epoch."""

    records: Records
    t: NDArray[np.floating[Any]]  #: (K,) time of each epoch, s
    errors: Array  #: (K, 3) rad, or (K, 9) rad, m/s and m; NaN for a recording without a reference
    sigma: Array  #: standard deviations that the estimator reports, in the shape of ``errors``; NaN if it does not

    @property
    def phi(self) -> Array:
        """Misalignment E, N, U, (K, 3) rad."""
        return self.errors[:, PHI]

    def __repr__(self) -> str:
        records = self.records
        return f"<Course of run {records.run[0]}: {len(self.t)} epochs, {records.reason[0] or records.status[0]}>"


def run_episode(
    task: str | EvaluationTask,
    solver: finding.Solver,
    run: int = 0,
    seed: int | None = None,
    *,
    settings: dict[str, Any] | None = None,
    observer: Observer | None = None,
    epoch_timeout_s: float | None = None,
) -> Course:
    """Play one run of the task's suite (or of the suite of ``seed``) and keep its errors at every epoch.

    Args:
        task: a task or its name.
        solver: a name, ``module:Factory``, or a class or function.
        run: number of the run, from 0 on.
        seed: seed of the suite; None takes that of the task.
        settings: settings of the solver.
        observer: function called after each epoch.
        epoch_timeout_s: longest time of one call, as in ``evaluate``. Infinity gives the solver a process of its own
            without a limit.

    Raises:
        ValueError, FileNotFoundError: a task, a run, settings or a solver that do not fit.
        EstimatorError: a stranger's solver cannot be made.
    """
    task = get_task(task)
    (run,) = run_numbers([run])
    task.check_runs(run + 1)
    kept: list[Array] = []
    sigmas: list[Array] = []

    def keep(k: int, errors: Array, sigma: Array | None) -> None:
        kept.append(errors[0])
        sigmas.append(np.full(errors.shape[1], np.nan) if sigma is None else sigma[0])
        if observer:
            observer(k, errors, sigma)

    job = Job(task, solver, (run,), dict(settings or {}), seed, epoch_timeout_s)
    with job.host() as host:
        records = play(job, host, observer=keep)
    t, width = (1 + np.arange(len(kept))) * records.criteria.epoch_s, answered(records.criteria.navigates).size
    return Course(records, t, np.array(kept).reshape(-1, width), np.array(sigmas).reshape(-1, width))
