"""Keyword arguments of the simulated alignment environments. They are checked here, once, each with one clear error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sins_env import checks, earth
from sins_env.arrays import Array
from sins_env.prior import ANY_HEADING_STD_DEG, COARSE_STD_DEG, PRIORS, SWITCH_ON_STD_DEG, TOLD_START_STD_DEG
from sins_env.sensors.aids import specs as aid_specs
from sins_env.sensors.gps import epochs_per_fix
from sins_env.sensors.limits import MAX_HEIGHT, MAX_SPEED, MAX_TIME
from sins_env.specs import AidSpec, GpsSpec, ImuSpec, gps_spec, imu_spec
from sins_env.types import Site, Task
from sins_env.units import DEG

STARTS = ("unknown", "told")  #: allowed values of ``start``
MOST_ANGLE_DEG = 1e6  #: largest heading, so that no turn is lost in rounding
LEAST_EPOCH_S, MOST_EPOCH_S, MOST_SAMPLES = 1e-4, 3600.0, 10_000  #: limits of an epoch, s, and of its IMU samples
LONGITUDE_DEG = 116.3  #: Beijing, an assumption, for 000 names no place; see docs/mathematics/simulation.md#presets


class Timed:
    """Settings whose ``duration`` and ``coarse`` may be given as None, and are numbers after the check."""

    duration: float | None
    coarse: float | None

    @property
    def duration_s(self) -> float:
        """Length of an episode, s, with the coarse phase."""
        assert self.duration is not None
        return self.duration

    @property
    def coarse_s(self) -> float:
        """Length of the coarse phase, s."""
        assert self.coarse is not None
        return self.coarse


@dataclass(frozen=True)
class SimulationSettings(Timed):
    """Settings that all simulated bases share. Values are those that JSON can hold.

    ``duration``, s, includes the ``coarse`` phase, s. A ``coarse`` of None is 120 s (a car 90 s) for an unknown start and
    0 for a told one. With an unknown start and a ``coarse`` of 0, estimators begin at switch-on. A ``duration`` of None leaves
    360 s (a car 210 s) for the fine phase.

    ``imu`` and ``gps`` are the name of a preset or a dict of fields. ``aids`` are further sensors by name, each with one of these.

    ``misalignment_deg`` fixes the misalignment of a told start, E, N, U. None draws it from the prior. ``any_heading``
    draws the told heading over the circle, and the prior says so.

    ``attitude_std_deg`` (E, N, U) and ``velocity_std_mps`` are 1 sigma of the told start, which the prior states; None is
    1, 1 and 15 deg, and 0.2 m/s. ``told`` is a dict of what solvers are told where it differs from the truth: ``imu``, ``gps``,
    or both. Each is like the setting of that name, and replaces its fields.

    ``latitude_deg``, ``longitude_deg`` and ``height_m`` are the place. ``heading_deg`` is the mean heading. None draws it over
    the circle in each run. A list of headings makes one record of each, and ``reset(options={"record": i})`` picks a record;
    without this option the seed of a run draws one. In the vector environment ``i`` is a list with an index for each row, or
    the index of the first row, which the others follow.

    Raises:
        ValueError: any value out of its range, or values that do not fit together.
    """

    COARSE_S: ClassVar[float] = 120.0
    FINE_S: ClassVar[float] = 360.0

    duration: float | None = None
    epoch: float = 0.1
    n_sub: int = 30
    coarse: float | None = None
    imu: Any = "thesis-white"
    gps: Any = "thesis"
    start: str = "told"
    misalignment_deg: tuple[float, ...] | None = None
    any_heading: bool = False
    prior: str = "matched"
    latitude_deg: float = 39.96
    heading_deg: Any = 30.0
    earth: str = "wgs84"
    aids: Any = ()
    longitude_deg: float = LONGITUDE_DEG
    height_m: float = 0.0
    attitude_std_deg: tuple[float, ...] | None = None
    velocity_std_mps: float | None = None
    told: Any = None

    def __post_init__(self) -> None:
        checks.choice("start", self.start, STARTS)
        checks.choice("prior", self.prior, PRIORS)
        checks.choice("earth model", self.earth, earth.EARTHS)
        set_ = object.__setattr__
        set_(self, "epoch", check_epoch(self.epoch))
        set_(self, "n_sub", check_samples(self.n_sub))
        set_(self, "coarse", check_coarse(self.coarse, self.start, self.COARSE_S))
        set_(self, "duration", check_duration(self.duration, self.FINE_S + self.coarse_s))
        check_timing(self.epoch, self.duration_s, self.coarse_s)
        checks.keep(self, "latitude_deg", check_latitude)
        checks.keep(self, "longitude_deg", check_longitude)
        checks.keep(self, "height_m", check_height)
        for name, check in (("attitude_std_deg", check_attitude_std), ("velocity_std_mps", check_velocity_std)):
            checks.keep(self, name, check)
            if getattr(self, name) is not None and self.start != "told":
                raise ValueError(f"{name} with start = {self.start!r}; allowed: with start = 'told' only")
        set_(self, "heading_deg", check_heading(self.heading_deg))
        set_(self, "misalignment_deg", check_misalignment(self.misalignment_deg, self.start))
        checks.flag("any_heading", self.any_heading)
        if self.any_heading and (self.start != "told" or self.misalignment_deg is not None):
            raise ValueError(
                f"any_heading with start = {self.start!r}, misalignment_deg = {self.misalignment_deg!r}; "
                "allowed: with start = 'told' and a drawn misalignment only"
            )
        epochs_per_fix(self.gps_true, self.epoch)
        if not self.gps_true.velocity:
            allowed = "true in an alignment, at whose known place a position tells nothing"
            raise checks.refused("gps velocity", False, allowed)
        _ = self.sensors_told
        set_(self, "aids", check_aids(self.aids, self.epoch))

    @property
    def records(self) -> int:
        """Number of records; 0 if ``heading_deg`` is no list."""
        return len(self.heading_deg) if isinstance(self.heading_deg, tuple) else 0

    def headings(self, records: NDArray[np.int64] | None, runs: int) -> Array | None:
        """Return the mean heading of runs that play these records, rad, (runs,); None if it is to be drawn."""
        if self.heading_deg is None:
            return None
        return np.broadcast_to(DEG * np.asarray(self.heading_deg)[... if records is None else records], (runs,))

    @property
    def imu_true(self) -> ImuSpec:
        """Errors of the true inertial sensors."""
        return imu_spec(self.imu)

    @property
    def gps_true(self) -> GpsSpec:
        """Errors of the true fixes."""
        return gps_spec(self.gps)

    @property
    def sensors_told(self) -> tuple[ImuSpec, GpsSpec]:
        """What estimators are told of the IMU and of the fixes, which is the truth unless ``told`` says otherwise."""
        return told_sensors(self.told, self.imu_true, self.gps_true)

    @property
    def gaussian_start(self) -> bool:
        """Whether the errors of the told start are drawn from the Gaussian that a matched prior states."""
        return self.start == "told" and self.misalignment_deg is None and not self.any_heading

    def task(self, env_id: str) -> Task:
        """Return what estimators are told; the reset of an episode fills in its start."""
        spread = self.attitude_std_deg or TOLD_START_STD_DEG if self.start == "told" else unknown_spread(self.coarse_s)
        if self.any_heading:
            spread = (*spread[:2], ANY_HEADING_STD_DEG)
        imu, gps = self.sensors_told
        prior = PRIORS[self.prior](imu, gps, self.epoch, spread)
        if self.velocity_std_mps is not None:
            prior = replace(prior, velocity_std_mps=self.velocity_std_mps)
        return Task(
            id=env_id,
            site=Site(math.radians(self.latitude_deg), math.radians(self.longitude_deg), self.height_m, self.earth),
            epoch_s=self.epoch,
            n_sub=self.n_sub,
            duration_s=self.duration_s,
            coarse_s=self.coarse_s,
            imu=imu,
            gps=gps.told(prior.gps_vel_std_mps if self.prior == "thesis" else None),
            prior=prior,
            coarse_told=not self.coarse_s,
            aids=told_aids(self.aids),
        )


def check_aids(given: Any, epoch_s: float) -> tuple[AidSpec, ...]:
    """Check ``aids``, and return their specifications in the order of their names.

    Raises:
        ValueError: an unknown sensor, preset or field, a value out of its range, or readings that do not fall on epochs.
    """
    found = aid_specs(given)
    for spec in found:
        epochs_per_fix(spec, epoch_s)
    return found


def told_sensors(given: Any, imu: ImuSpec, gps: GpsSpec) -> tuple[ImuSpec, GpsSpec]:
    """Return what solvers are told of the true sensors: the dict ``told`` replaces fields of them.

    Raises:
        ValueError: another dict, or what a specification refuses.
    """
    if given is None:
        return imu, gps
    if not isinstance(given, Mapping):
        raise checks.refused("told", given, "None, or a dict of imu and gps")
    for name in given:
        checks.choice("setting of told", name, ("imu", "gps"))
    told = imu_spec(given.get("imu", imu), imu), gps_spec(given.get("gps", gps), gps)
    if told[1].velocity != gps.velocity:
        raise checks.refused("velocity of gps in told", told[1].velocity, f"{gps.velocity}, as of the true fixes")
    return told


def told_aids(aids: tuple[AidSpec, ...]) -> tuple[AidSpec, ...]:
    """Return what estimators are told of these sensors."""
    return tuple(spec.told() for spec in aids)


def check_heading(given: Any) -> float | tuple[float, ...] | None:
    """Check ``heading_deg``: an angle in degrees, a list with one for each record, or None."""
    allowed = f"a finite angle in degrees, -{MOST_ANGLE_DEG:g} to {MOST_ANGLE_DEG:g}, a list of them, or None"
    if given is None:
        return None
    if checks.items(given) is not None:
        return checks.numbers("heading_deg", given, None, allowed, least=-MOST_ANGLE_DEG, most=MOST_ANGLE_DEG)
    return checks.number("heading_deg", given, allowed, least=-MOST_ANGLE_DEG, most=MOST_ANGLE_DEG)


def check_latitude(name: str, given: Any) -> float:
    """Check a latitude in degrees."""
    most = math.degrees(earth.MAX_LATITUDE)
    return checks.number(name, given, f"-{most:g} to {most:g}", least=-most, most=most)


def check_longitude(name: str, given: Any) -> float:
    """Check a longitude in degrees."""
    return checks.number(name, given, "-180 to 180", least=-180.0, most=180.0)


def check_height(name: str, given: Any) -> float:
    """Check a height in m."""
    return checks.number(name, given, f"-1000 to {MAX_HEIGHT:g}", least=-1e3, most=MAX_HEIGHT)


def check_attitude_std(name: str, given: Any) -> tuple[float, ...] | None:
    """Check the standard deviations of a told attitude, E, N, U in degrees, or None."""
    allowed = "three positive numbers (E, N, U), at most 360, or None"
    return None if given is None else checks.numbers(name, given, 3, allowed, above=0.0, most=360.0)


def check_velocity_std(name: str, given: Any) -> float | None:
    """Check the standard deviation of a told velocity, m/s, or None."""
    allowed = f"a positive number or None, at most {MAX_SPEED:g}"
    return None if given is None else checks.number(name, given, allowed, above=0.0, most=MAX_SPEED)


def check_position_std(name: str, given: Any) -> float | None:
    """Check the standard deviation of a told position, m, or None."""
    return (
        None
        if given is None
        else checks.number(name, given, "a positive number or None, at most 1e+07", above=0.0, most=1e7)
    )


def check_epoch(given: Any) -> float:
    """Check the length of an epoch, a positive number of seconds."""
    allowed = f"a positive number of seconds, {LEAST_EPOCH_S:g} to {MOST_EPOCH_S:g}"
    return checks.number("epoch", given, allowed, least=LEAST_EPOCH_S, most=MOST_EPOCH_S)


def check_duration(given: Any, default: float) -> float:
    """Check the length of an episode, s; None becomes ``default``."""
    allowed = f"a finite number of seconds, at most {MAX_TIME:g}, or None"
    return default if given is None else checks.number("duration", given, allowed, most=MAX_TIME)


def check_samples(given: Any) -> int:
    """Check the number of IMU samples per epoch."""
    allowed = f"a whole number of IMU samples per epoch, at least 1, at most {MOST_SAMPLES}"
    return checks.whole("n_sub", given, allowed, least=1, most=MOST_SAMPLES)


def check_coarse(given: Any, start: str, default: float) -> float:
    """Check the length of the coarse phase, s. None becomes ``default`` for an unknown start, and 0 for a told one.

    Raises:
        ValueError: a told start with a coarse phase.
    """
    if given is None:
        return 0.0 if start == "told" else default
    value = checks.number("coarse", given, "a number of seconds, not negative", least=0.0)
    if start == "told" and value:
        raise ValueError(f"coarse = {given!r} with start = 'told'; allowed: 0, a told start needs no coarse phase")
    return value


def unknown_spread(coarse_s: float) -> tuple[float, ...]:
    """Return the standard deviations of the attitude, E, N, U in degrees, with which fine alignment begins at an unknown start."""
    return COARSE_STD_DEG if coarse_s else SWITCH_ON_STD_DEG


def check_misalignment(given: Any, start: str) -> tuple[float, ...] | None:
    """Check ``misalignment_deg``: three finite angles E, N, U in degrees, or None.

    Raises:
        ValueError: anything else, or a misalignment with an unknown start.
    """
    if given is None:
        return None
    if start != "told":
        raise ValueError(f"misalignment_deg with start = {start!r}; allowed: with start = 'told' only")
    allowed = "three finite numbers (E, N, U) in degrees, -360 to 360, or None"
    return checks.numbers("misalignment_deg", given, 3, allowed, least=-360.0, most=360.0)


def check_timing(epoch: float, duration: float, coarse: float, name: str = "duration") -> None:
    """Check that duration and coarse phase are whole numbers of epochs, with at least three epochs in an episode.

    Raises:
        ValueError: a length that does not fit; the error offers the nearest one that does.
    """
    for kind, value, least in ((name, duration, 3), ("coarse", coarse, 0)):
        count = value / epoch
        if not math.isfinite(count) or abs(count - round(count)) >= 1e-6 or round(count) < least:
            near = max(round(count) if math.isfinite(count) else least, least) * epoch
            raise ValueError(
                f"{kind} = {value!r} s with epochs of {epoch:g} s; allowed: a whole number of epochs, "
                f"at least {least}, for instance {near:g} s"
            )
    if coarse >= duration:
        raise ValueError(f"coarse = {coarse:g} s, {name} = {duration:g} s; allowed: coarse shorter than the {name}")
