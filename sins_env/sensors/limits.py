"""Limits of the values in an observation, and the fields that a sensor adds to one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sins_env.arrays import Array

MAX_ANGLE, MAX_SPEED, MAX_HEIGHT, MAX_TIME, MAX_AGE_S = 2 * math.pi, 1e4, 1e5, 1e7, 1e3

MAX_STD = 1e9  #: largest standard deviation that a receiver may state, m or m/s
POS_LOW = np.array([-math.pi / 2, -math.pi, -1e3])
POS_HIGH = np.array([math.pi / 2, math.pi, MAX_HEIGHT])


class Field(NamedTuple):
    """A field of an observation."""

    low: Array  #: least values, in the shape of one run
    high: Array  #: largest values
    what: str  #: unit and meaning

    @classmethod
    def of(cls, size: int, low: ArrayLike, high: ArrayLike, what: str) -> Field:
        """Make a field of ``size`` numbers."""
        return cls(np.broadcast_to(low, (size,)) * 1.0, np.broadcast_to(high, (size,)) * 1.0, what)

    @classmethod
    def mark(cls, what: str, size: int = 1) -> Field:
        """Make a field of ``size`` numbers that are 0 or 1."""
        return cls(np.zeros(size, dtype=np.int8), np.ones(size, dtype=np.int8), what)


def clip(name: str, values: NDArray[np.float64], fields: dict[str, Field]) -> None:
    """Clip readings (..., size) to the field of their name, in place; heavy tails may leave it."""
    np.clip(values, fields[name].low, fields[name].high, out=values)
