"""Odometer: the distance that a wheel has rolled in an epoch, and a car that neither slips sideways nor leaves the road.

    distance = T (1 + k) y_forward + n,   y = C_b^m (C' v + omega_eb x l),   y_right = y_up = 0 (non-holonomic constraint)

y_forward is its mean over the epoch, because a wheel counts. The scale error k and the angles of the IMU in the car, pitch and
yaw, are constants of a run. The car keeps to its constraint; the IMU is what sits crooked. A wheel may slip, in stated intervals
and with the acceleration.
See docs/mathematics/aiding.md#odometer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from sins_env import attitude, checks, earth
from sins_env.arrays import Array, Rngs
from sins_env.motion import Motion
from sins_env.sensors.aids import Sensor
from sins_env.sensors.gps import within
from sins_env.sensors.imu import standard_normal
from sins_env.specs import AidSpec, Check, intervals, lever_arm
from sins_env.types import NavState
from sins_env.units import PPM


@dataclass(frozen=True)
class OdometerSpec(AidSpec):
    """Errors of an odometer, and the non-holonomic constraint of its car. Scale and mounting are 1-sigma values of a run.

    ``nhc`` says whether estimators are told that the velocity across the car is zero, with ``lateral_mps`` and
    ``vertical_mps`` as assumed noise at every epoch.

    A wheel that slips rolls 1 + s times the way. In the intervals ``slip_s`` s is ``slip``: above 0 where it spins, -1 where it
    is locked. A driven wheel adds ``slip_per_mps2`` times the acceleration forwards, and brakes with less than the way.
    Tyres need a slip angle for the force of a turn, ``slip_mrad_per_mps2`` times the acceleration to the side: 2 to 4 on roads.
    """

    name = "odometer"
    faults = ("slip", "slip_s", "slip_per_mps2", "slip_mrad_per_mps2")
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "calibrated": {"scale_ppm": 1000.0},
        # 48 pulses of an anti-lock brake sensor to a turn of 1.95 m
        "abs-48": {"scale_ppm": 3000.0, "noise_mps": 0.0, "pulse_m": 1.95 / 48},
    }
    special: ClassVar[Mapping[str, Check]] = {
        "lever_arm_m": lever_arm,
        "nhc": checks.flag,
        "slip": partial(checks.number, allowed="a share of the way, -1 to 10", least=-1.0, most=10.0),
        "slip_s": intervals,
        "slip_mrad_per_mps2": partial(
            checks.number, allowed="an angle in mrad per m/s^2, 0 to 100", least=0.0, most=100.0
        ),
        "slip_per_mps2": partial(checks.number, allowed="a share of the way per m/s^2, 0 to 1", least=0.0, most=1.0),
        **dict.fromkeys(("lateral_mps", "vertical_mps"), partial(checks.number, least=1e-6, most=1e3)),
    }

    noise_mps: float = 0.05  #: white noise of the speed
    scale_ppm: float = 3000.0  #: scale error
    mounting_mrad: float = 5.0  #: pitch and yaw of the IMU in the car
    lever_arm_m: tuple[float, ...] = (
        0.0,
        0.0,
        0.0,
    )  #: vector from the IMU to the middle of the unsteered axle, R, F, U
    pulse_m: float = 0.0  #: distance of a pulse; 0 does not quantise
    nhc: bool = True  #: whether the non-holonomic constraint is told
    lateral_mps: float = 0.05  #: assumed noise of the sideways velocity
    vertical_mps: float = 0.05  #: assumed noise of the vertical velocity
    slip: float = 0.1  #: share by which the wheel rolls more than the way in the intervals ``slip_s``
    slip_s: tuple[tuple[float, float], ...] = ()  #: intervals (start, end) in which it does
    slip_per_mps2: float = 0.0  #: the same share for each m/s^2 of acceleration forwards, at all times
    slip_mrad_per_mps2: float = 0.0  #: slip angle of the car sideways for each m/s^2 of acceleration to the side


class Odometer(Sensor[OdometerSpec]):
    """A batch of odometers."""

    name = "odometer"
    specification = OdometerSpec
    size, limit, what = 1, 1e8, "m, distance rolled in the epoch"

    def draw(self, rngs: Rngs) -> None:
        unit, spec = standard_normal(rngs, (3,)), self.spec
        self._scale = 1.0 + spec.scale_ppm * PPM * unit[:, 0]
        angles = 1e-3 * spec.mounting_mrad * np.stack([unit[:, 1], np.zeros(len(unit)), unit[:, 2]], axis=-1)
        self.mounting = attitude.from_rotvec(-angles)
        self._to_car = attitude.to_dcm(self.mounting)
        self._phase = np.array([rng.random() for rng in rngs])  # of a pulse
        self._rolled = np.zeros(len(unit))
        self._rate_ie = earth.rate_n(self.earth, self.site.latitude)

    @property
    def slip_angle(self) -> float:  # type: ignore[override]
        return 1e-3 * self.spec.slip_mrad_per_mps2

    def begin(self, truth: NavState) -> None:
        self._before = (attitude.to_dcm(truth.q_nb).mT @ truth.vel[..., None])[..., 0]

    def measure(self, motion: Motion, first_epoch: int) -> Array:
        C, T, spec = attitude.to_dcm(motion.state.q_nb), self.epoch_s, self.spec
        ends = np.concatenate([self._before[:, None], self.body_velocity(motion, np.zeros(3))], axis=1)
        self._before = ends[:, -1]
        rate = motion.dtheta.sum(axis=2) / T - (C.mT @ self._rate_ie)
        mean = 0.5 * (ends[:, 1:] + ends[:, :-1]) + np.cross(rate, np.asarray(spec.lever_arm_m))
        forward = (self._to_car[:, None] @ mean[..., None])[..., 1, :]
        if spec.slip_s or spec.slip_per_mps2:
            gained = (self._to_car[:, None] @ np.diff(ends, axis=1)[..., None])[..., 1, :]
            spins = spec.slip * within(spec.slip_s, self.ends(first_epoch, forward.shape[1]))
            forward = forward * (1.0 + spins[:, None] + spec.slip_per_mps2 * gained / T)
        rolled: Array = T * (self._scale[:, None, None] * forward + self.white(spec.noise_mps, motion))
        return self._counted(rolled) if spec.pulse_m else rolled

    def _counted(self, rolled: Array) -> Array:
        """Return the distances (runs, epochs, 1) in whole pulses, the rest of which is carried on."""
        total = np.cumsum(np.concatenate([self._rolled[:, None], rolled[..., 0]], axis=1), axis=1)
        self._rolled = total[:, -1]
        pulses = np.floor(total / self.spec.pulse_m + self._phase[:, None])
        return self.spec.pulse_m * np.diff(pulses, axis=1)[..., None]
