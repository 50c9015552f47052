"""A Doppler log: velocity along its own axes, with scale error, mounting and, through the water, the current as states.

See docs/mathematics/aiding.md#doppler-log.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sins_env.arrays import Array
from solvers.pipeline.aiding import body_velocity
from solvers.pipeline.aiding.aid import Sensor, State
from solvers.pipeline.errors.model import Parameter


class Dvl(Sensor):
    """A Doppler log as an aid."""

    name = "dvl"
    rows = 3

    @classmethod
    def states_of(cls, spec: Any) -> tuple[Parameter, ...]:
        own = (
            Parameter("dvl.scale", 1, "1e-3", 1e-3, std=1e-6 * spec.scale_ppm, fed=True),
            Parameter("dvl.mounting", 3, "mrad", 1e-3, std=1e-3 * spec.mounting_mrad, fed=True),
        )
        if spec.track == "bottom":
            return own
        return (
            *own,
            Parameter("dvl.current", 2, "m/s", std=spec.current_mps, time_constant_s=spec.current_s, fed=True),
        )

    def prepare(self) -> None:
        self._lever, self._flows = np.asarray(self.spec.lever_arm_m), self.spec.track != "bottom"

    def _seen(self, s: State) -> body_velocity.Seen:
        current: Array | float = 0.0
        if self._flows:
            flow = s.own["dvl.current"]
            current = np.concatenate([flow, np.zeros_like(flow[..., :1])], axis=-1)
        return body_velocity.seen(s, self._lever, s.own["dvl.mounting"], current)

    def value(self, s: State) -> Array:
        return (1.0 + s.own["dvl.scale"]) * self._seen(s).along

    def slopes(self, s: State) -> dict[str, Array]:
        y, scale = self._seen(s), 1.0 + s.own["dvl.scale"][..., None]
        found = {name: scale * slope for name, slope in body_velocity.slopes(s, y, self._lever).items()}
        found["dvl.mounting"] = found.pop("mounting")
        found["dvl.scale"] = y.along[..., None]
        if self._flows:
            found["dvl.current"] = -found["vel"][..., :2]
        return found

    def noise(self) -> Array:
        return np.full(3, max(self.spec.noise_mps, 1e-5) ** 2)
