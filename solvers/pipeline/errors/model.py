"""What the error models share: named states and their place in the prior, and an epoch as a map of errors.

The map works on the INS's own integrals of specific force and attitude. C is evaluated once: its change within the epoch
enters the velocity as C_mid' u = C' (u + r x u / 2), r being the rotation of c against n. That is second order in the epoch;
tests compare it with the difference of two strapdown runs and with an adaptive ODE solver.
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
    """The last ``axes`` axes in front, and an axis for points behind: (*batch, 3) -> (3, *batch, 1).

    ``ndim``: of the batch, where ``a`` may be one for all runs.
    """
    n = a.ndim - axes
    moved = a.transpose(*range(n, a.ndim), *range(n))
    missing = 0 if ndim is None else ndim - n
    return moved.reshape(*moved.shape[:axes], *(1,) * missing, *moved.shape[axes:], 1)


def turn_euler(phi: Array, r: Array, s: Array, c: Array, out: Array) -> None:
    """phi + C_w^-1 r into ``out`` (3, ...); ``s`` and ``c`` are the sine and cosine of phi.
    docs/mathematics/frames.md#misalignment."""
    k = (c[1] * r[2] - s[1] * r[0]) / c[0]
    out[0] = phi[0] + c[1] * r[0] + s[1] * r[2]
    out[1] = phi[1] + r[1] - s[0] * k
    out[2] = phi[2] + k


class EpochMap(ABC):
    """x -> x after the epoch; takes (*batch, n) and, for sigma points, (*batch, points, n).

    Inside, components stand in front: planes over runs and points are what NumPy is fast on. ``C`` turns the biases into n.
    """

    def __init__(self, motion: EpochMotion, C: Array) -> None:
        h = motion.dt
        self._ndim = batch = motion.dvel_n.ndim - 1
        C = front(h * C, 2, batch)
        self.accel, self.gyro = ACCEL_UNIT * C, GYRO_UNIT * C
        self.force = front(motion.dvel_n)
        self.turn = front(h * (motion.rate_ie + motion.rate_en))
        self._tilt = front(-0.5 * attitude.skew(motion.dvel_n), 2)  # r -> r x force / 2
        self.transport = front(h * motion.transport, 2, batch)[:, :2]  # the vertical velocity turns nothing

    @abstractmethod
    def advance(self, X: Array) -> Array:
        """(n, *batch, points) -> the same after the epoch."""

    def __call__(self, x: Array) -> Array:
        if x.ndim == self._ndim + 1:
            return self(x[..., None, :])[..., 0, :]
        n = x.ndim - 1
        out = self.advance(np.ascontiguousarray(x.transpose(n, *range(n))))
        return np.ascontiguousarray(out.transpose(*range(1, n + 1), 0))

    def rotation(self, C: Array, w: Array, eps: Array) -> Array:
        """r (3, ...), how far c turns against n when n turns by ``w``: omega_nc of the epoch.
        docs/mathematics/error_models.md#epoch-map."""
        return self.turn - total(C * w, axis=1) - total(self.gyro * eps, axis=1)

    def turned_force(self, rows: Array, r: Array) -> Array:
        """(C_mid - C)' f of the columns of C in ``rows`` (3, k, ...): C at mid-epoch; nabla is nothing beside f."""
        change: Array = total(rows * total(self._tilt * r, axis=1)[:, None], axis=0)
        return change


@dataclass(frozen=True)
class Parameter(Block):
    """States that an aid adds to the errors of the INS: constants, told with the spread of their start."""

    std: float = field(kw_only=True)  #: SI


@dataclass(frozen=True)
class ErrorModel(ABC):
    """What the pipeline needs of an error model: its states by name, and epochs as a filter takes them.

    ``parameters`` stand behind the states of the model and stay as they are within an epoch.
    """

    core: ClassVar[Layout]  #: the model's own states
    fed: ClassVar[tuple[str, ...]]  #: neighbouring blocks that feedback takes out of the INS by subtraction

    parameters: tuple[Parameter, ...] = field(default=(), kw_only=True)

    @cached_property
    def states(self) -> Layout:
        """The model's states, and behind them the parameters of aids."""
        return self.core.plus(*self.parameters)

    @abstractmethod
    def transition(self, motion: EpochMotion, Q: Array) -> Transition: ...

    @abstractmethod
    def corrected(self, model: Earth, nav: NavState, x: Array) -> NavState:
        """The INS's state without the errors x (..., n)."""

    def biases(self, x: Array) -> tuple[Array, Array] | None:
        """Gyro bias rad/s and accelerometer bias m/s^2 in x, (..., 3) each; None where they are not fed back."""
        return None

    def prior(self, prior: Prior, batch: tuple[int, ...]) -> Gaussian:
        """N(0, P0) for every run: (*batch, n), (*batch, n, n)."""
        P0 = self._told(prior.P0, [p.std for p in self.parameters])
        return Gaussian(np.zeros((*batch, len(P0))), np.broadcast_to(P0, (*batch, *P0.shape)).copy())

    def noise(self, prior: Prior) -> Array:
        """Q (n, n) of one epoch."""
        return self._told(prior.Q)

    def _told(self, full: Array, std: Sequence[float] | None = None) -> Array:
        """A covariance of ERRORS as one of the model's states, with ``std`` (SI) or nothing for the parameters."""
        places, units = ERRORS.places(self.core), self.core.si
        own = full[np.ix_(places, places)] / np.outer(units, units)
        std = [0.0] * len(self.parameters) if std is None else std
        more = [np.eye(p.size) * (one / p.si) ** 2 for p, one in zip(self.parameters, std, strict=True)]
        return np.asarray(linalg.block_diag(own, *more))
