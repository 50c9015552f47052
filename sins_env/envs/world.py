"""Worlds: where an episode's observations and truth come from. A batch of runs, epoch by epoch, in chunks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from sins_env import attitude, earth
from sins_env.envs.settings import AlignSettings
from sins_env.envs.spaces import clip_fix
from sins_env.gps import Gps
from sins_env.imu import Imu, standard_normal
from sins_env.specs import DEG
from sins_env.trajectory import STILL, THESIS, Sway, Trajectory
from sins_env.types import NavState, Task

Array = NDArray[np.float64]

CHUNK_SAMPLES = 300  #: IMU samples generated at once; bounds the memory whatever the duration, and fixes the bits


class EpochData(NamedTuple):
    """One epoch of every run: what is measured, and the truth at its end."""

    dtheta: Array  #: (runs, n_sub, 3)
    dvel: Array  #: (runs, n_sub, 3)
    gps_vel: Array  #: (runs, 3)
    gps_pos: Array  #: (runs, 3)
    gps_valid: NDArray[np.int8]  #: (runs, 1)
    truth: NavState


class World(Protocol):
    task: Task
    scored: bool  #: False where there is no reference to score against

    def reset(self, rngs: Sequence[np.random.Generator], options: dict[str, Any]) -> tuple[NavState, NavState | None]:
        """Begin one run per generator: the true state at t = 0, and the told one (None: unknown), (runs, ...)."""
        ...

    def epoch(self, k: int) -> EpochData:
        """Epoch k = 1 ... K; to be asked for in order."""
        ...


class ChunkedWorld(ABC):
    """Epochs one by one out of chunks, so that memory grows neither with the duration nor with the epoch's length."""

    task: Task
    _first: int
    _end: int

    def epoch(self, k: int) -> EpochData:
        if k > self._end:
            self._first = self._end
            self._end = min(self._first + max(1, CHUNK_SAMPLES // self.task.n_sub), self.task.num_epochs)
            self._measured, self._state = self._chunk(self._first, self._end - self._first)
        i = k - 1 - self._first
        dtheta, dvel, gps_vel, gps_pos, gps_valid = (part[:, i] for part in self._measured)
        truth = NavState(*(part[:, i] for part in self._state))
        return EpochData(dtheta, dvel, gps_vel, gps_pos, gps_valid, truth)

    def _rewind(self) -> None:
        self._first = self._end = 0

    @abstractmethod
    def _chunk(self, first: int, count: int) -> tuple[tuple[Any, ...], NavState]:
        """Epochs first + 1 ... first + count: what is measured, and the truth, all (runs, count, ...)."""


def told_start(
    task: Task, misalignment_deg: Any, truth: NavState, draws: Array, pos: Array, any_heading: bool = False
) -> NavState:
    """The start that a task tells: C(phi) C_true, phi fixed or drawn; ``draws`` (runs, 6) are normals."""
    spread = np.asarray(task.prior.attitude_std_deg)
    fixed = misalignment_deg is not None
    phi = DEG * (np.broadcast_to(misalignment_deg, (len(draws), 3)) if fixed else spread * draws[:, :3])
    if any_heading:
        phi[:, 2] = np.pi * (2.0 * ndtr(draws[:, 2]) - 1.0)
    computed = attitude.multiply(attitude.misalignment_quaternion(phi), truth.q_nb)
    vel = truth.vel + task.prior.velocity_std_mps * draws[:, 3:]
    return NavState(computed, vel, np.broadcast_to(pos, vel.shape).copy())


class SimulatedWorld(ChunkedWorld):
    """An exact motion, and the errors of the sensors on it."""

    scored = True
    trajectory: Trajectory
    imu: Imu
    gps: Gps

    def reset(self, rngs: Sequence[np.random.Generator], options: dict[str, Any]) -> tuple[NavState, NavState | None]:
        streams = [rng.spawn(11) for rng in rngs]  # start, motion, 6 IMU, 3 GPS: one stream each, in this order
        truth = self.trajectory.reset([s[1] for s in streams])
        self.imu.reset([s[2:8] for s in streams])
        self.gps.reset([s[8:11] for s in streams])
        self._rewind()
        return truth, self._told(truth, standard_normal([s[0] for s in streams], (9,)))

    @abstractmethod
    def _told(self, truth: NavState, draws: Array) -> NavState | None:
        """The start that the task tells, None if it tells none; ``draws`` (runs, 9) are normals."""

    def _chunk(self, first: int, count: int) -> tuple[tuple[Any, ...], NavState]:
        motion = self.trajectory.chunk(first, count)
        fixes = self.gps.fixes(motion, first)
        clip_fix(*fixes[:2])
        return (*self.imu.measure(motion.dtheta, motion.dvel), *fixes), motion.state


class SwayWorld(SimulatedWorld):
    """A simulated base that sways, or stands still, with the sensors and the start of the settings."""

    def __init__(self, env_id: str, settings: AlignSettings, still: bool) -> None:
        self.settings, self.task = settings, settings.task(env_id)
        task = self.task
        self.trajectory: Sway = Sway(
            task.site,
            task.epoch_s,
            task.n_sub,
            STILL if still else THESIS,
            settings.heading_deg,
            settings.vibration,
            settings.motion == "random",
        )
        self.imu = Imu(settings.imu_true, task.epoch_s / task.n_sub)
        self.gps = Gps(settings.gps_true, task.epoch_s, task.duration_s, earth.get(task.site.earth))

    def _told(self, truth: NavState, draws: Array) -> NavState | None:
        settings = self.settings
        if settings.start == "unknown":
            return None
        misalignment, pos = settings.misalignment_deg, self.task.site.pos
        return told_start(self.task, misalignment, truth, draws[:, :6], pos, settings.any_heading)
