"""What an aiding sensor adds to the bound: states of its own, and the information of a reading, at the truth.

Each sensor has one file here with a subclass of ``Term``. It is written apart from the aid of the solvers on purpose; a test
compares the two. See docs/mathematics/aiding.md#information.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.checks import find
from sins_env.states import Block


class Own(NamedTuple):
    """States of a sensor, with their spread and correlation time."""

    block: Block
    std: ArrayLike
    time_constant_s: float = math.inf
    #: what takes the place of a correlation time: A in x' = A x + w, and the densities of w, of each state
    dynamics: tuple[Array, Array] | None = None


class Instant(NamedTuple):
    """The true motion at the ends of epochs, (runs, epochs, ...)."""

    C: Array  #: (..., 3, 3) C_nb
    vel: Array  #: (..., 3) m/s, E, N, U
    rate: Array  #: (..., 3) rad/s, omega_eb^b
    pos: Array | None = None  #: (..., 3) latitude rad, longitude rad, height m
    t: Array | None = None  #: (epochs,) s


class Term(ABC):
    """The share of a sensor in the bound; ``spec`` has the errors that it really has."""

    name: ClassVar[str]
    holds: bool = True  #: whether readings err as assumed here; if not, the bound is only a reference

    def __init__(self, spec: Any, epoch_s: float) -> None:
        self.spec, self.epoch_s = spec, epoch_s

    @abstractmethod
    def states(self) -> list[Own]:
        """Return the sensor's states, in SI units."""

    @abstractmethod
    def rows(self, at: Instant) -> dict[str, Array]:
        """Return the derivatives (..., m, k) of INS minus reading, by what it depends on.

        These are the errors "phi", "dv" and "dp", "rate", the error of the measured rate, and the sensor's states.
        """

    @abstractmethod
    def noise(self) -> Array:
        """Return the variances of a reading, (m,)."""


def term(spec: Any, epoch_s: float) -> Term:
    """Return the term of a sensor.

    Raises:
        ValueError: a sensor without one.
    """
    return find("term of the bound", spec.name, __name__.rpartition(".")[0], Term)(spec, epoch_s)  # type: ignore[type-abstract]


def through_body(at: Instant, lever: Array, flow: Array | None = None) -> tuple[Array, dict[str, Array]]:
    """Return C' (v - flow) + omega_eb x lever (..., 3) in m/s, and its derivatives by phi, dv and rate."""
    back, skew = at.C.mT, attitude.skew
    vel = at.vel if flow is None else at.vel - flow
    y = (back @ vel[..., None])[..., 0] + np.cross(at.rate, lever)
    return y, {"phi": -back @ skew(vel), "dv": back, "rate": np.broadcast_to(-skew(lever), back.shape)}
