"""What a navigating ``replay`` has besides angles: velocity and position, against the reference and, apart from it, against
the displacements that the phase of the carrier measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.recordings import Recording, reference_at

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from sins_env.evaluation.play.one_run import Course
    from sins_env.evaluation.tasks.task import EvaluationTask


@dataclass(frozen=True, eq=False)
class Track:
    """Velocity and position in every window. Errors are NaN where the recording has no reference."""

    recording: Recording
    starts: Array  #: (W,) s on the recording's clock
    t: Array  #: (K,) s in the window
    fine: Mask  #: (K,) after the coarse phase: what is scored
    q_nb: Array  #: (W, K, 4)
    pos: Array  #: (W, K, 3) latitude rad, longitude rad, height m
    fixes: Array  #: (W, K, 3) of the antenna; NaN where the solver got none
    vel_error: Array  #: (W, K, 3) m/s E, N, U
    pos_error: Array  #: (W, K, 3) m E, N, U

    def displacement_errors(self, window: int) -> tuple[Array, Array]:
        """Times (D,) s in the window and errors (D, 3) m E, N, U, estimated less measured, after the coarse phase."""
        t, error = displacement_errors(
            self.recording,
            self.starts[window] + self.t[self.fine],
            self.q_nb[window, self.fine],
            self.pos[window, self.fine],
        )
        return t - self.starts[window], error

    def scores(self, window: int) -> dict[str, tuple[float, float]]:
        """RMS, horizontal and vertical, over the fine phase of velocity m/s, position m and displacement m; without those that
        there is nothing to compare with."""
        errors = {
            "velocity, m/s": self.vel_error[window, self.fine],
            "position, m": self.pos_error[window, self.fine],
            "displacement, m": self.displacement_errors(window)[1],
        }
        means = {name: np.square(error).mean(axis=0) for name, error in errors.items() if np.isfinite(error).any()}
        return {name: (math.sqrt(east + north), math.sqrt(up)) for name, (east, north, up) in means.items()}


def displacement_errors(recording: Recording, times: Array, q_nb: Array, pos: Array) -> tuple[Array, Array]:
    """What an estimate says of the antenna's displacements, less what the phase of the carrier says.

    Args:
        times: (K,) s on the recording's clock, of attitudes (K, 4) and positions of the IMU (K, 3) rad, rad, m.

    Returns:
        ends of the displacements that can be relied on (:attr:`~sins_env.recordings.Displacements.usable`) and lie, with both
        ends, within half a sample of the times: (D,) s; errors (D, 3) m E, N, U.
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
    """Errors (D, 3) m E, N, U of the displacements after the coarse phase in a run that was scored against a reference; none
    where the task has no recording, or the recording none."""
    if not task.windows:
        return np.empty((0, 3))
    env = task.make(1)
    world = env.unwrapped.episode.world  # type: ignore[attr-defined]
    env.close()
    recording, fine = world.recording, course.t > course.records.criteria.coarse_s + 1e-9
    times, errors = world.windows.starts[run] + course.t[fine], course.errors[fine]
    truth = reference_at(recording, times, world.windows.half_sample)
    q_nb = attitude.multiply(attitude.misalignment_quaternion(errors[:, :3]), truth.q_nb)
    pos = earth.displace(earth.get(recording.site.earth), truth.pos, errors[:, 6:])
    return displacement_errors(recording, times, q_nb, pos)[1]
