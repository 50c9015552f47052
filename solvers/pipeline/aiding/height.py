"""A height, of which the offset is a state. See docs/mathematics/aiding.md#height-and-depth."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.states import Layout
from sins_env.types import Observation
from solvers.pipeline.aiding.aid import Ins, Sensor, State
from solvers.pipeline.errors.model import Parameter


class Height(Sensor):
    """A barometer as an aid."""

    name = "height"
    rows = 1
    sign: ClassVar[float] = 1.0  #: -1 for a depth

    @classmethod
    def states_of(cls, spec: Any) -> tuple[Parameter, ...]:
        return (Parameter(f"{cls.name}.bias", 1, "m", std=spec.bias_m, time_constant_s=spec.bias_s, fed=True),)

    @classmethod
    def fits(cls, states: Layout) -> bool:
        return "dp" in states

    def told(self, obs: Observation, ins: Ins) -> tuple[Array, Mask]:
        value, present = super().told(obs, ins)
        return value - self.sign * ins.nav.pos[..., 2:], present

    def value(self, s: State) -> Array:
        return self.sign * s.away[..., 2:] + s.own[f"{self.name}.bias"]

    def slopes(self, s: State) -> dict[str, Array]:
        up = np.array([[0.0, 0.0, self.sign]])
        return {"away": up, f"{self.name}.bias": np.ones((1, 1))}

    def noise(self) -> Array:
        return np.array([max(self.spec.noise_m, 1e-4) ** 2])
