"""One estimator for alignment and navigation: the task says which answer it wants."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.types import NavState, Observation, Rng, Task
from solvers.pipeline.errors.alignment import AlignmentErrors
from solvers.pipeline.errors.model import ErrorModel
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.integration import Integration, coordinates_of, refuse_navigation
from solvers.types import Filter, Health

VERTICAL_TIME_CONSTANT_S = 5.0  #: of the loop that holds the INS's vertical velocity on the fixes'


class Aligner(Integration):
    """The estimator around a filter. A told start goes straight to the fine phase; an unknown one begins with the coarse.

    ``feedback="open"`` leaves the INS alone and corrects its output, as the thesis does; ``"closed"`` resets velocity
    and attitude after each fix; None: open, but closed for a filter that says so (one that linearises at zero error).
    ``coarse`` is the method of the coarse phase (:mod:`solvers.pipeline.coarse`),
    ``model`` and ``bias_frame`` are those of :class:`AlignmentErrors`. The vertical velocity of the INS is slaved to the
    fixes, the position is the told site. ``coordinates="invariant"``: on the group SE_2(3) instead of ten states
    (:mod:`solvers.pipeline.errors.invariant`); twelve, for the vertical velocity is one of them.

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


class Navigator(Integration):
    """The INS with a position of its own, held by the velocity and the position of the fixes.

    ``feedback="closed"`` (the default) takes attitude, velocity, position and biases out of the INS after each fix, with the
    Jacobian of the reset; ``"open"`` corrects its output alone. Where the task does not tell a start it stands still for
    ``coarse_s`` seconds: coarse alignment by the method ``coarse``, then navigation from the place of the last fix, or the site.
    The default ``svd`` takes the vehicle at its word; on one that rocks on the spot, the velocities of the fixes, which
    ``aided`` relies on, are noisier than that. ``coordinates=None``: as a filter says for navigation alone, else as it says.

    Raises:
        ValueError: an unknown setting.
    """

    navigates = True
    feedback_default = "closed"
    coarse_default = "svd"

    def __init__(
        self,
        filter: Filter[Any],
        *,
        feedback: str | None = None,
        coordinates: str | None = None,
        coarse: str | None = None,
    ) -> None:
        if coordinates is None:
            coordinates = getattr(filter, "navigation_coordinates", None)
        super().__init__(filter, NavigationErrors(), feedback, coordinates, coarse)

    def answer(self, nav: NavState) -> Array:
        """q_nb, velocity E N U m/s, latitude rad, longitude rad, height m: (..., 10)."""
        return np.concatenate(nav, axis=-1)


ALIGNMENT_ONLY = {"model": "exact", "bias_frame": "body"}  #: settings, and all that a navigator can be asked for


class Pipeline:
    """The :class:`Aligner` around a filter or, for a task that navigates, the :class:`Navigator`; ``running`` is the one.

    The settings are theirs. ``feedback=None`` is open in alignment, closed in navigation, unless the filter says which;
    ``coarse=None`` is "aided" in alignment, "svd" in navigation;
    ``model`` and ``bias_frame`` are of alignment alone.

    Raises:
        ValueError: an unknown setting; at ``reset``, a setting of alignment for a task that navigates.
    """

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
        self.filter = filter
        shared: dict[str, Any] = {"feedback": feedback, "coordinates": coordinates, "coarse": coarse}
        self.aligner = Aligner(filter, model=model, bias_frame=bias_frame, **shared)
        self.navigator = Navigator(filter, **shared)
        self.running: Aligner | Navigator = self.aligner
        self.batched = self.aligner.batched
        self._alignment_only = {"model": model, "bias_frame": bias_frame}

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        for name, given in self._alignment_only.items():
            if task.navigate and given != ALIGNMENT_ONLY[name]:
                raise ValueError(
                    f"{name} = {given!r} is of alignment, and {task.id} navigates; allowed: {ALIGNMENT_ONLY[name]!r}"
                )
        self.running = self.navigator if task.navigate else self.aligner
        self.running.reset(task, rng, num_runs)

    def step(self, obs: Observation) -> Array:
        """q_nb (..., 4) at the end of the epoch; in navigation with velocity and position (..., 10)."""
        return self.running.step(obs)

    def covariance(self) -> Array:
        """Of the corrected errors, (..., 3, 3) or (..., 9, 9)."""
        return self.running.covariance()

    def health(self) -> Health | None:
        """Repairs and failures of each run so far; None in the coarse phase."""
        return self.running.health()

    def diagnostics(self) -> dict[str, Array]:
        """What the filter knows beside its estimate, by name; nothing in the coarse phase."""
        return self.running.diagnostics()
