"""A simulated parked car that people disturb: the keyword arguments of ``SINS/AlignVehicle-v0``, and its world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from sins_env import checks, earth
from sins_env.arrays import Rngs
from sins_env.sensors.gps import ZERO_VELOCITY, Gps, ZeroVelocity
from sins_env.specs import GpsSpec, gps_spec
from sins_env.trajectory import Vehicle
from sins_env.trajectory.car import SCENES, Event
from sins_env.types import NavState
from sins_env.worlds.settings import SimulationSettings
from sins_env.worlds.simulated import BaseWorld

ZERO_VELOCITY_FIELDS = ("vel_std_mps", "pos_std_m", "rate_hz")  #: fields of ``gps`` that zero-velocity updates know


@dataclass(frozen=True)
class VehicleSettings(SimulationSettings):
    """Settings of ``SINS/AlignVehicle-v0``: the events at the car, and those of all simulated bases with other defaults.

    ``events`` is the name of a scene: "quiet", "doors", "rocking", "people" or "mixed". Its events are Poisson in time, on
    average ``event_rate_per_min`` of them. A list of names gives one scene to each heading of a list, that is, to each
    record. A script instead is a list of dicts such as {"t": 30, "kind": "in", "seat": "rear-left", "scale": 1.2}, see
    :class:`sins_env.trajectory.car.Event`. An empty script is a quiet car.

    ``gps`` None has no receiver. Zero-velocity updates at the known site come at every epoch, with an assumed noise of
    0.03 m/s and 1 m whatever the car does. A dict of ``vel_std_mps``, ``pos_std_m`` and ``rate_hz`` assumes another one.
    The name of a preset, or a dict with a ``preset``, is a real receiver.

    Raises:
        ValueError: any value out of its range, or values that do not fit together.
    """

    COARSE_S: ClassVar[float] = 90.0
    FINE_S: ClassVar[float] = 210.0

    n_sub: int = 10
    imu: Any = "rlg-car"
    gps: Any = None
    start: str = "unknown"
    events: Any = "people"
    event_rate_per_min: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.keep(self, "event_rate_per_min", checks.number, least=0.0, most=60.0)
        object.__setattr__(self, "events", check_events(self.events))
        if self.by_record and len(self.events) != self.records:
            heads = f"{self.records} headings" if self.records else f"heading_deg = {self.heading_deg!r}"
            raise ValueError(f"{len(self.events)} scenes in events with {heads}; allowed: one scene for each heading")

    @property
    def by_record(self) -> bool:
        """Whether ``events`` names a scene for each record."""
        return isinstance(self.events, tuple) and all(isinstance(one, str) for one in self.events) and self.events != ()

    @property
    def has_receiver(self) -> bool:
        """Whether there is a GPS receiver instead of zero-velocity updates."""
        return not (self.gps is None or (isinstance(self.gps, Mapping) and "preset" not in self.gps))

    @property
    def gps_true(self) -> GpsSpec:
        """Errors of the true fixes of a receiver, or without one the assumed noise of the zero-velocity updates."""
        if self.has_receiver:
            return gps_spec(self.gps)
        given = dict(self.gps or {})
        for name in given:
            checks.choice("field of zero-velocity updates", name, ZERO_VELOCITY_FIELDS)
        return gps_spec(given, replace(ZERO_VELOCITY, rate_hz=1.0 / self.epoch))


def check_events(given: Any) -> str | tuple[str, ...] | tuple[Event, ...]:
    """Check ``events``: a scene, a list with one for each record, or a script, which is returned in the order of time.

    Raises:
        ValueError: an unknown scene, or an event that is none.
    """
    values = checks.items(given)
    if isinstance(given, str):
        return checks.choice("events", given, SCENES)
    if values is None:
        raise checks.refused(
            "events", given, f"a scene ({', '.join(sorted(SCENES))}), one for each heading, or a script"
        )
    if values and all(isinstance(one, str) for one in values):
        return tuple(checks.choice("events", one, SCENES) for one in values)
    return tuple(sorted((Event.of(one) for one in values), key=lambda event: event.t))


class VehicleWorld(BaseWorld):
    """A parked car with an IMU, and a receiver or zero-velocity updates."""

    def __init__(self, env_id: str, settings: VehicleSettings) -> None:
        super().__init__(env_id, settings)
        self.settings: VehicleSettings = settings
        task, spec = self.task, settings.gps_true
        self.trajectory: Vehicle = Vehicle(
            task.site, task.epoch_s, task.n_sub, task.duration_s, settings.event_rate_per_min
        )
        if settings.has_receiver:
            self.gps = Gps(spec, task.epoch_s, task.duration_s, earth.get(task.site.earth))
        else:
            self.gps = ZeroVelocity(spec, task.epoch_s, task.site.pos)

    def _begin(self, rngs: Rngs, options: dict[str, Any]) -> NavState:
        settings, records = self.settings, self._records(rngs, options)
        if settings.by_record and records is not None:
            events = [settings.events[i] for i in records]
        else:
            events = [settings.events] * len(rngs)
        return self.trajectory.reset(rngs, settings.headings(records, len(rngs)), events)

    def truth_at(self, k: int) -> NavState:
        """Return the true states at the end of epoch k, (runs, ...); epochs may be asked for in any order."""
        return NavState(*(part[:, 0] for part in self.trajectory.chunk(k - 1, 1).state))
