"""Barometer: the height with a constant or wandering offset. See docs/mathematics/aiding.md#height-and-depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from sins_env.arrays import Array, Rngs
from sins_env.motion import Motion
from sins_env.sensors.aids import Sensor
from sins_env.sensors.limits import MAX_HEIGHT
from sins_env.specs import AidSpec, Check, correlation_time


@dataclass(frozen=True)
class HeightSpec(AidSpec):
    """Errors of a barometer; the offset wanders as a first-order Gauss-Markov process."""

    name = "height"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        # Bosch BMP388: +-0.66 m over its range of pressures, about 0.1 m of noise
        "bmp388": {"noise_m": 0.1, "bias_m": 0.66, "bias_s": 600.0},
        # a day of weather
        "weather": {"noise_m": 0.1, "bias_m": 10.0, "bias_s": 3600.0},
    }
    special: ClassVar[Mapping[str, Check]] = {"bias_s": correlation_time}

    noise_m: float = 0.1  #: white noise of a reading
    bias_m: float = 2.0  #: stationary sigma of the offset
    bias_s: float = 600.0  #: its correlation time


class Height(Sensor[HeightSpec]):
    """A batch of barometers."""

    name = "height"
    specification = HeightSpec
    size, limit, what = 1, 2 * MAX_HEIGHT, "m, height"
    sign: ClassVar[float] = 1.0  #: -1 for a depth

    def draw(self, rngs: Rngs) -> None:
        self._bias = self.wandering(self.spec.bias_m, self.spec.bias_s)

    def measure(self, motion: Motion, first_epoch: int) -> Array:
        height = self.sign * motion.state.pos[..., 2:]
        bias = self._bias.samples(height.shape[1])[..., :1]
        return height + bias + self.white(self.spec.noise_m, motion)
