"""What the pipeline asks of an aid: the states that it adds, and measurements of the errors from observations."""

from __future__ import annotations

from typing import Protocol

from sins_env.arrays import Array
from sins_env.states import Layout
from sins_env.types import NavState, Observation, Task
from solvers.pipeline.errors.model import Parameter
from solvers.types import Measurement


class Aid(Protocol):
    """A sensor as the task tells it, made anew for each episode.

    ``states`` is the layout of the errors x. A measurement is INS minus reading, z = h(x) + v, with the errors of
    :mod:`solvers.pipeline.errors`. Equations: docs/mathematics/error_models.md#measurement.
    """

    def __init__(self, task: Task, states: Layout) -> None: ...

    @staticmethod
    def parameters(task: Task) -> tuple[Parameter, ...]:
        """Return the states that the sensor adds to the errors of the INS."""
        ...

    def start(self, obs: Observation, q_nb: Array) -> NavState:
        """Return the state of the INS at the end of an epoch of the coarse phase, with the attitude q_nb (..., 4).

        It is called at each epoch, so that the last reading is known at the end.
        """
        ...

    def read(self, obs: Observation, nav: NavState) -> tuple[NavState, Measurement | None]:
        """Return the state ``nav`` of the INS with what a reading does to it directly, and the measurement there.

        The measurement is None if no run has a reading.
        """
        ...
