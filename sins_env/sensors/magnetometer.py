"""Magnetometer: the Earth's magnetic field in body axes, with the iron of the vehicle and an unknown declination.

    m = (I + diag d) C' R(delta) m_n + b + n

The hard iron b, the soft iron d and the error delta of the declination are constants of a run.
See docs/mathematics/aiding.md#magnetometer.
"""

from __future__ import annotations

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
from sins_env.specs import AidSpec, Check
from sins_env.units import DEG

UT = 1e-6  #: tesla in a microtesla


@dataclass(frozen=True)
class MagnetometerSpec(AidSpec):
    """Errors of a magnetometer, and the field at the site. Constants are 1-sigma values; each run draws its own."""

    name = "magnetometer"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "calibrated": {},
        "uncalibrated": {"hard_iron_ut": 30.0, "soft_iron": 0.02},
    }
    special: ClassVar[Mapping[str, Check]] = {
        "field_ut": partial(
            checks.numbers, count=3, allowed="three numbers (E, N, U), -100 to 100", least=-100.0, most=100.0
        ),
        "declination_deg": partial(checks.number, least=0.0, most=180.0),
        "soft_iron": partial(checks.number, least=0.0, most=0.5),
    }

    field_ut: tuple[float, ...] = (-1.9, 30.0, -35.0)  #: the magnetic field E, N, U of the model at the site
    noise_ut: float = 0.3  #: white noise of each axis
    hard_iron_ut: float = 5.0  #: offset of each axis
    soft_iron: float = 0.0  #: scale error of each axis
    declination_deg: float = 0.5  #: error of the model's declination


class Magnetometer(Sensor[MagnetometerSpec]):
    """A batch of magnetometers."""

    name = "magnetometer"
    specification = MagnetometerSpec
    size, limit, what = 3, 1e-2, "T, magnetic field along the body's Right, Forward, Up"

    def draw(self, rngs: Rngs) -> None:
        unit, spec = standard_normal(rngs, (7,)), self.spec
        delta = spec.declination_deg * DEG * unit[:, 0]
        east, north, up = spec.field_ut
        c, s = np.cos(delta), np.sin(delta)
        self._field = np.stack([c * east + s * north, c * north - s * east, np.full_like(c, up)], axis=-1)
        self._hard, self._soft = spec.hard_iron_ut * unit[:, 1:4], 1.0 + spec.soft_iron * unit[:, 4:]

    def measure(self, motion: Motion, first_epoch: int) -> Array:
        seen = (attitude.to_dcm(motion.state.q_nb).mT @ self._field[:, None, :, None])[..., 0]
        return UT * (self._soft[:, None] * seen + self._hard[:, None] + self.white(self.spec.noise_ut, motion))
