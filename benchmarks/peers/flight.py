"""A whole INS with GPS on one flight: strapdown, error model, filter and feedback, at each IMU increment and fix.

The filters of pyins are such an INS and take no model of ours. Therefore both fly the same record, from the same told start and
prior. It has an IMU increment and a fix of position and velocity at each epoch of 0.1 s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import solvers
from sins_env import attitude, earth
from sins_env.evaluation.estimators.isolation import Here
from sins_env.evaluation.speed.timing import Probe
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.types import NavState, Observation, Rng, Task
from solvers.types import Array

TASK = "flight-lu-gauss-v0"


class Flown(NamedTuple):
    """The estimate at the end of the flight."""

    nav: NavState
    cov: Array | None = None  #: (9, 9), covariance of phi rad, velocity m/s and position m; None: not told


class Tape:
    """An estimator that keeps the observations and always answers with the told start."""

    batched = False

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        self.task = task
        self.observations: list[Observation] = []

    def step(self, obs: Observation) -> Array:
        self.observations.append(obs)
        assert self.task.start is not None
        return np.concatenate(self.task.start)


def record(steps: int) -> Tape:
    """Record the first run of the task, with one epoch more than ``steps``."""
    tape = Tape()
    Probe(get_task(TASK), Here(lambda: tape), warm_up=steps + 1).close()
    return tape


def ours(tape: Tape, steps: int) -> Callable[[], Flown]:
    """Make the block of our extended Kalman filter on 15 errors, closed loop."""

    def block() -> Flown:
        navigator = solvers.make("ekf")
        navigator.reset(tape.task, np.random.default_rng(0))
        for obs in tape.observations[:steps]:
            answer = navigator.step(obs)
        return Flown(NavState(answer[:4], answer[4:7], answer[7:]), navigator.covariance())

    return block


def apart(ours: Flown, other: Flown) -> float:
    """Return the largest of the nine differences of two ends, in our standard deviations."""
    assert ours.cov is not None
    metres = earth.offset(earth.get("wgs84"), ours.nav.pos, other.nav.pos)
    difference = np.concatenate(
        [attitude.misalignment(other.nav.q_nb, ours.nav.q_nb), other.nav.vel - ours.nav.vel, metres]
    )
    return float(np.max(np.abs(difference) / np.sqrt(np.diagonal(ours.cov))))
