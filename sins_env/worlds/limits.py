"""Limits of the values in an observation; fixes beyond them are clipped."""

from __future__ import annotations

import math

import numpy as np

MAX_ANGLE, MAX_SPEED, MAX_HEIGHT, MAX_TIME = 2 * math.pi, 1e4, 1e5, 1e7

POS_LOW = np.array([-math.pi / 2, -math.pi, -1e3])
POS_HIGH = np.array([math.pi / 2, math.pi, MAX_HEIGHT])


def clip_fix(vel: np.ndarray, pos: np.ndarray) -> None:
    """Clip fixes (..., 3) to the observation space, in place; heavy tails may leave it."""
    np.clip(vel, -MAX_SPEED, MAX_SPEED, out=vel)
    np.clip(pos, POS_LOW, POS_HIGH, out=pos)
