"""Timing of a solver on the first runs of a task, in blocks of epochs."""

from __future__ import annotations

import time

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.guard import Clock
from sins_env.evaluation.estimators.isolation import Host
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.tasks.task import EvaluationTask


class Probe:
    """Some runs in lockstep, advanced block by block; the coarse phase belongs to the warm-up.

    Args:
        task: task to play.
        host: solver with its time limit and its process.
        runs: number of runs.
        warm_up: number of fine epochs before the first block.
        clock: clock of the measurement.

    Raises:
        ValueError: several runs for a solver that takes one at a time.
        EstimatorError: the estimator fails.
    """

    def __init__(
        self, task: EvaluationTask, host: Host, runs: int = 1, warm_up: int = 20, clock: Clock = time.perf_counter
    ) -> None:
        if runs > 1 and not host.batched:
            raise ValueError(f"runs = {runs}; allowed: 1, {finding.solver_name(host.solver)} is not batched")
        self._loop = Loop.of(Job(task, host.solver, tuple(range(runs)), host.settings), host, clock)
        public = self._loop.task
        self.epoch_s = public.epoch_s
        self.advance(round(public.coarse_s / public.epoch_s) + warm_up)

    @property
    def left(self) -> int:
        """Number of epochs that are still to be played."""
        return self._loop.left

    def advance(self, epochs: int) -> tuple[Array, Array, Array]:
        """Play up to ``epochs`` epochs.

        Returns:
            the seconds of the estimator and of the environment in each epoch, and those of the estimator as it tells them
            itself, (n,) each. The last are without the way to its process and back, if it has one, but may be a lie.
        """
        times, guard = np.empty((min(epochs, self.left), 3)), self._loop.guard
        told_s = guard.told_s
        for spent, epoch in zip(times, self._loop, strict=False):
            spent[:] = epoch.estimator_s, epoch.env_s, guard.told_s - told_s
            told_s = guard.told_s
        return times[:, 0], times[:, 1], times[:, 2]

    def close(self) -> None:
        """Close the environment."""
        self._loop.close()
