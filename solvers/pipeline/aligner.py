"""IMU -> attitude of a base that does not travel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.types import NavState, Observation, Rng, Task
from solvers.pipeline.epoch_map import ErrorModel
from solvers.pipeline.error_state import AlignmentErrors
from solvers.pipeline.integration import Integration, coordinates_of, refuse_navigation
from solvers.pipeline.navigation_errors import NavigationErrors
from solvers.types import Filter

Array = NDArray[np.float64]

VERTICAL_TIME_CONSTANT_S = 5.0  #: of the loop that holds the INS's vertical velocity on the fixes'


class Aligner(Integration):
    """The estimator around a filter. A told start goes straight to the fine phase; an unknown one begins with the coarse.

    ``feedback="open"`` leaves the INS alone and corrects its output, as the thesis does; ``"closed"`` resets velocity
    and attitude after each fix; None: open, but closed for a filter that says so (one that linearises at zero error).
    ``coarse`` is the method of the coarse phase (:mod:`solvers.pipeline.coarse`),
    ``model`` and ``bias_frame`` are those of :class:`AlignmentErrors`. The vertical velocity of the INS is slaved to the
    fixes, the position is the told site. ``coordinates="invariant"``: on the group SE_2(3) instead of ten states
    (:mod:`solvers.pipeline.invariant`); twelve, for the vertical velocity is one of them.

    Raises:
        ValueError: an unknown setting.
    """

    navigates = False
    feedback_default = "open"
    coarse_default = "aided"

    def __init__(
        self,
        filter: Filter[Any],
        *,
        model: str = "exact",
        bias_frame: str = "body",
        feedback: str | None = None,
        coordinates: str | None = None,
        coarse: str | None = None,
    ) -> None:
        errors: ErrorModel = AlignmentErrors(model, bias_frame)
        if coordinates_of(filter, coordinates) == "invariant":
            if errors != AlignmentErrors():
                raise ValueError(
                    f"model = {model!r}, bias_frame = {bias_frame!r}; allowed in invariant coordinates: 'exact', 'body'"
                )
            errors = NavigationErrors(position=False)
        super().__init__(filter, errors, feedback, coordinates, coarse)

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        refuse_navigation(task, "an aligner")
        super().reset(task, rng, num_runs)

    def answer(self, nav: NavState) -> Array:
        """q_nb (..., 4)."""
        return nav.q_nb

    def aid(self, obs: Observation, valid: NDArray[np.bool_], arm: Array | None) -> None:
        """Slaves the vertical velocity, unless it is a state of the filter."""
        if len(self._R) > 2:
            return
        assert self._ins is not None
        vel = self._ins.nav.vel.copy()
        off = obs["gps_vel"][..., 2] - vel[..., 2] - (0.0 if arm is None else arm[..., 0, 2])
        vel[..., 2] += valid * min(self.task.epoch_s / VERTICAL_TIME_CONSTANT_S, 1.0) * off
        self._ins = self._ins._replace(nav=self._ins.nav._replace(vel=vel))
