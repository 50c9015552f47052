"""Coarse alignment for the whole run, as complete estimators. They do not use a told start."""

from __future__ import annotations

from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.types import Observation, Rng, Task
from solvers.filters.brief import changed
from solvers.pipeline import coarse
from solvers.pipeline.coarse import Coarse
from solvers.pipeline.integration import refuse_navigation
from solvers.registry import register

INERTIAL = ("two_vector", "svd", "aided", "motion_velocity", "motion_position", "motion_body")


class CoarseAligner:
    """The estimator of attitude by one method of :mod:`solvers.pipeline.coarse`.

    Raises:
        ValueError: an unknown method.
    """

    batched = True

    def __init__(self, method: str) -> None:
        coarse.check_method(method)
        self.method = method
        self._task: Task | None = None

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(changed(type(self), vars(self)))})"

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode.

        Raises:
            ValueError: the task navigates.
        """
        refuse_navigation(task, "a coarse alignment")
        self._task = task
        self._coarse: Coarse | None = None

    def step(self, obs: Observation) -> Array:
        """Return q_nb (..., 4) at the end of the epoch.

        Raises:
            RuntimeError: there has been no ``reset``.
        """
        if self._task is None:
            raise RuntimeError(f"{self!r} has no task yet; call reset(task, rng) first")
        if self._coarse is None:
            self._coarse = coarse.start(self.method, self._task, obs["dtheta"].shape[:-2])
        self._coarse.add(obs)
        return self._coarse.attitude()


@register("coarse_inertial")
class CoarseInertial(CoarseAligner):
    """Coarse alignment in the inertial frame for the whole run. 000 section 2.4.

    ``method``: "svd" over all pairs since the start, "two_vector" as in the source, or "aided" by the velocity of the fixes.
    Zero-velocity updates serve as fixes if there is no GPS. "motion_velocity", "motion_position" and "motion_body" are those for a
    base that travels (:mod:`solvers.pipeline.coarse.motion`).

    Raises:
        ValueError: another method.
    """

    def __init__(self, method: str = "svd") -> None:
        if method not in INERTIAL:
            raise unknown("method of coarse_inertial", method, INERTIAL)
        super().__init__(method)


@register("coarse_oba")
class CoarseOba(CoarseAligner):
    """Optimisation-based alignment for the whole run (Wu et al. 2013): Wahba's problem in the inertial frame by the q-method.

    ``aided``: whether it uses the velocity of the fixes, over sliding windows of 60 s; else it uses pairs since the start.
    """

    def __init__(self, aided: bool = True) -> None:
        super().__init__("oba" if aided else "oba_unaided")
        self.aided = aided


@register("coarse_analytic1")
class CoarseAnalytic1(CoarseAligner):
    """Analytic coarse alignment of a base at rest from g, w, g x w, made a rotation. 000 section 6.2.1, method 1."""

    def __init__(self) -> None:
        super().__init__("analytic1")


@register("coarse_analytic2")
class CoarseAnalytic2(CoarseAligner):
    """Analytic coarse alignment of a base at rest from g, g x w, (g x w) x g, made a rotation. 000 section 6.2.1, method 2."""

    def __init__(self) -> None:
        super().__init__("analytic2")


@register("coarse_analytic3")
class CoarseAnalytic3(CoarseAligner):
    """Analytic coarse alignment of a base at rest from normalised g, g x w, (g x w) x g (TRIAD). 000 section 6.2.1, method 3."""

    def __init__(self) -> None:
        super().__init__("analytic3")
