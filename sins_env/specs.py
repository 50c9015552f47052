"""Sensors and priors in the units of datasheets.

Fields carry their unit in their name; properties give SI. A preset's name (:mod:`sins_env.presets`) or a dict of
fields is accepted wherever a spec is asked for (:func:`imu_spec`, :func:`gps_spec`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sins_env import checks, presets
from sins_env.errors import build, unknown

Array = NDArray[np.float64]
Check = Callable[[str, Any], Any]  #: name, given -> the value; raises
S = TypeVar("S", "ImuSpec", "GpsSpec")

G0 = 9.80665  #: m/s^2, the "g" of sensor specifications
DEG = math.pi / 180.0
ARCSEC = DEG / 3600.0
DEG_PER_H = DEG / 3600.0  #: rad/s
DEG_PER_SQRT_H = DEG / 60.0  #: rad/sqrt(s)
UG = 1e-6 * G0  #: m/s^2, and m/s/sqrt(s) for micro-g per sqrt(Hz)
PPM = 1e-6


_INTERVAL = "(start, end) in s, 0 <= start < end"

_not_negative = partial(checks.number, allowed="a finite number, not negative", least=0.0)
_correlation_time = partial(checks.number, allowed="a positive correlation time in seconds", above=0.0)


def _one_or_three(name: str, given: Any) -> float | tuple[float, ...]:
    allowed = "one finite number or three (E, N, U), not negative"
    if checks.items(given) is None:
        return checks.number(name, given, allowed, least=0.0)
    return checks.numbers(name, given, 3, allowed, least=0.0)


def _intervals(name: str, given: Any) -> tuple[tuple[float, float], ...]:
    pairs = checks.items(given)
    if pairs is None:
        raise checks.refused(name, given, f"a list of {_INTERVAL}")
    return tuple(checks.interval(f"{name} = {given!r}: interval", pair, _INTERVAL) for pair in pairs)


def _duration_or_interval(name: str, given: Any) -> float | tuple[float, float]:
    allowed = f"a duration in s, not negative, or {_INTERVAL}"
    if checks.items(given) is None:
        return checks.number(name, given, allowed, least=0.0)
    return checks.interval(name, given, allowed)


def _check_fields(spec: Any, special: Mapping[str, Check]) -> None:
    """Every field becomes what its check returns: plain numbers, and tuples of the lists of JSON."""
    for name in (f.name for f in fields(spec)):
        check = special.get(name, _not_negative)
        object.__setattr__(spec, name, check(f"{type(spec).__name__}.{name}", getattr(spec, name)))


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
        _check_fields(self, {"gyro_markov_s": _correlation_time, "accel_markov_s": _correlation_time})

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
        special: dict[str, Check] = {
            "vel_std_mps": _one_or_three,
            "pos_std_m": _one_or_three,
            "rate_hz": partial(checks.number, allowed="a positive number", above=0.0),
            "lever_arm_m": partial(checks.numbers, count=3, allowed="three finite numbers (R, F, U)"),
            "outages_s": _intervals,
            "contamination": partial(checks.number, allowed="a number from 0 to 1", least=0.0, most=1.0),
            "jump_s": _duration_or_interval,
        }
        _check_fields(self, special)

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
    The arrays are read-only, for every run is told the same ones.
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
        return _frozen(np.diag(np.square(std)))

    @cached_property
    def Q(self) -> Array:
        """(15, 15) covariance of the noise of one epoch: diag(N^2, VRW^2, 0, 0, 0) epoch."""
        std = [self.arw_deg_sqrt_h * DEG_PER_SQRT_H] * 3 + [self.vrw_ug_sqrt_hz * UG] * 3 + [0.0] * 9
        return _frozen(np.diag(np.square(std)) * self.epoch_s)

    @cached_property
    def R(self) -> Array:
        """(6, 6) covariance of a fix: velocity m/s, position m."""
        return _frozen(np.diag(np.square([*self.gps_vel_std_mps, *self.gps_pos_std_m])))

    def __getstate__(self) -> dict[str, Any]:
        """Without the arrays, which a copy or another process would get writeable."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array


#: 1-sigma start errors that the environment draws and the matched prior tells.
TOLD_START_STD_DEG = (1.0, 1.0, 15.0)
#: Told spread of a heading that is drawn over the circle.
ANY_HEADING_STD_DEG = 180.0 / math.sqrt(3.0)
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
        gps_vel_std_mps=tuple(np.maximum(gps.vel_std, 1e-4).tolist()),
        gps_pos_std_m=tuple(np.maximum(gps.pos_std, 1e-3).tolist()),
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

IMU_PRESETS: dict[str, ImuSpec] = {name: ImuSpec(**values) for name, values in presets.IMU.items()}
GPS_PRESETS: dict[str, GpsSpec] = {name: GpsSpec(**values) for name, values in presets.GPS.items()}


def imu_spec(given: str | Mapping[str, Any] | ImuSpec, base: ImuSpec | None = None) -> ImuSpec:
    """A preset's name, a dict of fields, or a spec.

    Fields that a dict leaves out are those of its ``preset``, else of ``base``, by default a perfect sensor.

    Raises:
        ValueError: an unknown preset or field (the nearest name is offered), or a value out of range.
    """
    return _resolve(given, ImuSpec, IMU_PRESETS, base or IMU_PRESETS["perfect"])


def gps_spec(given: str | Mapping[str, Any] | GpsSpec, base: GpsSpec | None = None) -> GpsSpec:
    """As :func:`imu_spec`; ``base`` is by default the ``thesis`` preset."""
    return _resolve(given, GpsSpec, GPS_PRESETS, base or GPS_PRESETS["thesis"])


def _resolve(given: Any, cls: type[S], named: Mapping[str, S], base: S) -> S:
    kind = f"{cls.__name__[:3].upper()} preset"
    if isinstance(given, cls):
        return given
    if isinstance(given, str):
        if given not in named:
            raise unknown(kind, given, named)
        return named[given]
    if not isinstance(given, Mapping):
        raise ValueError(
            f"{kind}: {given!r}; allowed: a preset's name, a dict of {cls.__name__} fields, a {cls.__name__}"
        )
    settings = dict(given)
    if "preset" in settings:
        base = _resolve(str(settings.pop("preset")), cls, named, base)
    return build(cls, {**{f.name: getattr(base, f.name) for f in fields(cls)}, **settings}, cls.__name__)
