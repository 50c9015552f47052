"""The information of a magnetometer, in microtesla. See docs/mathematics/aiding.md#magnetometer."""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.bound.aids import Instant, Own, Term
from sins_env.evaluation.bound.fisher import LEAST_STD
from sins_env.states import Block
from sins_env.units import DEG


class MagnetometerTerm(Term):
    """The magnetic field in body axes, with hard and soft iron and the error of the declination."""

    name = "magnetometer"

    def states(self) -> list[Own]:
        spec = self.spec
        own = [
            Own(Block("magnetometer.hard_iron", 3, "uT"), spec.hard_iron_ut),
            Own(Block("magnetometer.declination", 1, "rad"), spec.declination_deg * DEG),
        ]
        return own + [Own(Block("magnetometer.soft_iron", 3, "1"), spec.soft_iron)] * bool(spec.soft_iron)

    def rows(self, at: Instant) -> dict[str, Array]:
        east, north, up = self.spec.field_ut
        field, clockwise, back = np.array([east, north, up]), np.array([north, -east, 0.0]), at.C.mT
        rows = {
            "phi": -back @ attitude.skew(field),
            "magnetometer.hard_iron": -np.eye(3),
            "magnetometer.declination": -(back @ clockwise)[..., None],
        }
        return rows | (
            {"magnetometer.soft_iron": -(back @ field)[..., None] * np.eye(3)} if self.spec.soft_iron else {}
        )

    def noise(self) -> Array:
        return np.full(3, max(self.spec.noise_ut, LEAST_STD) ** 2)
