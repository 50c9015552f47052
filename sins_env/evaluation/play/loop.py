"""The only loop that plays: one estimator against the runs of one environment, in lockstep, epoch by epoch.

Scores, replays and times are computed from the epochs that it yields.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sins_env import types
from sins_env.arrays import Array, Obs
from sins_env.evaluation.estimators.guard import Clock, Guarded
from sins_env.evaluation.estimators.isolation import Host
from sins_env.evaluation.play.job import Job


class Epoch(NamedTuple):
    """Action and info of one epoch, with the times of estimator and environment by the clock of the guard."""

    k: int  #: number of the epoch, from 1 on
    action: Array  #: (R, 4), or (R, 10) in navigation
    info: dict[str, Any]  #: info of ``env.step``
    estimator_s: float  #: time of the estimator's own step, s
    env_s: float  #: time of the environment's step, s


class Loop:
    """Iterator over the epochs that are left. The first one resets the estimator.

    Args:
        env: a vector environment that has been reset, or an object with its ``unwrapped.task`` and ``step``.
        guard: estimator to play.
        obs: first observation.
        rngs: random generators of the solver, one for each run.
    """

    def __init__(self, env: Any, guard: Guarded, obs: Obs, rngs: Sequence[np.random.Generator]) -> None:
        self.env, self.guard, self.rngs = env, guard, rngs
        self.obs = obs  #: observation that the estimator gets next
        self.task: types.Task = env.unwrapped.task
        self.k = 0  #: number of epochs that have been played

    @classmethod
    def of(cls, job: Job, host: Host, clock: Clock = time.perf_counter) -> Loop:
        """Make the loop over the runs of a job, in a new environment.

        Raises:
            ValueError, FileNotFoundError: settings of the task that do not fit, or a recording that is not there.
        """
        guard = host.guard(len(job.runs), clock)
        env = job.task.make(len(job.runs))
        obs, _ = job.task.reset(env, job.runs, job.suite_seed)
        return cls(env, guard, obs, job.rngs())

    @property
    def left(self) -> int:
        """Number of epochs that are still to be played."""
        return self.task.num_epochs - self.k

    def __iter__(self) -> Loop:
        return self

    def __next__(self) -> Epoch:
        """Play the next epoch.

        Raises:
            EstimatorError: the estimator failed in ``reset`` or ``step``.
        """
        if not self.left:
            raise StopIteration
        guard = self.guard
        if not self.k:
            guard.reset(self.task, self.rngs)
        before = guard.seconds
        action = guard.step(self.obs)
        begin = guard.clock()
        self.obs, _, _, _, info = self.env.step(action)
        self.k += 1
        return Epoch(self.k, action, info, guard.seconds - before, guard.clock() - begin)

    def close(self) -> None:
        """Close the environment; the host ends the estimator."""
        self.env.close()
