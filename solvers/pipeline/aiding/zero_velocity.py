"""The velocity of a base that is seen to stand still (:mod:`solvers.pipeline.aiding.stillness`): zero, without being told.

The rate of such a base is no reading here. Its noise is that of the prediction, and a filter that takes the two as independent lets
the heading walk away. Only the bank of :mod:`solvers.pipeline.bank` knows this correlation.
See docs/mathematics/aiding.md#zero-velocity.
"""

from __future__ import annotations

import math
from typing import ClassVar, cast

import numpy as np

from sins_env.states import Layout
from sins_env.types import Observation, Task
from solvers.pipeline.aiding.aid import Ins
from solvers.pipeline.aiding.stillness import MOTION_STD, Stillness
from solvers.types import Linear, Measurement


class ZeroVelocity:
    """Rest as an aid. Its rows are the velocity errors that the error model has as states."""

    name: ClassVar[str] = "zero_velocity"

    def __init__(self, task: Task, states: Layout) -> None:
        self._task, self._H = task, np.eye(states.size)[states["dv"]]
        self.rows = len(self._H)
        self._R = MOTION_STD**2 * np.eye(self.rows)
        self._stillness: Stillness | None = None  # until the first epoch tells the number of runs

    def read(self, obs: Observation, ins: Ins) -> Measurement | None:
        """Return the velocity of the INS in the runs that have stood still over a window; None if there are none."""
        batch = ins.nav.vel.shape[:-1]
        if self._stillness is None:
            self._stillness = Stillness(self._task, math.prod(batch))
        rows = obs if batch else cast(Observation, {name: np.asarray(value)[None] for name, value in obs.items()})
        still = np.reshape(self._stillness.seen(rows), (*batch, 1))
        if not still.any():
            return None
        z = np.where(still, ins.nav.vel[..., : self.rows], 0.0)
        return Measurement(z, Linear(self._H), self._R, None, np.broadcast_to(still, z.shape))
