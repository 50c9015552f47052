"""An INS with a GPS receiver in flight: the keyword arguments of ``SINS/NavFlight-v0``, and its world."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from sins_env import checks, earth
from sins_env.arrays import Array
from sins_env.prior import COARSE_STD_DEG, PRIORS, SWITCH_ON_STD_DEG
from sins_env.sensors.gps import Gps, epochs_per_fix
from sins_env.sensors.imu import Imu, Script
from sins_env.specs import GpsSpec, ImuSpec, gps_spec, imu_spec
from sins_env.trajectory import Flight
from sins_env.types import NavState, Site, Task
from sins_env.units import DEG, DEG_PER_H, UG
from sins_env.worlds.profiles import Profile, flight_profile
from sins_env.worlds.settings import (
    STARTS,
    Timed,
    check_aids,
    check_attitude_std,
    check_coarse,
    check_duration,
    check_epoch,
    check_misalignment,
    check_position_std,
    check_samples,
    check_timing,
    check_velocity_std,
    told_aids,
    told_sensors,
)
from sins_env.worlds.simulated import SimulatedWorld
from sins_env.worlds.world import told_start

ERRORS = ("drawn", "fixed")  #: allowed values of ``errors``


@dataclass(frozen=True)
class FlightSettings(Timed):
    """Settings of ``SINS/NavFlight-v0``. Values are those that JSON can hold; None leaves what the profile says.

    ``profile`` names a flight: ``sun2012``, ``sun2012-fixed``, ``sun2012-physical``, ``lu-gauss``, ``lu-mixture``,
    ``zhao2010``, ``hotstart30``, ``hotstart60`` or ``hotstart90``. ``car`` is a drive in town, and ``ship`` a ship under way. A
    flight of one's own is a dict of the fields of FlightPlan, or the path of a YAML or JSON file with them. A CSV or NPZ table of
    places, or a dict or file with ``track``, is a motion through them (docs/mathematics/simulation.md#tracks). Both have the
    sensors of ``sun2012``.

    ``duration``, s, ends the flight early. It includes the ``coarse`` phase, s.

    ``imu`` and ``gps`` are the name of a preset, or a dict of fields that replace those of the profile or of the dict's
    ``preset``. The noise of a given ``imu`` is constant.

    ``attitude_std_deg`` (E, N, U), ``velocity_std_mps`` and ``position_std_m`` are 1 sigma of the told start. Its errors are
    drawn; with ``errors`` "fixed" misalignment and biases are + 1 sigma in every run. ``misalignment_deg`` fixes the
    misalignment, E, N, U.

    With a told start ``Task.site`` is only the region; the start position, with its error, is in ``Task.start``. The coarse
    phase of a ``start`` of "unknown" lasts by default for as long as the flight stands still. With a ``coarse`` of 0, and by
    default in a flight that begins in motion, estimators begin at switch-on. A longer ``coarse`` phase is one in motion.

    ``aids`` are further sensors by name, each with a preset or a dict of fields. ``told`` is a dict of what solvers are told
    of the sensors where it differs from the truth: ``imu``, ``gps``, or both.

    Raises:
        ValueError: any value out of its range, or values that do not fit together.
        FileNotFoundError: no such file.
    """

    profile: Any = "sun2012"
    duration: float | None = None
    epoch: float = 0.1
    n_sub: int = 1
    coarse: float | None = None
    imu: Any = None
    gps: Any = None
    start: str = "told"
    misalignment_deg: tuple[float, ...] | None = None
    errors: str | None = None
    attitude_std_deg: tuple[float, ...] | None = None
    velocity_std_mps: float | None = None
    position_std_m: float | None = None
    prior: str = "matched"
    aids: Any = ()
    told: Any = None

    def __post_init__(self) -> None:
        checks.choice("start", self.start, STARTS)
        checks.choice("prior", self.prior, PRIORS)
        set_ = object.__setattr__
        set_(self, "epoch", check_epoch(self.epoch))
        set_(self, "n_sub", check_samples(self.n_sub))
        set_(self, "errors", checks.choice("errors", self.errors or ERRORS[self.base.fixed], ERRORS))
        self._check_times()
        set_(self, "misalignment_deg", check_misalignment(self.misalignment_deg, self.start))
        for name in ("attitude_std_deg", "velocity_std_mps", "position_std_m"):
            if getattr(self, name) is None:
                set_(self, name, getattr(self.base, name))
        checks.keep(self, "attitude_std_deg", check_attitude_std)
        checks.keep(self, "velocity_std_mps", check_velocity_std)
        checks.keep(self, "position_std_m", check_position_std)
        epochs_per_fix(self.gps_true, self.epoch)
        _ = self.sensors_told
        set_(self, "aids", check_aids(self.aids, self.epoch))

    def _check_times(self) -> None:
        plan, set_ = self.base.plan, object.__setattr__
        set_(self, "coarse", check_coarse(self.coarse, self.start, plan.rest_s))
        duration = check_duration(self.duration, plan.duration_s)
        set_(self, "duration", duration)
        if duration > plan.duration_s + 1e-6:
            raise checks.refused("duration", self.duration, f"at most {plan.duration_s:g} s, the length of the flight")
        check_timing(self.epoch, duration, self.coarse_s)
        plan.check_grid(self.epoch / self.n_sub)

    @cached_property
    def base(self) -> Profile:
        """The profile, before the settings replace any of it."""
        return flight_profile(self.profile)

    @property
    def imu_true(self) -> ImuSpec:
        """Errors of the true inertial sensors."""
        return self.base.imu if self.imu is None else imu_spec(self.imu, self.base.imu)

    @property
    def gps_true(self) -> GpsSpec:
        """Errors of the true fixes."""
        return self.base.gps if self.gps is None else gps_spec(self.gps, self.base.gps)

    @property
    def sensors_told(self) -> tuple[ImuSpec, GpsSpec]:
        """What estimators are told of the IMU and of the fixes, which is the truth unless ``told`` says otherwise."""
        return told_sensors(self.told, self.imu_true, self.gps_true)

    @property
    def script(self) -> Script:
        """Departures of the true sensors from their specification."""
        own = self.base.script if self.imu is None else None
        return replace(own or Script(), fixed_bias=self.errors == "fixed")

    @property
    def misalignment(self) -> tuple[float, ...] | None:
        """Misalignment in every run, E, N, U in degrees; None if it is drawn."""
        if self.misalignment_deg is None and self.errors == "fixed":
            return self.attitude_std_deg
        return self.misalignment_deg

    @property
    def gaussian_start(self) -> bool:
        """Whether the errors of the told start are drawn from the Gaussian that a matched prior states."""
        return self.start == "told" and self.misalignment is None

    def task(self, env_id: str) -> Task:
        """Return what estimators are told; the reset of an episode fills in its start."""
        (imu, gps), site = self.sensors_told, self.base.plan.site
        if self.start == "told":
            site = region(site)
        spread = self.attitude_std_deg
        if self.start == "unknown":
            at_rest = self.coarse_s <= self.base.plan.rest_s
            spread = coarse_std_deg(imu, site, self.coarse_s) if at_rest else SWITCH_ON_STD_DEG
        assert spread is not None
        assert self.velocity_std_mps is not None
        assert self.position_std_m is not None
        prior = replace(
            PRIORS[self.prior](imu, gps, self.epoch, spread),
            velocity_std_mps=self.velocity_std_mps,
            position_std_m=self.position_std_m,
        )
        return Task(
            id=env_id,
            site=site,
            epoch_s=self.epoch,
            n_sub=self.n_sub,
            duration_s=self.duration_s,
            coarse_s=self.coarse_s,
            imu=imu,
            gps=gps.told(prior.gps_vel_std_mps if self.prior == "thesis" else None),
            prior=prior,
            coarse_told=not self.coarse_s,
            navigate=True,
            aids=told_aids(self.aids),
        )


def region(site: Site) -> Site:
    """Return the middle of the cell of 0.01 deg and 100 m in which the site lies.

    This tells the Earth's rate and gravity well enough, and does not tell the start position without its error.
    """

    def middle(value: float, size: float) -> float:
        return size * (math.floor(value / size + 1e-6) + 0.5)  # a border's last bit decides nothing

    cell = 0.01 * DEG
    return Site(middle(site.latitude, cell), middle(site.longitude, cell), middle(site.height, 100.0), site.earth)


def coarse_std_deg(imu: ImuSpec, site: Site, coarse_s: float) -> tuple[float, ...]:
    """Return 1 sigma of the attitude after ``coarse_s`` s of coarse alignment at rest, E, N, U in degrees.

    The level errs by accelerometer bias over gravity. The azimuth comes from the drift of gravity in inertial space. Gyro
    bias and angle random walk disturb this drift, and velocity random walk its measured slope. ``COARSE_STD_DEG`` is
    added in squares. Without a coarse phase it is that of a level at any heading.
    See docs/mathematics/simulation.md#coarse-spread.
    """
    if not coarse_s:
        return SWITCH_ON_STD_DEG
    model = earth.get(site.earth)
    gravity = float(earth.gravity(model, site.latitude, site.height))
    north = model.rate * math.cos(site.latitude)
    level = imu.accel_bias_ug * UG / gravity
    gyros = math.hypot(imu.gyro_bias_deg_h * DEG_PER_H, imu.arw / math.sqrt(coarse_s))
    slope = math.sqrt(12.0 / coarse_s**3) * imu.vrw / gravity
    azimuth = math.hypot(gyros / north, slope / north, level * math.tan(site.latitude))
    return tuple(math.hypot(a, b / DEG) for a, b in zip(COARSE_STD_DEG, (level, level, azimuth), strict=True))


class FlightWorld(SimulatedWorld):
    """A flight, the same in every run, with sensors and a start that differ."""

    def __init__(self, env_id: str, settings: FlightSettings) -> None:
        super().__init__(env_id, settings)
        task = self.task
        self.trajectory = Flight(settings.base.plan, task.epoch_s, task.n_sub)
        self.imu = Imu(settings.imu_true, task.epoch_s / task.n_sub, settings.script)
        self.gps = Gps(settings.gps_true, task.epoch_s, task.duration_s, earth.get(task.site.earth))

    def _told(self, truth: NavState, draws: Array) -> NavState | None:
        if self.settings.start == "unknown":
            return None
        return told_start(self.task, self.settings.misalignment, truth, draws)
