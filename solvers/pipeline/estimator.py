"""One estimator for alignment and navigation: the task says which answer it wants.

Read :mod:`solvers.pipeline.integration` first, which has everything that both share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sins_env.arrays import Array
from sins_env.checks import build
from sins_env.types import NavState, Observation, Rng, Task
from solvers.filters.brief import changed
from solvers.pipeline.aiding.gps import Gps
from solvers.pipeline.errors.alignment import AlignmentErrors
from solvers.pipeline.errors.model import ErrorModel
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.integration import Integration, refuse_navigation
from solvers.pipeline.settings import Settings
from solvers.pipeline.smoother import Smoother
from solvers.types import Filter, Health


class Aligner(Integration):
    """The estimator of attitude around a filter, with the :class:`Settings` of the pipeline by name.

    The vertical velocity of the INS is pulled towards the fixes, and the position is the told site. In invariant and equivariant
    coordinates, and for a task with aids, there are twelve states instead of ten, with the vertical velocity among them.

    Raises:
        ValueError: an unknown setting.
    """

    navigates = False
    default = Settings(feedback="open", coordinates="euler", coarse="aided")
    aid = Gps

    def __init__(self, filter: Filter[Any], **settings: Any) -> None:
        chosen = build(Settings, settings, "the pipeline").completed(filter, self.default)
        errors: ErrorModel = AlignmentErrors(chosen.model == "exact", chosen.bias_frame == "body")
        if chosen.coordinates != "euler":
            errors = NavigationErrors(position=False)
        super().__init__(filter, errors, chosen)

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode.

        Raises:
            ValueError: the task navigates.
        """
        refuse_navigation(task, "an aligner")
        super().reset(task, rng, num_runs)

    def error_model(self, task: Task) -> ErrorModel:
        """Return the ten-state model, or with aids the one of twelve states, which has a vertical velocity.

        Raises:
            ValueError: the task has aids, and a setting of the ten-state model was given.
        """
        if not task.aids:
            return self.errors
        self.settings.refuse_with_aids()
        return NavigationErrors(position=False)

    def answer(self, nav: NavState) -> Array:
        """Return q_nb (..., 4)."""
        return nav.q_nb


class Navigator(Integration):
    """The estimator of attitude, velocity and position around a filter, held by the velocity and position of the fixes.

    The :class:`Settings` of the pipeline are given by name. Closed loop, the estimated errors of attitude, velocity, position
    and biases are removed from the INS after each fix, with the Jacobian of the reset. For coarse alignment the vehicle stands
    still; after it, navigation begins at the place of the last fix, or at the site. A filter may ask for other coordinates in
    navigation than in alignment.

    Raises:
        ValueError: an unknown setting, or one that only alignment has.
    """

    navigates = True
    default = Settings(feedback="closed", coordinates="euler", coarse="svd")
    aid = Gps

    def __init__(self, filter: Filter[Any], **settings: Any) -> None:
        given = build(Settings, settings, "the pipeline")
        given.refuse_in_navigation("a navigator")
        if given.coordinates is None:
            given = replace(given, coordinates=getattr(filter, "navigation_coordinates", None))
        super().__init__(filter, NavigationErrors(), given.completed(filter, self.default))

    def answer(self, nav: NavState) -> Array:
        """Return q_nb, velocity E N U m/s, latitude rad, longitude rad and height m, (..., 10)."""
        return np.concatenate(nav, axis=-1)


class Pipeline:
    """The complete estimator around a filter: an :class:`Aligner` or, for a task that navigates, a :class:`Navigator`.

    The :class:`Settings` of the pipeline are given by name; only alignment has ``model`` and ``bias_frame``. The attribute
    ``running`` is the estimator in use.

    Raises:
        ValueError: an unknown setting; at ``reset``, a setting that only alignment has for a task that navigates.
    """

    def __init__(self, filter: Filter[Any], **settings: Any) -> None:
        self.filter, self.settings = filter, build(Settings, settings, "the pipeline")
        self.aligner = Aligner(filter, **vars(self.settings))
        self.navigator = Navigator(filter, **vars(self.settings.navigating()))
        self.running: Aligner | Navigator = self.aligner
        self.batched = self.aligner.batched

    def __repr__(self) -> str:
        return f"Pipeline({', '.join([repr(self.filter), *changed(Settings, vars(self.settings))])})"

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode.

        Raises:
            ValueError: the task navigates, and a setting that only alignment has was given.
        """
        if task.navigate:
            self.settings.refuse_in_navigation(task.id)
        self.running = self.navigator if task.navigate else self.aligner
        self.running.reset(task, rng, num_runs)

    def step(self, obs: Observation) -> Array:
        """Return q_nb (..., 4) at the end of the epoch; in navigation with velocity and position, (..., 10)."""
        return self.running.step(obs)

    def covariance(self) -> Array:
        """Return the covariance of the corrected errors, (..., 3, 3) or (..., 9, 9); before the fine phase the told one."""
        return self.running.covariance()

    def health(self) -> Health | None:
        """Return repairs and failures of each run so far; None in the coarse phase."""
        return self.running.health()

    def diagnostics(self) -> dict[str, Array]:
        """Return what the filter knows beside its estimate, by name; nothing in the coarse phase."""
        return self.running.diagnostics()

    @property
    def readings(self) -> dict[str, int]:
        """Number of components of the fixes and of each aid by name; known after ``reset``."""
        return self.running.readings

    def scale_noise(self, q: ArrayLike = 1.0, r: ArrayLike | Mapping[str, ArrayLike] = 1.0) -> None:
        """Multiply the told Q and R by factors from the next epoch on (:meth:`Integration.scale_noise`).

        Raises:
            RuntimeError, ValueError: as there.
        """
        self.running.scale_noise(q, r)

    def smoother(self) -> Smoother:
        """Return an estimator of the same answers whose ``smoothed()`` has the states of all epochs from all fixes.

        Raises:
            ValueError: the filter cannot be smoothed.
        """
        return Smoother(self)
