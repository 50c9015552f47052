"""Worlds: where an episode's observations and truth come from. A batch of runs, epoch by epoch, in chunks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.envs.settings import AlignSettings
from sins_env.envs.spaces import clip_fix
from sins_env.gps import Gps
from sins_env.imu import Imu, standard_normal
from sins_env.specs import DEG
from sins_env.trajectory import STILL, THESIS, Sway
from sins_env.types import NavState, Task

Array = NDArray[np.float64]

CHUNK_EPOCHS = 10  #: epochs generated at once; bounds the memory whatever the duration, and fixes the bits


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


class SwayWorld:
    """A simulated base that sways, or stands still, with the sensors and the start of the settings."""

    scored = True

    def __init__(self, env_id: str, settings: AlignSettings, still: bool) -> None:
        self.settings, self.task = settings, settings.task(env_id)
        task = self.task
        self.trajectory = Sway(
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

    def reset(self, rngs: Sequence[np.random.Generator], options: dict[str, Any]) -> tuple[NavState, NavState | None]:
        streams = [rng.spawn(11) for rng in rngs]  # start, motion, 6 IMU, 3 GPS: one stream each, in this order
        truth = self.trajectory.reset([s[1] for s in streams])
        self.imu.reset([s[2:8] for s in streams])
        self.gps.reset([s[8:11] for s in streams])
        self._first = self._end = 0
        draws = standard_normal([s[0] for s in streams], (6,))
        if self.settings.start == "unknown":
            return truth, None
        spread = np.asarray(self.task.prior.attitude_std_deg)
        fixed = self.settings.misalignment_deg
        phi = DEG * (spread * draws[:, :3] if fixed is None else np.broadcast_to(fixed, (len(rngs), 3)))
        computed = attitude.multiply(attitude.misalignment_quaternion(phi), truth.q_nb)
        vel = truth.vel + self.task.prior.velocity_std_mps * draws[:, 3:]
        return truth, NavState(computed, vel, np.broadcast_to(self.task.site.pos, vel.shape).copy())

    def epoch(self, k: int) -> EpochData:
        if k > self._end:
            self._generate()
        i = k - 1 - self._first
        return EpochData(*(part[:, i] for part in self._measured), NavState(*(part[:, i] for part in self._state)))

    def _generate(self) -> None:
        self._first = self._end
        count = min(CHUNK_EPOCHS, self.task.num_epochs - self._first)
        self._end = self._first + count
        motion = self.trajectory.chunk(self._first, count)
        fixes = self.gps.fixes(motion, self._first)
        clip_fix(*fixes[:2])
        self._measured = (*self.imu.measure(motion.dtheta, motion.dvel), *fixes)
        self._state = motion.state
