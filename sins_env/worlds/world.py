"""Worlds: where an episode's observations and truth come from. A batch of runs, epoch by epoch, in chunks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from sins_env import attitude, checks, earth
from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.types import NavState, Task
from sins_env.units import DEG

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
    task: Task,
    misalignment_deg: Any,
    truth: NavState,
    draws: Array,
    pos: Array | None = None,
    any_heading: bool = False,
) -> NavState:
    """The start that a task tells: C(phi) C_true, phi fixed or drawn; ``draws`` (runs, 9) are normals.

    ``pos``: the place that is told, where it is known; None draws its error, too.
    """
    spread = np.asarray(task.prior.attitude_std_deg)
    fixed = misalignment_deg is not None
    phi = DEG * (np.broadcast_to(misalignment_deg, (len(draws), 3)) if fixed else spread * draws[:, :3])
    if any_heading:
        phi[:, 2] = np.pi * (2.0 * ndtr(draws[:, 2]) - 1.0)
    computed = attitude.multiply(attitude.misalignment_quaternion(phi), truth.q_nb)
    vel = truth.vel + task.prior.velocity_std_mps * draws[:, 3:6]
    if pos is None:
        pos = earth.displace(earth.get(task.site.earth), truth.pos, task.prior.position_std_m * draws[:, 6:])
    return NavState(computed, vel, np.broadcast_to(pos, vel.shape).copy())


def picked(options: dict[str, Any], name: str) -> Any:
    """The value of the only reset option there is; None where it is not given.

    Raises:
        ValueError: another option.
    """
    for key in options:
        if key != name:
            raise unknown("reset option", key, (name,))
    return options.get(name)


def pick_rows(name: str, given: Any, count: int, rngs: Sequence[np.random.Generator]) -> NDArray[np.int64]:
    """Which of ``count`` windows or records each run gets: drawn, as a list says, or one after the other from an index on.

    Raises:
        ValueError: not one index, nor a list with one for each run; an index that does not exist.
    """
    if given is None:
        return np.array([rng.integers(count) for rng in rngs])
    rows = checks.items(given)
    values = [given] if rows is None else rows
    whole = all(isinstance(v, (int, np.integer)) and not isinstance(v, bool) for v in values)
    if not whole or (rows is not None and len(rows) != len(rngs)):
        raise checks.refused(name, given, f"one whole number, or a list of {len(rngs)}")
    index = np.array(values) if rows is not None else int(given) + np.arange(len(rngs))
    if index.min() < 0 or index.max() >= count:
        bad = int(index[(index < 0) | (index >= count)][0])
        raise ValueError(f"{name} {bad} does not exist; allowed: 0 to {count - 1}, for {len(rngs)} runs one each")
    return index
