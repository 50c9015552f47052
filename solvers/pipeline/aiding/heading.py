"""Two antennas: the baseline between them in n, with the yaw of its mounting and the multipath as states.

See docs/mathematics/aiding.md#heading.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.units import DEG
from solvers.pipeline.aiding.aid import Sensor, State
from solvers.pipeline.errors.model import Parameter


class Heading(Sensor):
    """A heading from two antennas as an aid."""

    name = "heading"
    rows = 3

    @classmethod
    def states_of(cls, spec: Any) -> tuple[Parameter, ...]:
        own = (Parameter("heading.mounting", 1, "mrad", 1e-3, std=DEG * spec.mounting_deg, fed=True),)
        if not spec.multipath_m:
            return own
        wander = {"std": spec.multipath_m, "time_constant_s": spec.multipath_s}
        return (*own, Parameter("heading.multipath", 3, "cm", 1e-2, fed=True, **wander))

    def prepare(self) -> None:
        self._wanders = bool(self.spec.multipath_m)

    def _turned(self, s: State) -> tuple[Array, Array]:
        """Return the baseline in b, (..., 3), and its derivative with the yaw of the mounting."""
        beta = s.own["heading.mounting"][..., 0]
        c, si = np.cos(beta), np.sin(beta)
        right, forward, up = self.spec.baseline_m
        at = np.stack([c * right - si * forward, si * right + c * forward, np.full_like(c, up)], axis=-1)
        return at, np.stack([-at[..., 1], at[..., 0], np.zeros_like(c)], axis=-1)

    def value(self, s: State) -> Array:
        seen = (s.C @ self._turned(s)[0][..., None])[..., 0]
        return seen + s.own["heading.multipath"] if self._wanders else seen

    def slopes(self, s: State) -> dict[str, Array]:
        at, slope = self._turned(s)
        found = {"turn": -attitude.skew((s.C @ at[..., None])[..., 0]), "heading.mounting": s.C @ slope[..., None]}
        return found | ({"heading.multipath": np.eye(3)} if self._wanders else {})

    def noise(self) -> Array:
        return np.full(3, max(self.spec.noise_m, 1e-5) ** 2)
