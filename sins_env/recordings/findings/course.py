"""The heading of a base beside its course over ground."""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array, Mask
from sins_env.recordings.axes import heading_pitch_roll

COURSE_MPS, MOST_COURSE_DEG = 3.0, 20.0  #: least speed for a course, and the largest median angle to the forward axis


def off_course(q_nb: Array, vel: Array, least: int) -> tuple[float, Mask] | None:
    """Return the median angle, deg, by which attitudes (n, 4) point right of the course of velocities (n, 3), E, N, U.

    The mask (n,) has the velocities that are fast enough. None if fewer than ``least`` of them are.
    """
    fast = np.hypot(vel[:, 0], vel[:, 1]) > COURSE_MPS
    if fast.sum() < least:
        return None
    off = attitude.wrap(heading_pitch_roll(q_nb[fast])[:, 0] - np.arctan2(vel[fast, 0], vel[fast, 1]))
    return float(np.degrees(np.arctan2(np.median(np.sin(off)), np.median(np.cos(off))))), fast
