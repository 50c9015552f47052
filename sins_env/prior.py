"""The prior: initial covariance, process noise and measurement noise that every estimator is told beforehand."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sins_env.arrays import Array
from sins_env.specs import IMU_PRESETS, GpsSpec, ImuSpec
from sins_env.states import ERRORS, FIX
from sins_env.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, UG

__all__ = ["PRIORS", "Prior", "matched_prior", "thesis_prior"]


@dataclass(frozen=True)
class Prior:
    """The assumed spread of the start, the assumed process noise, and the assumed noise of the fixes.

    ``P0`` and ``Q`` have the layout :data:`sins_env.states.ERRORS` of 15 errors: phi E, N, U (rad), velocity E, N, U (m/s),
    position E, N, U (m), gyro bias R, F, U (rad/s), accelerometer bias R, F, U (m/s^2). ``R`` has the layout ``FIX``:
    velocity (m/s), position (m). ``Q`` is per epoch. The arrays are read-only, because every run is told the same ones. See
    docs/mathematics/frames.md#state-layout.
    """

    attitude_std_deg: tuple[float, ...]
    velocity_std_mps: float
    position_std_m: float
    gyro_bias_std_deg_h: float
    accel_bias_std_ug: float
    arw_deg_sqrt_h: float
    vrw_ug_sqrt_hz: float
    gps_vel_std_mps: tuple[float, ...]
    gps_pos_std_m: tuple[float, ...]
    epoch_s: float

    @cached_property
    def P0(self) -> Array:
        """Covariance of the errors at the start, (15, 15)."""
        std: dict[str, ArrayLike] = {
            "phi": np.asarray(self.attitude_std_deg) * DEG,
            "dv": self.velocity_std_mps,
            "dp": self.position_std_m,
            "gyro_bias": self.gyro_bias_std_deg_h * DEG_PER_H,
            "accel_bias": self.accel_bias_std_ug * UG,
        }
        return _frozen(np.diag(np.square(ERRORS.values(std))))

    @cached_property
    def Q(self) -> Array:
        """Covariance of the process noise of one epoch, (15, 15): diag(N^2, VRW^2, 0, 0, 0) epoch."""
        std = {"phi": self.arw_deg_sqrt_h * DEG_PER_SQRT_H, "dv": self.vrw_ug_sqrt_hz * UG}
        return _frozen(np.diag(np.square(ERRORS.values(std))) * self.epoch_s)

    @cached_property
    def R(self) -> Array:
        """Covariance of a fix, (6, 6): velocity in m/s, position in m."""
        std = {"dv": self.gps_vel_std_mps, "dp": self.gps_pos_std_m}
        return _frozen(np.diag(np.square(FIX.values(std))))

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields without the arrays, which would arrive writeable in a copy or in another process."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array


#: Standard deviations of the misalignment E, N, U at a told start, both drawn and told.
TOLD_START_STD_DEG = (1.0, 1.0, 15.0)
#: Assumed standard deviation of a heading that is drawn over the circle.
ANY_HEADING_STD_DEG = 180.0 / math.sqrt(3.0)
#: Assumed standard deviations of the misalignment E, N, U after coarse alignment.
COARSE_STD_DEG = (0.1, 0.1, 2.0)
#: Assumed standard deviations of the misalignment E, N, U of a level from the specific force of one epoch, at any heading.
SWITCH_ON_STD_DEG = (3.0, 3.0, ANY_HEADING_STD_DEG)
START_VELOCITY_STD_MPS = 0.2
#: Standard deviation of the velocity of fixes that are positions alone: anything that a vehicle may do.
NO_VELOCITY_STD_MPS = 100.0


def matched_prior(imu: ImuSpec, gps: GpsSpec, epoch_s: float, attitude_std_deg: tuple[float, ...]) -> Prior:
    """Return the prior that states what the environment draws; a Gauss-Markov bias adds its stationary variance.

    A perfect sensor has the biases of the preset "navigation" over 1000 instead of zero, so that P0 can be inverted. The
    noise of perfect fixes is 1e-4 m/s and 1e-3 m, so that R can be inverted.
    See docs/mathematics/simulation.md#told-priors.
    """
    floor = IMU_PRESETS["navigation"]
    return Prior(
        attitude_std_deg=attitude_std_deg,
        velocity_std_mps=START_VELOCITY_STD_MPS,
        position_std_m=float(max(gps.pos_std.max(), 1e-3)),
        gyro_bias_std_deg_h=max(math.hypot(imu.gyro_bias_deg_h, imu.gyro_markov_deg_h), 1e-3 * floor.gyro_bias_deg_h),
        accel_bias_std_ug=max(math.hypot(imu.accel_bias_ug, imu.accel_markov_ug), 1e-3 * floor.accel_bias_ug),
        arw_deg_sqrt_h=imu.arw_deg_sqrt_h,
        vrw_ug_sqrt_hz=imu.vrw_ug_sqrt_hz,
        gps_vel_std_mps=tuple(np.maximum(gps.vel_std, 1e-4).tolist()) if gps.velocity else (NO_VELOCITY_STD_MPS,) * 3,
        gps_pos_std_m=tuple(np.maximum(gps.pos_std, 1e-3).tolist()),
        epoch_s=epoch_s,
    )


def thesis_prior(imu: ImuSpec, gps: GpsSpec, epoch_s: float, attitude_std_deg: tuple[float, ...]) -> Prior:
    """Return the prior of 000 section 2.5.4 in reading C: (5e-4 g)^2 and (0.01 deg/h)^2 at each step of 100 Hz.

    Reading C takes the printed numbers as covariances in (m/s)^2 and rad^2 per step. One hundred steps per second turn
    them into densities of 10 x 5e-4 g and 10 x (0.01 deg/h in rad) per sqrt(s). R is (0.1 m/s)^2.
    See docs/mathematics/simulation.md#told-priors.
    """
    return replace(
        matched_prior(imu, gps, epoch_s, attitude_std_deg),
        gyro_bias_std_deg_h=0.02,
        accel_bias_std_ug=200.0,
        arw_deg_sqrt_h=10 * 0.01 * DEG_PER_H / DEG_PER_SQRT_H,
        vrw_ug_sqrt_hz=10 * 500.0,
        gps_vel_std_mps=(0.1, 0.1, 0.1),
    )


#: The ways to a prior, by name: matched to the assumed sensors, or as the thesis states it.
PRIORS = {"matched": matched_prior, "thesis": thesis_prior}
