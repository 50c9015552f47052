"""``SINS/NavFlight-v0``: an INS and a GPS receiver in flight, from a told start with stated errors, or from rest."""

from __future__ import annotations

from typing import Any

from sins_env import earth
from sins_env.envs.base import EpisodeEnv, EpisodeVectorEnv
from sins_env.envs.flight_settings import FlightSettings
from sins_env.envs.world import Array, SimulatedWorld, World, told_start
from sins_env.errors import build
from sins_env.gps import Gps
from sins_env.imu import Imu
from sins_env.trajectory import Flight
from sins_env.types import NavState


class FlightWorld(SimulatedWorld):
    """One flight, the same in every run; sensors and start differ."""

    def __init__(self, settings: FlightSettings) -> None:
        self.settings, self.task = settings, settings.task()
        task = self.task
        self.trajectory = Flight(settings.base.plan, task.epoch_s, task.n_sub)
        self.imu = Imu(settings.imu_true, task.epoch_s / task.n_sub, settings.script)
        self.gps = Gps(settings.gps_true, task.epoch_s, task.duration_s, earth.get(task.site.earth))

    def _told(self, truth: NavState, draws: Array) -> NavState | None:
        if self.settings.start == "unknown":
            return None
        return told_start(self.task, self.settings.misalignment, truth, draws)


def _flight(**settings: Any) -> World:
    return FlightWorld(build(FlightSettings, settings, "SINS/NavFlight-v0"))


class NavFlightEnv(EpisodeEnv):
    """``SINS/NavFlight-v0``: see :class:`FlightSettings`."""

    world = staticmethod(_flight)


class NavFlightVectorEnv(EpisodeVectorEnv):
    world = staticmethod(_flight)
