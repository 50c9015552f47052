"""Two antennas: the baseline between them, as a vector East, North, Up. It tells heading and pitch without any wrap.

    y = C R_U(beta) l_b + m + n

The yaw beta of the baseline's mounting is a constant of a run; the multipath m wanders.
See docs/mathematics/aiding.md#heading.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from sins_env import attitude, checks
from sins_env.arrays import Array, Rngs
from sins_env.motion import Motion
from sins_env.sensors.aids import Sensor
from sins_env.sensors.imu import standard_normal
from sins_env.specs import AidSpec, Check, correlation_time, lever_arm
from sins_env.units import DEG

LEAST_M = 0.01  #: shortest baseline


def _baseline(name: str, given: Any) -> tuple[float, ...]:
    found = lever_arm(name, given)
    if math.hypot(*found) < LEAST_M:
        raise checks.refused(name, given, f"three finite numbers (R, F, U) of a vector of at least {LEAST_M:g} m")
    return found


@dataclass(frozen=True)
class HeadingSpec(AidSpec):
    """Errors of a heading from two antennas. The mounting is a 1-sigma value; each run draws its own."""

    name = "heading"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        # NovAtel OEM7, ALIGN: 0.4, 0.2 and 0.08 deg with baselines of 0.5, 1 and 2 m
        "novatel-0.5m": {"baseline_m": (0.0, 0.5, 0.0), "noise_m": 0.5 * 0.4 * DEG},
        "novatel-1m": {"baseline_m": (0.0, 1.0, 0.0), "noise_m": 1.0 * 0.2 * DEG},
        "novatel-2m": {"baseline_m": (0.0, 2.0, 0.0), "noise_m": 2.0 * 0.08 * DEG},
    }
    special: ClassVar[Mapping[str, Check]] = {
        "baseline_m": _baseline,
        "multipath_s": correlation_time,
        "mounting_deg": partial(checks.number, least=0.0, most=180.0),
    }

    baseline_m: tuple[float, ...] = (0.0, 1.0, 0.0)  #: vector from the first antenna to the second, R, F, U
    noise_m: float = 0.0035  #: white noise of each component
    mounting_deg: float = 0.5  #: yaw of the baseline against the IMU
    multipath_m: float = 0.0  #: stationary sigma of each component of the multipath
    multipath_s: float = 60.0  #: its correlation time


class Heading(Sensor[HeadingSpec]):
    """A batch of pairs of antennas."""

    name = "heading"
    specification = HeadingSpec
    size, limit, what = 3, 1e5, "m, vector from the first antenna to the second, East, North, Up"

    def draw(self, rngs: Rngs) -> None:
        beta = self.spec.mounting_deg * DEG * standard_normal(rngs, (1,))[:, 0]
        right, forward, up = self.spec.baseline_m
        c, s = np.cos(beta), np.sin(beta)
        self._baseline = np.stack([c * right - s * forward, s * right + c * forward, np.full_like(c, up)], axis=-1)
        self._multipath = self.wandering(self.spec.multipath_m, self.spec.multipath_s)

    def measure(self, motion: Motion, first_epoch: int) -> Array:
        seen = (attitude.to_dcm(motion.state.q_nb) @ self._baseline[:, None, :, None])[..., 0]
        return seen + self._multipath.samples(seen.shape[1]) + self.white(self.spec.noise_m, motion)
