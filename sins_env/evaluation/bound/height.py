"""The information of a barometer, and of a depth sensor. See docs/mathematics/aiding.md#height-and-depth."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.bound.aids import Instant, Own, Term
from sins_env.evaluation.bound.fisher import LEAST_STD
from sins_env.states import Block


class HeightTerm(Term):
    """The height with its offset."""

    name = "height"
    sign: ClassVar[float] = 1.0

    def states(self) -> list[Own]:
        return [Own(Block(f"{self.name}.bias", 1, "m"), self.spec.bias_m, self.spec.bias_s)]

    def rows(self, at: Instant) -> dict[str, Array]:
        return {"dp": np.array([[0.0, 0.0, self.sign]]), f"{self.name}.bias": np.array([[-1.0]])}

    def noise(self) -> Array:
        return np.array([max(self.spec.noise_m, LEAST_STD) ** 2])
