"""Velocity and position of a replay that navigates.

They are compared with the reference and, independently of it, with displacements measured by carrier phase.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.evaluation.play.one_run import Course
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.recordings import Recording, reference_at
from sins_env.specs import GpsSpec
from sins_env.states import NAVIGATION


class Withheld(NamedTuple):
    """Fixes that a solver did not get, and how far its antenna was from them."""

    t: Array  #: (F,) s in the window
    residual: Array  #: (F, 3) estimate minus fix E, N, U, m
    epoch: NDArray[np.int64]  #: (F,) index of the nearest epoch
    outage: NDArray[np.int64]  #: (F,) number of the outage


@dataclass(frozen=True, eq=False, repr=False)
class Track:
    """Velocity and position in every window. Errors are NaN if the recording has no reference."""

    recording: Recording
    starts: Array  #: (W,) start of each window, s on the recording's clock
    t: Array  #: (K,) time of each epoch, s from the start of the window
    fine: Mask  #: (K,) whether an epoch lies after the coarse phase and is scored
    q_nb: Array  #: (W, K, 4) estimated attitude
    pos: Array  #: (W, K, 3) estimated latitude rad, longitude rad, height m
    fixes: Array  #: (W, K, 3) position fixes of the antenna; NaN at epochs without one
    vel_error: Array  #: (W, K, 3) error of velocity E, N, U, m/s
    pos_error: Array  #: (W, K, 3) error of position E, N, U, m
    vel: Array  #: (W, K, 3) estimated velocity E, N, U, m/s
    outages_s: tuple[tuple[float, float], ...]  #: spans of a window, s, whose fixes were withheld
    gps: GpsSpec  #: told noise of the fixes

    def __repr__(self) -> str:
        return f"<Track on {self.recording.name}: {len(self.starts)} windows of {self.t[-1]:g} s>"

    def displacement_errors(self, window: int) -> tuple[Array, Array]:
        """Return times (D,) s in the window and errors (D, 3) m E, N, U of displacements after the coarse phase."""
        t, error = displacement_errors(
            self.recording,
            self.starts[window] + self.t[self.fine],
            self.q_nb[window, self.fine],
            self.pos[window, self.fine],
        )
        return t - self.starts[window], error

    def withheld(self, window: int) -> Withheld:
        """Return how far the antenna was from the fixes that were withheld."""
        recording, start = self.recording, self.starts[window]
        if recording.gnss is None:
            return Withheld(np.empty(0), np.empty((0, 3)), *np.empty((2, 0), dtype=np.int64))
        t = recording.gnss.t_s - start
        number = np.full(len(t), -1)
        for i, (first, last) in enumerate(self.outages_s):
            number[(t > first) & (t <= min(last, self.t[-1]))] = i
        here = np.flatnonzero(number >= 0)
        k = np.abs(self.t[:, None] - t[here]).argmin(axis=0)
        moved = self.vel[window, k] * (t[here] - self.t[k])[:, None]
        if recording.lever_arm is not None:
            moved = moved + attitude.to_dcm(self.q_nb[window, k]) @ recording.lever_arm
        off = earth.offset(earth.get(recording.site.earth), recording.gnss.pos[here], self.pos[window, k])
        return Withheld(t[here], off + moved, k, number[here])

    def scores(self, window: int) -> dict[str, tuple[float, float]]:
        """Return the horizontal and vertical RMS over the fine phase of velocity, position and displacement.

        Quantities without a reference are left out.
        """
        errors = {
            "velocity, m/s": self.vel_error[window, self.fine],
            "position, m": self.pos_error[window, self.fine],
            "displacement, m": self.displacement_errors(window)[1],
        }
        means = {name: np.square(error).mean(axis=0) for name, error in errors.items() if np.isfinite(error).any()}
        return {name: (math.sqrt(east + north), math.sqrt(up)) for name, (east, north, up) in means.items()}


def displacement_errors(recording: Recording, times: Array, q_nb: Array, pos: Array) -> tuple[Array, Array]:
    """Return the estimated displacements of the antenna minus those from carrier phase.

    Args:
        recording: recording with displacements.
        times: times of the estimates, (K,) s on the recording's clock.
        q_nb: estimated attitudes, (K, 4).
        pos: estimated positions of the IMU, (K, 3) rad, rad, m.

    Returns:
        end times of the displacements, (D,) s, and errors, (D, 3) m E, N, U. A displacement must be usable
        (:attr:`~sins_env.recordings.Displacements.usable`), and both of its ends must lie within half a sample of a time.
    """
    moved = recording.displacements
    if moved is None or not len(times):
        return np.empty(0), np.empty((0, 3))
    ends, half = np.stack([moved.t_s - moved.span_s, moved.t_s]), 0.5 / recording.rate_hz * (1 + 1e-6)
    i = np.minimum(np.searchsorted(times, ends - half), len(times) - 1)
    there = (np.abs(times[i] - ends) <= half).all(axis=0) & moved.usable
    first, last = i[:, there]
    step = earth.offset(earth.get(recording.site.earth), pos[first], pos[last])
    if recording.lever_arm is not None:
        arm = attitude.to_dcm(q_nb) @ recording.lever_arm
        step = step + arm[last] - arm[first]
    return moved.t_s[there], step - moved.enu[there]


def of_run(task: EvaluationTask, run: int, course: Course) -> Array:
    """Return the errors (D, 3) m E, N, U of the displacements after the coarse phase in a run with a reference.

    The result is empty for a task without a recording, or for a recording without displacements.
    """
    if not task.windows:
        return np.empty((0, 3))
    env = task.make(1)
    world = env.unwrapped.episode.world  # type: ignore[attr-defined]
    env.close()
    recording, fine = world.recording, course.t > course.records.criteria.coarse_s + 1e-9
    times, errors = world.windows.starts[run] + course.t[fine], course.errors[fine]
    truth = reference_at(recording, times, world.windows.half_sample)
    q_nb = attitude.multiply(attitude.misalignment_quaternion(errors[:, NAVIGATION["phi"]]), truth.q_nb)
    pos = earth.displace(earth.get(recording.site.earth), truth.pos, errors[:, NAVIGATION["dp"]])
    return displacement_errors(recording, times, q_nb, pos)[1]
