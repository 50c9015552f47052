"""IMU -> attitude, velocity and position of a vehicle."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.types import NavState
from solvers.pipeline.integration import Integration
from solvers.pipeline.navigation_errors import NavigationErrors
from solvers.types import Filter

Array = NDArray[np.float64]


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
