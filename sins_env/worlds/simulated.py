"""The world of a simulated episode: a trajectory, an IMU, a GPS receiver and a told start."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import checks
from sins_env.arrays import Array, Rngs
from sins_env.sensors.gps import Gps, ZeroVelocity
from sins_env.sensors.imu import Imu, standard_normal
from sins_env.trajectory import Trajectory
from sins_env.types import NavState
from sins_env.worlds.limits import clip_fix
from sins_env.worlds.settings import SimulationSettings
from sins_env.worlds.world import ChunkedWorld, pick_rows, picked, told_start


class SimulatedWorld(ChunkedWorld):
    """A world of an exact motion, with the errors of the sensors on it."""

    scored = True
    settings: Any  #: settings with ``start`` and ``gaussian_start``
    trajectory: Trajectory
    imu: Imu
    gps: Gps | ZeroVelocity

    def reset(self, rngs: Rngs, options: dict[str, Any]) -> tuple[NavState, NavState | None]:
        """Begin one run per generator, and return the true states at t = 0 and the told ones, if any."""
        streams = [rng.spawn(11) for rng in rngs]  # start, motion, 6 IMU, 3 GPS: one stream each, in this order
        truth = self._begin([s[1] for s in streams], options)
        self.imu.reset([s[2:8] for s in streams])
        self.gps.reset([s[8:11] for s in streams])
        self._rewind()
        return truth, self._told(truth, standard_normal([s[0] for s in streams], (9,)))

    def _begin(self, rngs: Rngs, options: dict[str, Any]) -> NavState:
        """Draw the motions, and return the true states at t = 0."""
        if options:
            raise checks.refused("reset options", options, "none in this environment")
        return self.trajectory.reset(rngs)

    @abstractmethod
    def _told(self, truth: NavState, draws: Array) -> NavState | None:
        """Return the start that the task tells, or None for an unknown start; ``draws`` (runs, 9) are standard normal."""

    def _chunk(self, first: int, count: int) -> tuple[tuple[Any, ...], NavState]:
        motion = self.trajectory.chunk(first, count)
        fixes = self.gps.fixes(motion, first)
        clip_fix(*fixes[:2])
        return (*self.imu.measure(motion.dtheta, motion.dvel), *fixes), motion.state


class BaseWorld(SimulatedWorld):
    """A simulated base at its site, with the sensors and the start of its settings. With records, each run plays one."""

    settings: SimulationSettings

    def __init__(self, env_id: str, settings: SimulationSettings) -> None:
        self.task = settings.task(env_id)
        self.imu = Imu(settings.imu_true, self.task.epoch_s / self.task.n_sub)

    def _records(self, rngs: Rngs, options: dict[str, Any]) -> NDArray[np.int64] | None:
        """Return which record each run plays, or None if there are no records."""
        given, count = picked(options, "record"), self.settings.records
        if count:
            return pick_rows("record", given, count, [rng.spawn(1)[0] for rng in rngs])
        if given is not None:
            raise checks.refused("record", given, "where heading_deg is a list, one of each record")
        return None

    def _told(self, truth: NavState, draws: Array) -> NavState | None:
        settings = self.settings
        if settings.start == "unknown":
            return None
        misalignment, pos = settings.misalignment_deg, self.task.site.pos
        return told_start(self.task, misalignment, truth, draws, pos, settings.any_heading)
