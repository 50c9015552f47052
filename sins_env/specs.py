"""Specifications of sensors in the units of datasheets.

Fields carry their unit in their name; properties give SI. The name of a preset (:mod:`sins_env.presets`) or a dict of
fields may stand for a specification; :func:`imu_spec` and :func:`gps_spec` turn them into one. A dict may use other units
and the words of datasheets (:mod:`sins_env.reading.datasheets`): ``{"preset": "mems", "arw_deg_s_sqrt_hz": 0.005}``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from sins_env import checks, moved, presets
from sins_env.arrays import Array
from sins_env.checks import build, unknown
from sins_env.reading.datasheets import in_own_units
from sins_env.units import DEG_PER_SQRT_H, UG

__all__ = ["GPS_PRESETS", "IMU_PRESETS", "AidSpec", "GpsSpec", "ImuSpec", "gps_spec", "imu_spec"]

#: Units and priors lived here in version 0.1.0, and imports from here still find them.
__getattr__ = moved.forward(__name__, ("sins_env.units", "sins_env.prior"))

Check = Callable[[str, Any], Any]  #: check of a field: takes its name and what was given, returns the value or raises
S = TypeVar("S", bound="ImuSpec | GpsSpec | AidSpec")


MOST = 1e9  #: largest error of any sensor, in the unit of its field
MOST_OUTAGES = 1000
_INTERVAL = "(start, end) in s, 0 <= start < end"

_not_negative = partial(checks.number, allowed=f"a finite number, not negative, at most {MOST:g}", least=0.0, most=MOST)
correlation_time = partial(
    checks.number, allowed="a positive correlation time in seconds, 1e-6 to 1e12", least=1e-6, most=1e12
)
#: Check of a vector in body axes, m.
lever_arm = partial(
    checks.numbers, count=3, allowed="three finite numbers (R, F, U), -1e4 to 1e4", least=-1e4, most=1e4
)


def _one_or_three(name: str, given: Any) -> float | tuple[float, ...]:
    allowed = f"one finite number or three (E, N, U), not negative, at most {MOST:g}"
    if checks.items(given) is None:
        return checks.number(name, given, allowed, least=0.0, most=MOST)
    return checks.numbers(name, given, 3, allowed, least=0.0, most=MOST)


def intervals(name: str, given: Any) -> tuple[tuple[float, float], ...]:
    pairs = checks.items(given)
    if pairs is None or len(pairs) > MOST_OUTAGES:
        raise checks.refused(name, given, f"a list of {_INTERVAL}, at most {MOST_OUTAGES} of them")
    return tuple(checks.interval(f"{name} = {checks.shown(given)}: interval", pair, _INTERVAL) for pair in pairs)


def _duration_or_interval(name: str, given: Any) -> float | tuple[float, float]:
    allowed = f"a duration in s, not negative, or {_INTERVAL}"
    if checks.items(given) is None:
        return checks.number(name, given, allowed, least=0.0, most=MOST)
    return checks.interval(name, given, allowed)


def durations_or_intervals(name: str, given: Any) -> float | tuple[tuple[float, float], ...]:
    if checks.items(given) is not None:
        return intervals(name, given)
    return checks.number(
        name, given, f"a mean duration in s, not negative, or a list of {_INTERVAL}", least=0.0, most=MOST
    )


_age = partial(checks.number, allowed="a number of seconds, 0 to 1", least=0.0, most=1.0)


def _degrees_of_freedom(name: str, given: Any) -> float:
    allowed = "0, which is Gaussian, or a number of degrees of freedom, not negative, from 0.1 to 1e9"
    value = checks.number(name, given, allowed, least=0.0, most=MOST)
    return value if value == 0 else checks.number(name, given, allowed, least=0.1)


def _check_fields(spec: Any, special: Mapping[str, Check]) -> None:
    """Replace every field by what its check returns: plain numbers, and tuples for the lists of JSON."""
    for name in (f.name for f in fields(spec)):
        check = special.get(name, _not_negative)
        object.__setattr__(spec, name, check(f"{type(spec).__name__}.{name}", getattr(spec, name)))


@dataclass(frozen=True)
class ImuSpec:
    """Errors of the inertial sensors. Biases, scale factors and misaligned axes are 1-sigma values; each run draws its own.

    See docs/mathematics/simulation.md#inertial-sensors.

    Raises:
        ValueError: a value that is negative or not finite, or a correlation time of zero.
    """

    gyro_bias_deg_h: float = 0.0  #: constant bias of the gyros
    arw_deg_sqrt_h: float = 0.0  #: angle random walk
    gyro_markov_deg_h: float = 0.0  #: stationary sigma of the gyros' Gauss-Markov bias
    gyro_markov_s: float = 3600.0  #: its correlation time
    accel_bias_ug: float = 0.0  #: constant bias of the accelerometers
    vrw_ug_sqrt_hz: float = 0.0  #: velocity random walk
    accel_markov_ug: float = 0.0  #: stationary sigma of the accelerometers' Gauss-Markov bias
    accel_markov_s: float = 900.0  #: its correlation time
    scale_ppm: float = 0.0  #: scale factors of all sensors
    misalignment_arcsec: float = 0.0  #: angles of misaligned axes of all sensors
    gyro_lsb_arcsec: float = 0.0  #: weight of a gyro pulse; 0 does not quantise
    accel_lsb_mps: float = 0.0  #: weight of an accelerometer pulse; 0 does not quantise

    def __post_init__(self) -> None:
        _check_fields(self, {"gyro_markov_s": correlation_time, "accel_markov_s": correlation_time})

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
    """Errors of the fixes. See docs/mathematics/simulation.md#fixes.

    Raises:
        ValueError: any value out of its range.
    """

    vel_std_mps: float | tuple[float, ...] = 0.1  #: standard deviation of the velocity, one number or (E, N, U)
    pos_std_m: float | tuple[float, ...] = 10.0  #: standard deviation of the position, one number or (E, N, U)
    rate_hz: float = 10.0
    lever_arm_m: tuple[float, ...] = (0.0, 0.0, 0.0)  #: vector from the IMU to the antenna, R, F, U
    outages_s: tuple[tuple[float, float], ...] = ()  #: intervals (start, end) without fixes
    contamination: float = 0.0  #: share of fixes with a greater variance of all their errors
    contamination_factor: float = 10.0  #: ratio of their variance to the ordinary one
    heavy_tail_dof: float = 0.0  #: degrees of freedom of Student-t errors, one factor per fix; 0 is Gaussian
    jump_mps: float = 0.0  #: size of a velocity offset in a horizontal direction that each run draws
    jump_s: float | tuple[float, float] = 0.0  #: interval of the offset, or its duration with a start that is drawn
    spoof_mps2: float = (
        0.0  #: acceleration with which a spoofer pulls the fixes off, in a horizontal direction that is drawn
    )
    spoof_s: float | tuple[float, float] = 0.0  #: interval of the pull, or its duration with a start that is drawn
    velocity: bool = True  #: whether a fix has a velocity beside its position
    age_s: float = 0.0  #: how old a fix is at the end of the epoch that holds it: made within it, or delivered late
    age_jitter_s: float = 0.0  #: spread of the age: fixes are between ``age_s`` and this much older

    def __post_init__(self) -> None:
        special: dict[str, Check] = {
            "vel_std_mps": _one_or_three,
            "pos_std_m": _one_or_three,
            "rate_hz": partial(checks.number, allowed="a positive number, 1e-6 to 1e4", least=1e-6, most=1e4),
            "lever_arm_m": lever_arm,
            "outages_s": intervals,
            "contamination": partial(checks.number, allowed="a number from 0 to 1", least=0.0, most=1.0),
            "heavy_tail_dof": _degrees_of_freedom,
            **dict.fromkeys(("jump_s", "spoof_s"), _duration_or_interval),
            "spoof_mps2": partial(checks.number, allowed="a number of m/s^2, 0 to 100", least=0.0, most=100.0),
            "velocity": checks.flag,
            **dict.fromkeys(("age_s", "age_jitter_s"), _age),
        }
        _check_fields(self, special)
        if bool(self.spoof_mps2) != bool(self.spoof_s):
            raise ValueError(
                f"GpsSpec.spoof_mps2 = {self.spoof_mps2:g} with spoof_s = {checks.shown(self.spoof_s)}; allowed: both or neither"
            )

    @property
    def vel_std(self) -> Array:
        """Standard deviation of the velocity E, N, U, m/s, (3,)."""
        return np.broadcast_to(np.asarray(self.vel_std_mps, dtype=float), (3,)).copy()

    @property
    def pos_std(self) -> Array:
        """Standard deviation of the position E, N, U, m, (3,)."""
        return np.broadcast_to(np.asarray(self.pos_std_m, dtype=float), (3,)).copy()

    @property
    def oldest_s(self) -> float:
        """The age of the oldest fix, s; 0 if all fixes are made at the ends of epochs."""
        return self.age_s + self.age_jitter_s

    def told(self, vel_std_mps: float | tuple[float, ...] | None = None) -> GpsSpec:
        """Return what estimators are told: the same without outages, jumps and spoofing, which come as surprises."""
        vel = self.vel_std_mps if vel_std_mps is None else vel_std_mps
        spared: dict[str, Any] = dict.fromkeys(("jump_mps", "jump_s", "spoof_mps2", "spoof_s"), 0.0)
        return replace(self, outages_s=(), vel_std_mps=vel, **spared)


def _rate(name: str, given: Any) -> float | None:
    allowed = "a positive number, 1e-6 to 1e4, or None for every epoch"
    return None if given is None else checks.number(name, given, allowed, least=1e-6, most=1e4)


@dataclass(frozen=True)
class AidSpec:
    """Errors of an aiding sensor, in the units of its datasheet. Each file of :mod:`sins_env.sensors` defines its own.

    Raises:
        ValueError: any value out of its range.
    """

    name: ClassVar[str]  #: name of the sensor: in the setting ``aids``, and of its reading in an observation
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}  #: fields of named devices
    special: ClassVar[Mapping[str, Check]] = {}  #: checks of fields that are no numbers from 0 on
    faults: ClassVar[tuple[str, ...]] = ()  #: fields of faults of simulated sensors, of which estimators are not told

    rate_hz: float | None = None  #: rate of the readings; None: one at the end of every epoch
    outages_s: tuple[tuple[float, float], ...] = ()  #: intervals (start, end) without readings

    def __post_init__(self) -> None:
        _check_fields(self, {"rate_hz": _rate, "outages_s": intervals, **self.special})

    @classmethod
    def of(cls, given: Any) -> Self:
        """Make a specification from the name of a preset or a dict of fields; a specification is returned as it is.

        Raises:
            ValueError: an unknown preset or field (the nearest name is offered), or a value out of range.
        """
        return _resolve(given, cls, {name: cls(**values) for name, values in cls.presets.items()}, cls())

    def told(self) -> Self:
        """Return what estimators are told: the same without outages and faults, which come as surprises."""
        hidden = ("outages_s", *self.faults)
        spared: dict[str, Any] = {one.name: one.default for one in fields(self) if one.name in hidden}
        return replace(self, **spared)

    @property
    def faulty(self) -> tuple[str, ...]:
        """Names of the fields of faults that are not as they are without a fault."""
        at_rest = self.told()
        return tuple(name for name in self.faults if getattr(self, name) != getattr(at_rest, name))


#: Inertial sensors by name.
IMU_PRESETS: dict[str, ImuSpec] = {name: ImuSpec(**values) for name, values in presets.IMU.items()}
#: Receivers of fixes by name.
GPS_PRESETS: dict[str, GpsSpec] = {name: GpsSpec(**values) for name, values in presets.GPS.items()}


def imu_spec(given: str | Mapping[str, Any] | ImuSpec, base: ImuSpec | None = None) -> ImuSpec:
    """Make a specification from the name of a preset or a dict of fields; a specification is returned as it is.

    Fields that a dict leaves out are those of its ``preset``, else those of ``base``, by default a perfect sensor. Its keys
    are fields, fields with another unit at their end, or words of datasheets: ``{"preset": "navigation",
    "vrw_mps_sqrt_h": 0.03, "gyro_bias_instability_deg_h": 0.01}`` (:func:`sins_env.reading.datasheets.in_own_units`). A
    text of the command line becomes such a dict by :func:`sins_env.reading.datasheets.told`.

    Raises:
        ValueError: an unknown preset or field (the nearest name is offered), or a value out of range.
    """
    return _resolve(given, ImuSpec, IMU_PRESETS, base or IMU_PRESETS["perfect"])


def gps_spec(given: str | Mapping[str, Any] | GpsSpec, base: GpsSpec | None = None) -> GpsSpec:
    """Make a specification of fixes in the same way as :func:`imu_spec`; ``base`` is by default the ``thesis`` preset.

    Raises:
        ValueError: an unknown preset or field (the nearest name is offered), or a value out of range.
    """
    return _resolve(given, GpsSpec, GPS_PRESETS, base or GPS_PRESETS["thesis"])


def _resolve(given: Any, cls: type[S], named: Mapping[str, S], base: S) -> S:
    kind = f"{getattr(cls, 'name', cls.__name__[:3].upper())} preset"
    if isinstance(given, cls):
        return given
    if isinstance(given, str):
        if given not in named:
            raise unknown(kind, given, named)
        return named[given]
    if not isinstance(given, Mapping):
        raise ValueError(
            f"{kind}: {checks.shown(given)}; allowed: a preset's name, a dict of {cls.__name__} fields, a {cls.__name__}"
        )
    settings = dict(given)
    if "preset" in settings:
        base = _resolve(str(settings.pop("preset")), cls, named, base)
    own = {f.name: getattr(base, f.name) for f in fields(cls)}
    converted = in_own_units(settings, own, cls.__name__)
    try:
        return build(cls, {**own, **converted.values}, cls.__name__)
    except ValueError as error:
        raise ValueError(converted.with_origins(str(error))) from None
