"""A magnetometer in microtesla, with hard iron, soft iron and the error of the declination as states.

See docs/mathematics/aiding.md#magnetometer.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array, Mask
from sins_env.types import Observation
from sins_env.units import DEG
from solvers.pipeline.aiding.aid import Ins, Sensor, State
from solvers.pipeline.errors.model import Parameter

UT = 1e-6  #: tesla in a microtesla


class Magnetometer(Sensor):
    """A magnetometer as an aid."""

    name = "magnetometer"
    rows = 3

    @classmethod
    def states_of(cls, spec: Any) -> tuple[Parameter, ...]:
        own = (
            Parameter("magnetometer.hard_iron", 3, "uT", std=spec.hard_iron_ut, fed=True),
            Parameter("magnetometer.declination", 1, "mrad", 1e-3, std=DEG * spec.declination_deg, fed=True),
        )
        return (
            (*own, Parameter("magnetometer.soft_iron", 3, "1e-3", 1e-3, std=spec.soft_iron, fed=True))
            if spec.soft_iron
            else own
        )

    def told(self, obs: Observation, ins: Ins) -> tuple[Array, Mask]:
        value, present = super().told(obs, ins)
        return value / UT, present

    def _field(self, s: State) -> tuple[Array, Array]:
        """Return the field in n, (..., 3), and its derivative with the declination, which is clockwise from north."""
        delta = s.own["magnetometer.declination"][..., 0]
        c, si = np.cos(delta), np.sin(delta)
        east, north, up = self.spec.field_ut
        m = np.stack([c * east + si * north, c * north - si * east, np.full_like(c, up)], axis=-1)
        return m, np.stack([m[..., 1], -m[..., 0], np.zeros_like(c)], axis=-1)

    def _soft(self, s: State) -> Array:
        return 1.0 + s.own["magnetometer.soft_iron"] if self.spec.soft_iron else np.ones(3)

    def value(self, s: State) -> Array:
        seen = (s.C.mT @ self._field(s)[0][..., None])[..., 0]
        return self._soft(s) * seen + s.own["magnetometer.hard_iron"]

    def slopes(self, s: State) -> dict[str, Array]:
        m, slope = self._field(s)
        soft, seen = self._soft(s)[..., None], (s.C.mT @ m[..., None])[..., 0]
        found = {
            "turn": soft * (s.C.mT @ attitude.skew(m)),
            "magnetometer.hard_iron": np.eye(3),
            "magnetometer.declination": soft * (s.C.mT @ slope[..., None]),
        }
        if self.spec.soft_iron:
            found["magnetometer.soft_iron"] = seen[..., None] * np.eye(3)
        return found

    def noise(self) -> Array:
        return np.full(3, max(self.spec.noise_ut, 1e-4) ** 2)
