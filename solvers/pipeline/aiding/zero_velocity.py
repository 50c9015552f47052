"""The velocity, and the rate, of a base that is seen to stand still (:mod:`solvers.pipeline.aiding.stillness`): zero, untold.

The noise of the rate is that of the gyros, which drives the prediction too. A filter that takes the two as independent lets the
heading walk away. :class:`ZeroRate` therefore tells their covariance, and the pipeline makes them independent
(:func:`solvers.blocks.correlated.independent`). See docs/mathematics/aiding.md#zero-velocity.
"""

from __future__ import annotations

import math
from typing import ClassVar, cast

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array, Mask
from sins_env.states import ERRORS, Layout
from sins_env.types import Observation, Task
from solvers.pipeline.aiding.aid import Ins, Shown, State, earth_rate
from solvers.pipeline.aiding.stillness import LEAST_RATE, MOTION_STD, Stillness
from solvers.types import Linear, Measurement


class ZeroVelocity:
    """Rest as an aid. Its rows are the velocity errors that the error model has as states."""

    name: ClassVar[str] = "zero_velocity"

    def __init__(self, task: Task, states: Layout) -> None:
        self._task, self._H = task, np.eye(states.size)[states["dv"]]
        self.rows = len(self._H)
        self._R = MOTION_STD**2 * np.eye(self.rows)
        self._stillness: Stillness | None = None  # until the first epoch tells the number of runs
        self.still: Mask | None = None  #: (..., 1), which runs stand still in the last epoch

    def read(self, obs: Observation, ins: Ins) -> Measurement | None:
        """Return the velocity of the INS in the runs that have stood still over a window; None if there are none."""
        batch = ins.nav.vel.shape[:-1]
        if self._stillness is None:
            self._stillness = Stillness(self._task, math.prod(batch))
        rows = obs if batch else cast(Observation, {name: np.asarray(value)[None] for name, value in obs.items()})
        self.still = still = np.reshape(self._stillness.seen(rows), (*batch, 1))
        if not still.any():
            return None
        z = np.where(still, ins.nav.vel[..., : self.rows], 0.0)
        return Measurement(z, Linear(self._H), self._R, None, np.broadcast_to(still, z.shape))


class ZeroRate:
    """The rate against the earth of a base that stands still, in b.

    Args:
        task: the task.
        states: layout of the errors.
        rest: the aid that sees whether the base stands still; it is asked first.
    """

    name: ClassVar[str] = "zero_rate"
    rows = 3
    parameters = ()

    def __init__(self, task: Task, states: Layout, rest: ZeroVelocity) -> None:
        self.states, self._rest, self._T = states, rest, task.epoch_s
        self._angle = task.prior.Q[ERRORS["phi"], ERRORS["phi"]]  # of the gyros' noise over the epoch, rad^2
        self._R = self._angle / self._T**2 + LEAST_RATE**2 * np.eye(3)
        self._rate_ie = earth_rate(task)

    def value(self, s: State) -> Array:
        """Return the rate against the earth, (..., 3) rad/s; the rate of the state is that against inertial space."""
        return s.rate - (s.C.mT @ self._rate_ie[:, None])[..., 0]

    def slopes(self, s: State) -> dict[str, Array]:
        """Return the derivatives by a turn of the axes and by the rate."""
        return {"turn": -s.C.mT @ attitude.skew(self._rate_ie), "rate": np.eye(3)}

    def read(self, obs: Observation, ins: Ins) -> Measurement | None:
        """Return the rate of the INS in the runs that stand still; None if there are none."""
        still = self._rest.still
        if still is None or not still.any():
            return None
        hat = State(ins.C, ins.nav.vel, np.zeros_like(ins.nav.vel), ins.dtheta.sum(axis=-2) / self._T, {})
        expected = self.value(hat)
        present = np.broadcast_to(still, expected.shape)
        return Measurement(np.where(present, expected, 0.0), Shown(self, hat, expected), self._R, None, present)

    def shared(self, ins: Ins) -> Array:
        """Return the covariance (..., n, 3) of the noise that drives the errors in the epoch, and that of the reading."""
        cross = np.zeros((*ins.nav.vel.shape[:-1], self.states.size, 3))
        cross[..., self.states["phi"], :] = -ins.C @ self._angle / self._T
        return cross
