"""The information of two antennas. See docs/mathematics/aiding.md#heading."""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.bound.aids import Instant, Own, Term
from sins_env.evaluation.bound.fisher import LEAST_STD
from sins_env.states import Block
from sins_env.units import DEG


class HeadingTerm(Term):
    """The baseline in n, with the yaw of its mounting and the multipath."""

    name = "heading"

    def states(self) -> list[Own]:
        spec = self.spec
        own = [Own(Block("heading.mounting", 1, "rad"), spec.mounting_deg * DEG)]
        return own + [Own(Block("heading.multipath", 3, "m"), spec.multipath_m, spec.multipath_s)] * bool(
            spec.multipath_m
        )

    def rows(self, at: Instant) -> dict[str, Array]:
        baseline = np.asarray(self.spec.baseline_m)
        sideways = np.cross([0.0, 0.0, 1.0], baseline)
        rows = {"phi": attitude.skew(at.C @ baseline), "heading.mounting": -(at.C @ sideways)[..., None]}
        return rows | ({"heading.multipath": -np.eye(3)} if self.spec.multipath_m else {})

    def noise(self) -> Array:
        return np.full(3, max(self.spec.noise_m, LEAST_STD) ** 2)
