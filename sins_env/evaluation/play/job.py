"""A job: some runs of one solver on one task, small enough to be sent to a worker."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.isolation import Host, hosted
from sins_env.evaluation.tasks.task import EvaluationTask, solver_rng


@dataclass(frozen=True)
class Job:
    """Some runs of one solver on one task: all that a worker needs, picklable."""

    task: EvaluationTask
    solver: finding.Solver
    runs: tuple[int, ...]
    settings: dict[str, Any] = field(default_factory=dict)
    suite_seed: int | None = None
    #: s that one call of the estimator may take; it then has a process of its own, as it has at infinity. None: neither
    epoch_timeout_s: float | None = None

    def host(self) -> AbstractContextManager[Host]:
        """The solver, ready to play; its process, if it has one, ends with the context."""
        return hosted(self.solver, self.settings, self.epoch_timeout_s)

    def rngs(self) -> list[np.random.Generator]:
        """The solver's own random numbers, one generator for each run."""
        name = finding.solver_name(self.solver)
        return [solver_rng(self.task, name, run, self.suite_seed) for run in self.runs]
