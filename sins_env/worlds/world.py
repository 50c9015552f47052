"""Worlds: the source of an episode's observations and truth, for a batch of runs, epoch by epoch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, checks, earth
from sins_env.arrays import Array, Obs, Rngs
from sins_env.checks import unknown
from sins_env.sensors.gps import FIELDS
from sins_env.sensors.limits import Field
from sins_env.states import NAVIGATION
from sins_env.types import NavState, Task
from sins_env.units import DEG

#: IMU samples generated at once. It bounds the memory whatever the duration; another number changes the last bits.
CHUNK_SAMPLES = 300


class EpochData(NamedTuple):
    """One epoch of every run: the measurements, and the true states at its end."""

    #: The increments ``dtheta`` in rad and ``dvel`` in m/s, (runs, n_sub, 3), and what the sensors say at the end, (runs, ...).
    measured: Obs
    truth: NavState


class World(Protocol):
    """The interface through which an environment sees its world."""

    task: Task
    scored: bool  #: whether there is a true state, or a reference, against which errors are taken
    fields: Mapping[str, Field]  #: fields of an observation beside the time and the increments

    def reset(self, rngs: Rngs, options: dict[str, Any]) -> tuple[NavState, NavState | None]:
        """Begin one run per generator.

        Returns the true states at t = 0 and the told ones, each (runs, ...). The told ones are None for an unknown start.
        """
        ...

    def epoch(self, k: int) -> EpochData:
        """Return epoch k; epochs 1 ... K are asked for in order."""
        ...


class ChunkedWorld(ABC):
    """A world that computes its epochs in chunks, so that memory does not grow with the duration."""

    task: Task
    fields: Mapping[str, Field] = FIELDS
    first_epoch: int  #: number of epochs before those of the last chunk
    _end: int

    def epoch(self, k: int) -> EpochData:
        """Return epoch k; epochs 1 ... K are asked for in order."""
        if k > self._end:
            self.first_epoch = self._end
            self._end = min(self.first_epoch + max(1, CHUNK_SAMPLES // self.task.n_sub), self.task.num_epochs)
            self._measured, self._state = self._chunk(self.first_epoch, self._end - self.first_epoch)
        i = k - 1 - self.first_epoch
        measured = {name: part[:, i] for name, part in self._measured.items()}
        return EpochData(measured, NavState(*(part[:, i] for part in self._state)))

    def _rewind(self) -> None:
        self.first_epoch = self._end = 0

    @abstractmethod
    def _chunk(self, first: int, count: int) -> tuple[Obs, NavState]:
        """Return measurements and truth of epochs first + 1 ... first + count, all (runs, count, ...)."""


def told_start(
    task: Task,
    misalignment_deg: Any,
    truth: NavState,
    draws: Array,
    pos: Array | None = None,
    any_heading: bool = False,
) -> NavState:
    """Return the start that a task tells, which is the true one with errors.

    The told attitude is C(phi) C_true, see docs/mathematics/frames.md#misalignment.

    Args:
        task: its prior has the standard deviations of the errors.
        misalignment_deg: phi in every run, E, N, U; None draws it.
        truth: true states, (runs, ...).
        draws: standard normal numbers, (runs, 9) in the layout ``NAVIGATION``.
        pos: the told position if it is known exactly; None draws its error.
        any_heading: whether the azimuth error is drawn over the circle.
    """
    spread = np.asarray(task.prior.attitude_std_deg)
    fixed = misalignment_deg is not None
    phi = DEG * (np.broadcast_to(misalignment_deg, (len(draws), 3)) if fixed else spread * draws[:, NAVIGATION["phi"]])
    if any_heading:
        from scipy.special import ndtr  # slow to import, needed by headings over the circle only

        phi[:, 2] = np.pi * (2.0 * ndtr(draws[:, 2]) - 1.0)
    computed = attitude.multiply(attitude.misalignment_quaternion(phi), truth.q_nb)
    vel = truth.vel + task.prior.velocity_std_mps * draws[:, NAVIGATION["dv"]]
    if pos is None:
        pos = earth.displace(
            earth.get(task.site.earth), truth.pos, task.prior.position_std_m * draws[:, NAVIGATION["dp"]]
        )
    return NavState(computed, vel, np.broadcast_to(pos, vel.shape).copy())


def picked(options: dict[str, Any], name: str) -> Any:
    """Return the value of ``name``, the only reset option there is; None if it is not given.

    Raises:
        ValueError: another option.
    """
    for key in options:
        if key != name:
            raise unknown("reset option", key, (name,))
    return options.get(name)


def pick_rows(name: str, given: Any, count: int, rngs: Rngs) -> NDArray[np.int64]:
    """Return which of ``count`` windows or records each run plays, (runs,).

    If ``given`` is None, each run draws its own. A list has an index for each run. A single index is that of the first run,
    which the others follow one by one.

    Raises:
        ValueError: neither one index nor a list with one for each run; an index that does not exist.
    """
    if given is None:
        return np.array([rng.integers(count) for rng in rngs])
    rows = checks.items(given)
    values = [given] if rows is None else rows
    whole = all(isinstance(v, (int, np.integer)) and not isinstance(v, bool) for v in values)
    if not whole or (rows is not None and len(rows) != len(rngs)):
        raise checks.refused(name, given, f"one whole number, or a list of {len(rngs)}")
    index = values if rows is not None else [int(given) + i for i in range(len(rngs))]
    for one in index:
        if not 0 <= one < count:
            text = (
                f"{name} {checks.shown(one)} does not exist; allowed: 0 to {count - 1}, for {len(rngs)} runs one each"
            )
            raise ValueError(text)
    return np.array(index)
