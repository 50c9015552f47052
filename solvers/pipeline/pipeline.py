"""One estimator for alignment and navigation: the task says which answer it wants."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.types import Observation, Rng, Task
from solvers.pipeline.aligner import Aligner
from solvers.pipeline.navigator import Navigator
from solvers.types import Filter, Health

Array = NDArray[np.float64]

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
