"""The world of a simulated episode: a trajectory, an IMU, a GPS receiver and a told start."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import checks
from sins_env.arrays import Array, Obs, Rngs
from sins_env.motion import Motion
from sins_env.sensors.aids import sensor_of, stream
from sins_env.sensors.gps import AGE, FIELDS, Gps, ZeroVelocity, in_fields
from sins_env.sensors.imu import Imu, standard_normal
from sins_env.trajectory import Trajectory
from sins_env.trajectory.mounted import Mounted, Slipping
from sins_env.types import NavState
from sins_env.worlds.settings import SimulationSettings
from sins_env.worlds.world import ChunkedWorld, pick_rows, picked, told_start


class SimulatedWorld(ChunkedWorld):
    """A world of an exact motion, with the errors of the sensors on it."""

    scored = True
    settings: Any  #: settings with ``start`` and ``gaussian_start``
    trajectory: Trajectory
    imu: Imu
    gps: Gps | ZeroVelocity

    def __init__(self, env_id: str, settings: Any) -> None:
        self.settings, self.task = settings, settings.task(env_id)
        task = self.task
        #: Aiding sensors by name, with the errors that the runs really have.
        self.aids = {spec.name: sensor_of(spec.name)(spec, task.site, task.epoch_s) for spec in settings.aids}
        self._ages = settings.gps_true.oldest_s > 0.0  # whether fixes are made between the ends of epochs
        aged = AGE if self._ages else {}
        self.fields = {
            **FIELDS,
            **aged,
            **{name: field for aid in self.aids.values() for name, field in aid.fields.items()},
        }

    def reset(self, rngs: Rngs, options: dict[str, Any]) -> tuple[NavState, NavState | None]:
        """Begin one run per generator, and return the true states at t = 0 and the told ones, if any."""
        streams = [rng.spawn(11) for rng in rngs]  # start, motion, 6 IMU, 3 GPS: one stream each, in this order
        for name, aid in self.aids.items():
            aid.reset([stream(s[0], name) for s in streams])
        truth = self._mounted(self._begin([s[1] for s in streams], options))
        self.imu.reset([s[2:8] for s in streams])
        self.gps.reset([s[8:11] for s in streams])
        for aid in self.aids.values():
            aid.begin(truth)
        self._rewind()
        return truth, self._told(truth, standard_normal([s[0] for s in streams], (9,)))

    def _begin(self, rngs: Rngs, options: dict[str, Any]) -> NavState:
        """Draw the motions, and return the true states at t = 0."""
        if options:
            raise checks.refused("reset options", options, "none in this environment")
        return self.trajectory.reset(rngs)

    def _mounted(self, truth: NavState) -> NavState:
        """Turn the IMU in its vehicle as the aids have drawn it, and return the true states of the IMU at t = 0."""
        while (inner := getattr(self.trajectory, "inner", None)) is not None:
            self.trajectory = inner
        for aid in self.aids.values():
            if aid.slip_angle:
                self.trajectory = slipping = Slipping(self.trajectory, aid.slip_angle, self.task.epoch_s)
                truth = slipping.state(truth)
            if aid.mounting is not None:
                self.trajectory = mounted = Mounted(self.trajectory, aid.mounting)
                truth = mounted.state(truth)
        return truth

    @abstractmethod
    def _told(self, truth: NavState, draws: Array) -> NavState | None:
        """Return the start that the task tells, or None for an unknown start; ``draws`` (runs, 9) are standard normal."""

    def _chunk(self, first: int, count: int) -> tuple[Obs, NavState]:
        motion = self.trajectory.chunk(first, count)
        measured = self._fixes(motion, first)
        for aid in self.aids.values():
            measured |= aid.readings(motion, first)
        dtheta, dvel = self.imu.measure(motion.dtheta, motion.dvel)
        return {"dtheta": dtheta, "dvel": dvel, **measured}, motion.state

    def _fixes(self, motion: Motion, first: int) -> Obs:
        """Return the fields of the fixes in a chunk of epochs."""
        if not self._ages:
            return in_fields(self.gps.fixes(motion, first))
        assert isinstance(self.gps, Gps)
        runs, count = motion.state.vel.shape[:2]
        present, age = self.gps.schedule(first, count)
        there, age = np.flatnonzero(present), np.where(present, age, 0.0)
        after = NavState(*(part[:, there] for part in motion.state))
        t = (first + 1 + there.astype(np.float64)) * self.task.epoch_s
        state, rate = self.trajectory.earlier(after, t, age[there])
        at_fixes = [np.array(part) for part in (*motion.state, motion.rate_eb_b)]
        for part, value in zip(at_fixes, (*state, rate), strict=True):
            part[:, there] = value
        fixes = self.gps.fixes(motion._replace(state=NavState(*at_fixes[:3]), rate_eb_b=at_fixes[3]), first)
        return in_fields(fixes) | {"gps_age": np.tile(age[:, None], (runs, 1, 1))}


class BaseWorld(SimulatedWorld):
    """A simulated base at its site, with the sensors and the start of its settings. With records, each run plays one."""

    settings: SimulationSettings

    def __init__(self, env_id: str, settings: SimulationSettings) -> None:
        super().__init__(env_id, settings)
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
