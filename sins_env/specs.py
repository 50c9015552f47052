"""Sensors and priors in the units of datasheets, and the named presets.

Fields carry their unit in their name; properties give SI. A preset or a dict of fields is accepted wherever a spec
is asked for (:func:`imu_spec`, :func:`gps_spec`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sins_env.errors import build, unknown

Array = NDArray[np.float64]
S = TypeVar("S", "ImuSpec", "GpsSpec")

G0 = 9.80665  #: m/s^2, the "g" of sensor specifications
DEG = math.pi / 180.0
ARCSEC = DEG / 3600.0
DEG_PER_H = DEG / 3600.0  #: rad/s
DEG_PER_SQRT_H = DEG / 60.0  #: rad/sqrt(s)
UG = 1e-6 * G0  #: m/s^2, and m/s/sqrt(s) for micro-g per sqrt(Hz)
PPM = 1e-6


def _check_not_negative(spec: Any, names: tuple[str, ...]) -> None:
    for name in names:
        value = getattr(spec, name)
        number = np.asarray(value)
        if number.dtype.kind not in "iuf" or not np.all(np.isfinite(number)) or np.any(number < 0):
            raise ValueError(f"{type(spec).__name__}.{name} = {value!r}; allowed: finite and not negative")


@dataclass(frozen=True)
class ImuSpec:
    """Errors of the inertial sensors. Biases, scale factors and misalignments are 1-sigma values: every run draws its own.

    The Markov terms are first-order Gauss-Markov biases with the given stationary sigma and correlation time. equations.md F.
    """

    gyro_bias_deg_h: float = 0.0
    arw_deg_sqrt_h: float = 0.0
    gyro_markov_deg_h: float = 0.0
    gyro_markov_s: float = 3600.0
    accel_bias_ug: float = 0.0
    vrw_ug_sqrt_hz: float = 0.0
    accel_markov_ug: float = 0.0
    accel_markov_s: float = 900.0
    scale_ppm: float = 0.0
    misalignment_arcsec: float = 0.0
    gyro_lsb_arcsec: float = 0.0
    accel_lsb_mps: float = 0.0

    def __post_init__(self) -> None:
        _check_not_negative(self, tuple(f.name for f in fields(self)))
        for name in ("gyro_markov_s", "accel_markov_s"):
            if getattr(self, name) == 0:
                raise ValueError(f"ImuSpec.{name} = 0; allowed: a positive correlation time in seconds")

    @property
    def arw(self) -> float:
        """Angle random walk, rad/sqrt(s)."""
        return self.arw_deg_sqrt_h * DEG_PER_SQRT_H

    @property
    def vrw(self) -> float:
        """Velocity random walk, m/s/sqrt(s)."""
        return self.vrw_ug_sqrt_hz * UG


@dataclass(frozen=True)
class GpsSpec:
    """Errors of the fixes. ``vel_std_mps`` and ``pos_std_m``: one number, or three for E, N, U.

    ``contamination``: the share of fixes whose whole error vector has ``contamination_factor`` times the variance.
    ``heavy_tail_dof``: Student-t errors with the stds as scale (one common factor per fix); 0 is Gaussian.
    ``jump_mps``: a velocity offset of that size in a horizontal direction drawn per run, during ``jump_s``: a pair
    (start, end) in seconds, or a duration whose start is drawn per run.
    """

    vel_std_mps: float | tuple[float, ...] = 0.1
    pos_std_m: float | tuple[float, ...] = 10.0
    rate_hz: float = 10.0
    lever_arm_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    outages_s: tuple[tuple[float, float], ...] = ()
    contamination: float = 0.0
    contamination_factor: float = 10.0
    heavy_tail_dof: float = 0.0
    jump_mps: float = 0.0
    jump_s: float | tuple[float, float] = 0.0

    def __post_init__(self) -> None:
        for name in ("vel_std_mps", "pos_std_m", "lever_arm_m", "jump_s"):  # lists from JSON become tuples
            value = getattr(self, name)
            if isinstance(value, (list, tuple, np.ndarray)):
                object.__setattr__(self, name, tuple(float(v) for v in value))
        object.__setattr__(self, "outages_s", tuple((float(a), float(b)) for a, b in self.outages_s))
        plain = {f.name for f in fields(self)} - {"lever_arm_m", "outages_s"}
        _check_not_negative(self, tuple(sorted(plain)))
        for name in ("vel_std_mps", "pos_std_m"):
            if np.size(getattr(self, name)) not in (1, 3):
                raise ValueError(f"GpsSpec.{name} = {getattr(self, name)!r}; allowed: one number or three (E, N, U)")
        if len(self.lever_arm_m) != 3 or not np.all(np.isfinite(self.lever_arm_m)):
            raise ValueError(f"GpsSpec.lever_arm_m = {self.lever_arm_m!r}; allowed: three finite numbers (R, F, U)")
        if not 0 <= self.contamination <= 1:
            raise ValueError(f"GpsSpec.contamination = {self.contamination!r}; allowed: 0 to 1")
        if not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError(f"GpsSpec.rate_hz = {self.rate_hz!r}; allowed: positive")
        for start, end in (*self.outages_s, *((self.jump_s,) if isinstance(self.jump_s, tuple) else ())):
            if not 0 <= start < end:
                raise ValueError(f"GpsSpec interval {(start, end)!r}; allowed: (start, end) in s, 0 <= start < end")

    @property
    def vel_std(self) -> Array:
        """(3,) m/s."""
        return np.broadcast_to(np.asarray(self.vel_std_mps, dtype=float), (3,)).copy()

    @property
    def pos_std(self) -> Array:
        """(3,) m East, North, Up."""
        return np.broadcast_to(np.asarray(self.pos_std_m, dtype=float), (3,)).copy()

    def told(self, vel_std_mps: float | tuple[float, ...] | None = None) -> GpsSpec:
        """What an estimator may know: outages and jumps are surprises."""
        vel = self.vel_std_mps if vel_std_mps is None else vel_std_mps
        return replace(self, outages_s=(), jump_mps=0.0, jump_s=0.0, vel_std_mps=vel)


@dataclass(frozen=True)
class Prior:
    """What every estimator is told of the start, the process noise and the fixes.

    ``P0`` and ``Q`` order the 15 errors as phi E N U (rad), velocity E N U (m/s), position E N U (m), gyro bias
    R F U (rad/s), accelerometer bias R F U (m/s^2); ``R`` orders velocity (m/s), position (m). ``Q`` is per epoch.
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
        """(15, 15) covariance of the errors at the start."""
        std = [
            *(np.asarray(self.attitude_std_deg) * DEG),
            *[self.velocity_std_mps] * 3,
            *[self.position_std_m] * 3,
            *[self.gyro_bias_std_deg_h * DEG_PER_H] * 3,
            *[self.accel_bias_std_ug * UG] * 3,
        ]
        return np.diag(np.square(std))

    @cached_property
    def Q(self) -> Array:
        """(15, 15) covariance of the noise of one epoch: diag(N^2, VRW^2, 0, 0, 0) epoch."""
        std = [self.arw_deg_sqrt_h * DEG_PER_SQRT_H] * 3 + [self.vrw_ug_sqrt_hz * UG] * 3 + [0.0] * 9
        return np.diag(np.square(std)) * self.epoch_s

    @cached_property
    def R(self) -> Array:
        """(6, 6) covariance of a fix: velocity m/s, position m."""
        return np.diag(np.square([*self.gps_vel_std_mps, *self.gps_pos_std_m]))


#: 1-sigma start errors that the environment draws and the matched prior tells.
TOLD_START_STD_DEG = (1.0, 1.0, 15.0)
#: Told spread of the attitude after coarse alignment.
COARSE_STD_DEG = (0.1, 0.1, 2.0)
START_VELOCITY_STD_MPS = 0.2


def matched_prior(imu: ImuSpec, gps: GpsSpec, epoch_s: float, attitude_std_deg: tuple[float, ...]) -> Prior:
    """The prior that tells what the environment draws; a Gauss-Markov bias adds its stationary variance.

    A perfect sensor is told a thousandth of the navigation preset instead of zero, so that P0 and R can be inverted.
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
        gps_vel_std_mps=tuple(np.maximum(gps.vel_std, 1e-4)),
        gps_pos_std_m=tuple(np.maximum(gps.pos_std, 1e-3)),
        epoch_s=epoch_s,
    )


def thesis_prior(imu: ImuSpec, gps: GpsSpec, epoch_s: float, attitude_std_deg: tuple[float, ...]) -> Prior:
    """000 section 2.5.4 in reading (C): (5e-4 g)^2 and (0.01 deg/h)^2 added at each 100 Hz step, R = (0.1 m/s)^2.

    Reading (C) takes the printed numbers as covariances in m/s and rad per step (equations.md L). One hundred steps
    per second turn them into densities: 10 x 5e-4 g per sqrt(s), and 10 x (0.01 deg/h in rad) per sqrt(s).
    """
    return replace(
        matched_prior(imu, gps, epoch_s, attitude_std_deg),
        gyro_bias_std_deg_h=0.02,
        accel_bias_std_ug=200.0,
        arw_deg_sqrt_h=10 * 0.01 * DEG_PER_H / DEG_PER_SQRT_H,
        vrw_ug_sqrt_hz=10 * 500.0,
        gps_vel_std_mps=(0.1, 0.1, 0.1),
    )


PRIORS = {"matched": matched_prior, "thesis": thesis_prior}

# 000 section 2.5.3: "white noise 50e-6 g" read as the std of a 100 Hz sample, 5 ug/sqrt(Hz) (equations.md I).
_THESIS = ImuSpec(gyro_bias_deg_h=0.02, arw_deg_sqrt_h=0.01, accel_bias_ug=100.0, vrw_ug_sqrt_hz=5.0)

IMU_PRESETS: dict[str, ImuSpec] = {
    "perfect": ImuSpec(),
    "thesis-white": _THESIS,
    # The accelerometers have the Gauss-Markov bias alone: nabla = GM + white (equations.md S.1, bound.md 5)
    "thesis-markov": replace(
        _THESIS,
        gyro_markov_deg_h=0.1,
        gyro_markov_s=3600.0,
        accel_bias_ug=0.0,
        accel_markov_ug=100.0,
        accel_markov_s=900.0,
    ),
    # 000 chapter 6, with the pulse weights of ../shared/data/rlg_parked_car.npz
    "rlg-car": ImuSpec(
        gyro_bias_deg_h=0.01,
        arw_deg_sqrt_h=0.005,
        accel_bias_ug=100.0,
        vrw_ug_sqrt_hz=5.0,
        gyro_lsb_arcsec=0.1,
        accel_lsb_mps=1.222540875e-3,
    ),
    "navigation": ImuSpec(
        gyro_bias_deg_h=0.005,
        arw_deg_sqrt_h=0.002,
        accel_bias_ug=30.0,
        vrw_ug_sqrt_hz=10.0,
        scale_ppm=5.0,
        misalignment_arcsec=5.0,
    ),
    "tactical": ImuSpec(
        gyro_bias_deg_h=1.0,
        arw_deg_sqrt_h=0.1,
        gyro_markov_deg_h=0.3,
        gyro_markov_s=600.0,
        accel_bias_ug=1000.0,
        vrw_ug_sqrt_hz=100.0,
        accel_markov_ug=50.0,
        accel_markov_s=600.0,
        scale_ppm=300.0,
        misalignment_arcsec=60.0,
    ),
    "mems": ImuSpec(
        gyro_bias_deg_h=20.0,
        arw_deg_sqrt_h=0.3,
        gyro_markov_deg_h=5.0,
        gyro_markov_s=200.0,
        accel_bias_ug=5000.0,
        vrw_ug_sqrt_hz=150.0,
        accel_markov_ug=100.0,
        accel_markov_s=200.0,
        scale_ppm=1000.0,
        misalignment_arcsec=200.0,
    ),
}

GPS_PRESETS: dict[str, GpsSpec] = {
    "perfect": GpsSpec(vel_std_mps=0.0, pos_std_m=0.0),
    "thesis": GpsSpec(vel_std_mps=0.1, pos_std_m=10.0, rate_hz=10.0),
    "dgps": GpsSpec(vel_std_mps=0.03, pos_std_m=(0.5, 0.5, 1.0), rate_hz=10.0),
}


def imu_spec(given: str | Mapping[str, Any] | ImuSpec) -> ImuSpec:
    """A preset's name, a dict of fields (with an optional ``preset`` they start from), or a spec.

    Raises:
        ValueError: an unknown preset or field (the nearest name is offered), or a value out of range.
    """
    return _resolve(given, ImuSpec, IMU_PRESETS, "perfect")


def gps_spec(given: str | Mapping[str, Any] | GpsSpec) -> GpsSpec:
    """As :func:`imu_spec`; fields that a dict leaves out are those of the ``thesis`` preset."""
    return _resolve(given, GpsSpec, GPS_PRESETS, "thesis")


def _resolve(given: Any, cls: type[S], presets: Mapping[str, S], base: str) -> S:
    kind = f"{cls.__name__[:3].upper()} preset"
    if isinstance(given, cls):
        return given
    if isinstance(given, str):
        if given not in presets:
            raise unknown(kind, given, presets)
        return presets[given]
    if not isinstance(given, Mapping):
        raise ValueError(
            f"{kind}: {given!r}; allowed: a preset's name, a dict of {cls.__name__} fields, a {cls.__name__}"
        )
    settings = dict(given)
    start = presets.get(str(settings.get("preset", base)))
    if start is None:
        raise unknown(kind, settings["preset"], presets)
    settings.pop("preset", None)
    return build(cls, {**{f.name: getattr(start, f.name) for f in fields(cls)}, **settings}, cls.__name__)
