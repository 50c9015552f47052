"""Doppler log (DVL): the velocity over ground, or through the water, along its own axes.

    y = (1 + k) (I - [alpha x]) (C' (v - c) + omega_eb x l) + n

The scale error k and the mounting angles alpha are constants of a run. The current c, E and N, is zero for a bottom track and
wanders for a water track. See docs/mathematics/aiding.md#doppler-log.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from sins_env import checks
from sins_env.arrays import Array, Rngs
from sins_env.motion import Motion
from sins_env.sensors.aids import Sensor
from sins_env.sensors.imu import standard_normal
from sins_env.sensors.limits import MAX_SPEED
from sins_env.specs import AidSpec, Check, correlation_time, lever_arm
from sins_env.units import PPM

TRACKS = ("bottom", "water")  #: allowed values of ``track``


@dataclass(frozen=True)
class DvlSpec(AidSpec):
    """Errors of a Doppler log. Scale error and mounting angles are 1-sigma values; each run draws its own."""

    name = "dvl"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "bottom": {},
        "water": {"track": "water"},
        # Water Linked A50: long-term accuracy of 1 %, or 0.1 % in the version "Performance"
        "a50": {"scale_ppm": 10_000.0},
        "a50-performance": {"scale_ppm": 1000.0},
        # DP-D300A: 0.3 % and 3 mm/s
        "dp-d300a": {"scale_ppm": 3000.0, "noise_mps": 0.003},
    }
    special: ClassVar[Mapping[str, Check]] = {
        "track": partial(checks.choice, allowed=TRACKS),
        "lever_arm_m": lever_arm,
        "current_s": correlation_time,
    }

    noise_mps: float = 0.01  #: white noise of each axis
    scale_ppm: float = 2000.0  #: scale error
    mounting_mrad: float = 3.0  #: angles of its axes about R, F, U of the IMU
    lever_arm_m: tuple[float, ...] = (0.0, 0.0, 0.0)  #: vector from the IMU to the log, R, F, U
    track: str = "bottom"  #: "bottom" or "water"
    current_mps: float = 0.2  #: stationary sigma of each component of the current, for a water track
    current_s: float = 1800.0  #: its correlation time


class Dvl(Sensor[DvlSpec]):
    """A batch of Doppler logs."""

    name = "dvl"
    specification = DvlSpec
    size, limit, what = 3, 2 * MAX_SPEED, "m/s, velocity along the axes Right, Forward, Up of the Doppler log"

    def draw(self, rngs: Rngs) -> None:
        unit, spec = standard_normal(rngs, (4,)), self.spec
        self._scale = 1.0 + spec.scale_ppm * PPM * unit[:, 0]
        self._mounting = 1e-3 * spec.mounting_mrad * unit[:, 1:]
        self._current = self.wandering(spec.current_mps if spec.track == "water" else 0.0, spec.current_s)

    def measure(self, motion: Motion, first_epoch: int) -> Array:
        current = self._current.samples(motion.state.vel.shape[1]) * [1.0, 1.0, 0.0]
        y = self.body_velocity(motion, np.asarray(self.spec.lever_arm_m), current)
        y = y - np.cross(self._mounting[:, None], y)
        return self._scale[:, None, None] * y + self.white(self.spec.noise_mps, motion)
