"""The one timing loop: a solver on the first runs of a task, with the seconds of each part at each epoch."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.evaluation import registry
from sins_env.evaluation.episode import Guard, Job
from sins_env.evaluation.tasks import EvaluationTask

Array = NDArray[np.float64]


class Probe:
    """Some runs in lockstep, advanced block by block; the coarse phase belongs to the warm-up.

    Raises:
        ValueError: several runs for a solver that takes one at a time. EstimatorError: the estimator fails.
    """

    def __init__(
        self,
        task: EvaluationTask,
        solver: registry.Solver,
        settings: Mapping[str, Any],
        runs: int = 1,
        warm_up: int = 20,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.clock = clock
        self.guard = Guard(registry.make(solver, settings), runs)
        if runs > 1 and not self.guard.batched:
            raise ValueError(f"runs = {runs}; allowed: 1, {registry.solver_name(solver)} is not batched")
        self.env = task.make(runs)
        self.obs, _ = task.reset(self.env, range(runs))
        public = self.env.unwrapped.task  # type: ignore[attr-defined]
        self.left, self.epoch_s = public.num_epochs, public.epoch_s
        self.guard.reset(public, Job(task, solver, tuple(range(runs))).rngs())
        self.advance(round(public.coarse_s / public.epoch_s) + warm_up)

    def advance(self, epochs: int) -> tuple[Array, Array]:
        """The next epochs, as far as there are any: seconds of the estimator and of the environment, (n,) each."""
        times = np.empty((min(epochs, self.left), 2))
        for spent in times:
            begin = self.clock()
            action = self.guard.step(self.obs)
            between = self.clock()
            self.obs = self.env.step(action)[0]
            spent[:] = between - begin, self.clock() - between
        self.left -= len(times)
        return times[:, 0], times[:, 1]

    def close(self) -> None:
        self.env.close()
