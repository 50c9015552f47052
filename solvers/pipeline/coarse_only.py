"""Coarse alignment all the way, as estimators of their own: whatever the start was told to be, they do not look."""

from __future__ import annotations

from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.types import Observation, Rng, Task
from solvers.filters.brief import changed
from solvers.pipeline import coarse
from solvers.pipeline.coarse import Coarse
from solvers.pipeline.integration import refuse_navigation

INERTIAL = ("two_vector", "svd", "aided")


class CoarseAligner:
    """The attitude of one method of :mod:`solvers.pipeline.coarse`, epoch by epoch.

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
        refuse_navigation(task, "a coarse alignment")
        self._task = task
        self._coarse: Coarse | None = None

    def step(self, obs: Observation) -> Array:
        """q_nb (..., 4) at the end of the epoch."""
        if self._task is None:
            raise RuntimeError(f"{self!r} has no task yet; call reset(task, rng) first")
        if self._coarse is None:
            self._coarse = coarse.start(self.method, self._task, obs["dtheta"].shape[:-2])
        self._coarse.add(obs)
        return self._coarse.attitude()


class CoarseInertial(CoarseAligner):
    """Coarse alignment in the inertial frame all the way. 000 section 2.4.

    ``method``: ``svd`` over all pairs since the start, ``two_vector`` as in the source, or ``aided`` by the velocity of the
    fixes (a zero-velocity update where there is no GPS).
    """

    def __init__(self, method: str = "svd") -> None:
        if method not in INERTIAL:
            raise unknown("method of coarse_inertial", method, INERTIAL)
        super().__init__(method)


class CoarseOba(CoarseAligner):
    """Optimisation-based alignment all the way (Wu et al. 2013): Wahba's problem in the inertial frame by the q-method.

    ``aided``: with the velocity of the fixes, over sliding windows of 60 s; else on the pairs since the start.
    """

    def __init__(self, aided: bool = True) -> None:
        super().__init__("oba" if aided else "oba_unaided")
        self.aided = aided


class CoarseAnalytic1(CoarseAligner):
    """Analytic coarse alignment of a base at rest from g, w, g x w, orthonormalised. 000 section 6.2.1, method 1."""

    def __init__(self) -> None:
        super().__init__("analytic1")


class CoarseAnalytic2(CoarseAligner):
    """Analytic coarse alignment of a base at rest from g, g x w, (g x w) x g, orthonormalised. 000 section 6.2.1, method 2."""

    def __init__(self) -> None:
        super().__init__("analytic2")


class CoarseAnalytic3(CoarseAligner):
    """Analytic coarse alignment of a base at rest from normalised g, g x w, (g x w) x g (TRIAD). 000 section 6.2.1, method 3."""

    def __init__(self) -> None:
        super().__init__("analytic3")
