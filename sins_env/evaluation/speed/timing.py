"""The one timing loop: a solver on the first runs of a task, with the seconds of each part at each epoch."""

from __future__ import annotations

import faulthandler
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.guard import Guard
from sins_env.evaluation.play.playing import Job
from sins_env.evaluation.tasks.task import EvaluationTask

MOST_TIMEOUT_S = 1e6  #: longer ones are none


class Probe:
    """Some runs in lockstep, advanced block by block; the coarse phase belongs to the warm-up.

    Args:
        timeout_s: a call of the solver that takes longer ends this process, which must be one that may end.

    Raises:
        ValueError: several runs for a solver that takes one at a time. EstimatorError: the estimator fails.
    """

    def __init__(
        self,
        task: EvaluationTask,
        solver: finding.Solver,
        settings: Mapping[str, Any],
        runs: int = 1,
        warm_up: int = 20,
        clock: Callable[[], float] = time.perf_counter,
        timeout_s: float | None = None,
    ) -> None:
        self.clock, self.timeout_s = clock, timeout_s
        self.guard = Guard(finding.make(solver, settings), runs)
        if runs > 1 and not self.guard.batched:
            raise ValueError(f"runs = {runs}; allowed: 1, {finding.solver_name(solver)} is not batched")
        self.env = task.make(runs)
        self.obs, _ = task.reset(self.env, range(runs))
        public = self.env.unwrapped.task  # type: ignore[attr-defined]
        self.left, self.epoch_s = public.num_epochs, public.epoch_s
        with self._limited():
            self.guard.reset(public, Job(task, solver, tuple(range(runs))).rngs())
        self.advance(round(public.coarse_s / public.epoch_s) + warm_up)

    def advance(self, epochs: int) -> tuple[Array, Array]:
        """The next epochs, as far as there are any: seconds of the estimator and of the environment, (n,) each."""
        times = np.empty((min(epochs, self.left), 2))
        for spent in times:
            with self._limited():
                begin = self.clock()
                action = self.guard.step(self.obs)
                between = self.clock()
            self.obs = self.env.step(action)[0]
            spent[:] = between - begin, self.clock() - between
        self.left -= len(times)
        return times[:, 0], times[:, 1]

    @contextmanager
    def _limited(self) -> Iterator[None]:
        """A thread in C, so that neither a loop in Python nor one that never lets go of the interpreter can go on."""
        if self.timeout_s is None or self.timeout_s > MOST_TIMEOUT_S:
            yield
            return
        with open(os.devnull, "w") as nowhere:
            faulthandler.dump_traceback_later(self.timeout_s, exit=True, file=nowhere)
            try:
                yield
            finally:
                faulthandler.cancel_dump_traceback_later()

    def close(self) -> None:
        self.env.close()
