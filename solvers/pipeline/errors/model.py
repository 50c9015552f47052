"""What the error models share: named states and their place in the prior, and an epoch as a map of errors.

The map works on the INS's own integrals of specific force and attitude. C is evaluated once per epoch. Its change within the
epoch enters the velocity as C_mid' u = C' (u + r x u / 2), with r the rotation of c against n. This is of second order in the
epoch. Tests compare it with the difference of two strapdown runs, and with an adaptive solver of the differential equations.
Equations: docs/mathematics/error_models.md#epoch-map.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy import linalg

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.earth import Earth
from sins_env.prior import Prior
from sins_env.states import ERRORS, Block, Layout
from sins_env.types import NavState
from sins_env.units import DEG_PER_H, G0
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Gaussian, Transition

ACCEL_UNIT = 1e-3 * G0  #: m/s^2 in one unit of nabla
GYRO_UNIT = DEG_PER_H  #: rad/s in one unit of eps

total = np.add.reduce


def front(a: Array, axes: int = 1, ndim: int | None = None) -> Array:
    """Move the last ``axes`` axes to the front, and add an axis for points: (*batch, 3) -> (3, *batch, 1).

    ``ndim`` is the number of batch axes, for an ``a`` that may be shared by all runs.
    """
    n = a.ndim - axes
    moved = a.transpose(*range(n, a.ndim), *range(n))
    missing = 0 if ndim is None else ndim - n
    return moved.reshape(*moved.shape[:axes], *(1,) * missing, *moved.shape[axes:], 1)


def turn_euler(phi: Array, r: Array, s: Array, c: Array, out: Array) -> None:
    """Write phi + C_w^-1 r into ``out`` (3, ...), with C_w of docs/mathematics/frames.md#misalignment.

    ``s`` and ``c`` are the sine and cosine of phi.
    """
    k = (c[1] * r[2] - s[1] * r[0]) / c[0]
    out[0] = phi[0] + c[1] * r[0] + s[1] * r[2]
    out[1] = phi[1] + r[1] - s[0] * k
    out[2] = phi[2] + k


class EpochMap(ABC):
    """The map from errors x to those after the epoch, for (*batch, n) and, with sigma points, (*batch, points, n).

    Inside, components are in front, because NumPy is fast on planes over runs and points. ``C`` turns the biases into n.
    """

    def __init__(self, motion: EpochMotion, C: Array) -> None:
        h = motion.dt
        self._ndim = batch = motion.dvel_n.ndim - 1
        C = front(h * C, 2, batch)
        self.accel, self.gyro = ACCEL_UNIT * C, GYRO_UNIT * C
        self.force = front(motion.dvel_n)
        self.turn = front(h * (motion.rate_ie + motion.rate_en))
        self._tilt = front(-0.5 * attitude.skew(motion.dvel_n), 2)  # r -> r x force / 2
        self.transport = front(h * motion.transport, 2, batch)[:, :2]  # the vertical velocity causes no rotation

    @abstractmethod
    def advance(self, X: Array) -> Array:
        """Return the errors (n, *batch, points) after the epoch."""

    def __call__(self, x: Array) -> Array:
        if x.ndim == self._ndim + 1:
            return self(x[..., None, :])[..., 0, :]
        n = x.ndim - 1
        out = self.advance(np.ascontiguousarray(x.transpose(n, *range(n))))
        return np.ascontiguousarray(out.transpose(*range(1, n + 1), 0))

    def rotation(self, C: Array, w: Array, eps: Array) -> Array:
        """Return r (3, ...) in rad, the rotation of c against n in the epoch, if n turns by ``w`` (3, ...)."""
        return self.turn - total(C * w, axis=1) - total(self.gyro * eps, axis=1)

    def turned_force(self, rows: Array, r: Array) -> Array:
        """Return (C_mid - C)' f for the columns of C in ``rows`` (3, k, ...), with nabla neglected beside f."""
        change: Array = total(rows * total(self._tilt * r, axis=1)[:, None], axis=0)
        return change


@dataclass(frozen=True)
class Parameter(Block):
    """States that an aid adds to the errors of the INS: constants with a told standard deviation."""

    std: float = field(kw_only=True)  #: standard deviation at the start, in SI units


@dataclass(frozen=True)
class ErrorModel(ABC):
    """What the pipeline needs of an error model: its states by name, and transitions for a filter.

    The ``parameters`` of aids follow the states of the model and are constant.
    """

    core: ClassVar[Layout]  #: the model's own states
    fed: ClassVar[tuple[str, ...]]  #: adjacent blocks that feedback subtracts from the INS

    parameters: tuple[Parameter, ...] = field(default=(), kw_only=True)

    @cached_property
    def states(self) -> Layout:
        """The states of the model, followed by the parameters of aids."""
        return self.core.plus(*self.parameters)

    @abstractmethod
    def transition(self, motion: EpochMotion, Q: Array) -> Transition:
        """Return the transition of an epoch with process noise Q (n, n)."""

    @abstractmethod
    def corrected(self, model: Earth, nav: NavState, x: Array) -> NavState:
        """Return the state of the INS without the errors x (..., n)."""

    def biases(self, x: Array) -> tuple[Array, Array] | None:
        """Return gyro bias rad/s and accelerometer bias m/s^2 in x, (..., 3) each; None if they are not fed back."""
        return None

    def prior(self, prior: Prior, batch: tuple[int, ...]) -> Gaussian:
        """Return N(0, P0) for every run: (*batch, n), (*batch, n, n)."""
        P0 = self._told(prior.P0, [p.std for p in self.parameters])
        return Gaussian(np.zeros((*batch, len(P0))), np.broadcast_to(P0, (*batch, *P0.shape)).copy())

    def noise(self, prior: Prior) -> Array:
        """Return the told Q (n, n) of one epoch."""
        return self._told(prior.Q)

    def _told(self, full: Array, std: Sequence[float] | None = None) -> Array:
        """Turn a covariance of ERRORS into one of the model's states; parameters have the deviations ``std`` (SI) or none."""
        places, units = ERRORS.places(self.core), self.core.si
        own = full[np.ix_(places, places)] / np.outer(units, units)
        std = [0.0] * len(self.parameters) if std is None else std
        more = [np.eye(p.size) * (one / p.si) ** 2 for p, one in zip(self.parameters, std, strict=True)]
        return np.asarray(linalg.block_diag(own, *more))
