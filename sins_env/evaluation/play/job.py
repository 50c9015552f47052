"""A job for a worker: some runs of one solver on one task."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.isolation import Host, hosted
from sins_env.evaluation.estimators.processes import keep_secrets
from sins_env.evaluation.tasks.task import EvaluationTask, solver_rng


@dataclass(frozen=True)
class Job:
    """Some runs of one solver on one task, with everything that a worker needs; it can be pickled."""

    task: EvaluationTask
    solver: finding.Solver
    runs: tuple[int, ...]
    settings: dict[str, Any] = field(default_factory=dict)
    suite_seed: int | None = None
    #: Longest time of one call of the estimator, s. With a limit, even an infinite one, it has a process of its own; None
    #: gives that to a stranger's only, with the usual limits.
    epoch_timeout_s: float | None = None

    def host(self) -> AbstractContextManager[Host]:
        """Return a context with the solver ready to play; its process, if it has one, ends with the context.

        Raises:
            ValueError: no such solver, settings that it refuses, or a limit that is not positive.
            Unavailable: it cannot be made in a process of its own.
        """
        if self.suite_seed is not None:
            keep_secrets()
        return hosted(self.solver, self.settings, self.epoch_timeout_s)

    def rngs(self) -> list[np.random.Generator]:
        """Return the solver's random generators, one for each run."""
        name = finding.solver_name(self.solver)
        return [solver_rng(self.task, name, run, self.suite_seed) for run in self.runs]
