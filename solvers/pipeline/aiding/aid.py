"""What the pipeline asks of an aid: its parameters, and measurements of the error state from observations."""

from __future__ import annotations

from typing import Protocol

from sins_env.arrays import Array
from sins_env.states import Layout
from sins_env.types import NavState, Observation, Task
from solvers.pipeline.errors.model import Parameter
from solvers.types import Measurement


class Aid(Protocol):
    """A sensor as it is told, made anew for each episode; ``states`` is the layout that its measurements are of.

    A measurement is INS minus reading: z = h(x) + v, with the errors x as :mod:`solvers.pipeline.errors` has them.
    docs/mathematics/error_models.md#measurement.
    """

    def __init__(self, task: Task, states: Layout) -> None: ...

    @staticmethod
    def parameters(task: Task) -> tuple[Parameter, ...]:
        """The states that the sensor adds to the errors of the INS."""
        ...

    def start(self, obs: Observation, q_nb: Array) -> NavState:
        """The state of the INS at the end of an epoch of the coarse phase, from which its attitude is known.

        Called at each epoch, so that the last reading is known at the end.
        """
        ...

    def hold(self, obs: Observation, nav: NavState) -> NavState:
        """The INS's state with what a reading does to it directly, without the filter."""
        ...

    def measure(self, obs: Observation, nav: NavState) -> Measurement | None:
        """The measurement at the INS's state ``nav``; None: no run has a reading."""
        ...
