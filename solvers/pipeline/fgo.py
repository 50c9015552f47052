"""Factor-graph estimator for alignment and navigation over a sliding window: the limit that filters are held against.

Idea: a filter takes each tangent once, at what it knew then, which may be wrong by tens of degrees. Here the errors of the INS at
all epochs of a window are sought together (:mod:`solvers.filters.kalman.window`). Each feedback into the INS is a part of the
next epoch's f. The INS runs in closed loop and its errors are right-invariant, so that f is nearly linear, and exact for errors
of any size. Gauss-Newton may end in a wrong maximum. A run whose fixes the maximum does not explain seeks another one from all
headings that are likely at the beginning of the window.

Source: Dellaert & Kaess (2017), doi:10.1561/2300000043, chapters 2 and 5 (elimination); Bell (1994), doi:10.1137/0804035 (the
iterated smoother is Gauss-Newton); docs/mathematics/bound.md#sliding-window.
Departures: an epoch is one factor, without preintegration over several, because a closed loop changes the INS at each fix.
"""

from __future__ import annotations

from sins_env.types import Rng, Task
from solvers.filters.brief import changed
from solvers.filters.kalman.window import WindowFilter
from solvers.pipeline.estimator import Pipeline
from solvers.registry import register


@register("fgo")
class FGO(Pipeline):
    """Factor-graph estimator whose tangents are taken again within a sliding window. After Dellaert & Kaess (2017) and Bell (1994).

    ``window_s``: length of the window, s. ``relinearise_s``: time from one set of tangents to the next, s. ``iterations``:
    largest number of Gauss-Newton steps then. ``tolerance``: move of a state, in standard deviations, that makes another one.
    ``spacing_deg``: largest width of a slice of headings, from each of which a run seeks another maximum if its fixes are not
    explained; 360: none. ``coordinates`` and ``coarse`` are those of the pipeline. The cost grows with
    ``window_s / relinearise_s``.
    """

    def __init__(
        self,
        *,
        window_s: float = 60.0,
        relinearise_s: float = 5.0,
        iterations: int = 3,
        tolerance: float = 0.05,
        spacing_deg: float = 15.0,
        coordinates: str = "invariant",
        coarse: str | None = None,
    ) -> None:
        window = WindowFilter(window_s, relinearise_s, iterations, tolerance, spacing_deg)
        super().__init__(window, coordinates=coordinates, coarse=coarse)

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode.

        Raises:
            ValueError: the task has an unknown start without a coarse phase.
        """
        if task.start is None and not task.coarse_s:
            raise ValueError(
                f"fgo on {task.id} with an unknown start and coarse = 0; allowed: a told start, or a coarse phase"
            )
        super().reset(task, rng, num_runs)

    def __repr__(self) -> str:
        values = {**vars(self.settings), **vars(self.filter)}
        return f"FGO({', '.join(changed(FGO, values))})"
