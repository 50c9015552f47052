"""The only loop that plays: one estimator against the runs of one environment, in lockstep, epoch by epoch.

Scores, replays, times and the checks of the contract are all worked out from the epochs that it yields.
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
    """What one epoch gave. Seconds are by the clock of the guard; those of the estimator are its own time only."""

    k: int  #: from 1 on
    action: Array  #: (R, 4), or (R, 10) of a navigation task
    info: dict[str, Any]  #: of ``env.step``
    estimator_s: float
    env_s: float


class Loop:
    """An iterator over the epochs that are left. The estimator begins with the first one.

    Args:
        env: a vector environment that has been reset, or what has its ``unwrapped.task`` and ``step``.
        obs: its first observation.
        rngs: the solver's own random numbers, a generator for each run.
    """

    def __init__(self, env: Any, guard: Guarded, obs: Obs, rngs: Sequence[np.random.Generator]) -> None:
        self.env, self.guard, self.rngs = env, guard, rngs
        self.obs = obs  #: what the estimator is given next, untouched by it
        self.task: types.Task = env.unwrapped.task
        self.k = 0  #: epochs played

    @classmethod
    def of(cls, job: Job, host: Host, clock: Clock = time.perf_counter) -> Loop:
        """The loop over the runs of a job, in an environment of their own."""
        guard = host.guard(len(job.runs), clock)
        env = job.task.make(len(job.runs))
        obs, _ = job.task.reset(env, job.runs, job.suite_seed)
        return cls(env, guard, obs, job.rngs())

    @property
    def left(self) -> int:
        """Epochs that are still to be played."""
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
        """Close the environment; the estimator is its host's to end."""
        self.env.close()
