"""What the error models share: named states and their place in the prior, and an epoch as a map of errors.

The map works on the INS's own integrals of specific force and attitude. C is evaluated once per epoch. Its change within the
epoch enters the velocity as C_mid' u = C' (u + r x u / 2), with r the rotation of c against n. This is of second order in the
epoch. Tests compare it with the difference of two strapdown runs, and with an adaptive solver of the differential equations.
Equations: docs/mathematics/error_models.md#epoch-map.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from sins_env.arrays import Array
from sins_env.earth import Earth
from sins_env.prior import Prior
from sins_env.specs import ImuSpec
from sins_env.states import ERRORS, NAVIGATION, Block, Layout
from sins_env.types import NavState
from sins_env.units import DEG_PER_H, G0, UG
from solvers.blocks.square_root import symmetrize
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Gaussian, Transition

ACCEL_UNIT = 1e-3 * G0  #: m/s^2 in one unit of nabla
GYRO_UNIT = DEG_PER_H  #: rad/s in one unit of eps


@dataclass(frozen=True)
class Parameter(Block):
    """States that an aid adds to the errors of the INS: constants, or first-order Gauss-Markov processes."""

    std: float = field(kw_only=True)  #: standard deviation at the start, in SI units; a process keeps it
    time_constant_s: float = field(default=math.inf, kw_only=True)  #: correlation time; inf: a constant
    fed: bool = field(default=False, kw_only=True)  #: whether the aid takes the estimate over when it is fed back

    @property
    def constant(self) -> bool:
        """Whether the states stay as they are."""
        return math.isinf(self.time_constant_s)

    def decay(self, epoch_s: float) -> float:
        """Return the factor of an epoch."""
        return math.exp(-epoch_s / self.time_constant_s)

    def driven(self, epoch_s: float) -> float:
        """Return the standard deviation of what an epoch adds, in SI units."""
        return self.std * math.sqrt(-math.expm1(-2.0 * epoch_s / self.time_constant_s))

    def carry(self, epoch_s: float) -> Array:
        """Return the matrix (size, size) that takes the states through an epoch, the same in any unit."""
        return self.decay(epoch_s) * np.eye(self.size)

    def added(self, epoch_s: float) -> Array:
        """Return the covariance (size, size) of what an epoch adds, in SI units squared."""
        return self.driven(epoch_s) ** 2 * np.eye(self.size)

    def start(self) -> Array:
        """Return the covariance (size, size) at the start, in SI units squared."""
        return self.std**2 * np.eye(self.size)


@dataclass(frozen=True)
class ErrorModel(ABC):
    """What the pipeline needs of an error model: its states by name, and transitions for a filter.

    The ``parameters`` of aids follow the states of the model, which do not drive them. Those that are fed back come first.
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

    def prior(self, P0: Array, batch: tuple[int, ...]) -> Gaussian:
        """Return N(0, P0) for every run: (*batch, n), (*batch, n, n). P0 (..., 15, 15) is of ERRORS and may differ by run."""
        own = self._told(P0, [p.start() for p in self.parameters])
        return Gaussian(np.zeros((*batch, own.shape[-1])), np.broadcast_to(own, (*batch, *own.shape[-2:])).copy())

    def noise(self, prior: Prior) -> Array:
        """Return the told Q (n, n) of one epoch."""
        return self._told(prior.Q, self._added(prior.epoch_s))

    def disturbed(self, motion: EpochMotion, cov: Array) -> Array:
        """Return what errors of the increments of an epoch add to Q, (..., n, n).

        ``cov`` (..., 6, 6) is their covariance in the epoch, in body axes: angle in rad and velocity in m/s.
        """
        turned = np.zeros(cov.shape)
        turned[..., :3, :3], turned[..., 3:, 3:] = -motion.C, motion.C  # phi is the turn that the INS lacks
        Q = np.zeros((*cov.shape[:-2], ERRORS.size, ERRORS.size))
        Q[..., :6, :6] = symmetrize(turned @ cov @ turned.mT)
        return self._told(self._integrated(Q, motion.dt))

    def _integrated(self, Q: Array, epoch_s: float) -> Array:
        """Return the noise Q (..., 15, 15) of ERRORS in an epoch with what it does to the place; here there is none."""
        return Q

    def wandering(self, imu: ImuSpec, epoch_s: float) -> Array:
        """Return what Gauss-Markov biases of the told sensors add to Q (n, n) in one epoch, as random walks: 2 sigma^2 T / tau."""
        gyro = imu.gyro_markov_deg_h * DEG_PER_H * math.sqrt(2.0 * epoch_s / imu.gyro_markov_s)
        accel = imu.accel_markov_ug * UG * math.sqrt(2.0 * epoch_s / imu.accel_markov_s)
        return self._told(np.diag(np.square(ERRORS.values({"gyro_bias": gyro, "accel_bias": accel}))))

    def _added(self, epoch_s: float) -> list[Array]:
        return [p.added(epoch_s) for p in self.parameters]

    def carry(self, epoch_s: float) -> Array | None:
        """Return the matrix (k, k) that takes the parameters through an epoch; None if all are constant."""
        if epoch_s not in self._carries:
            constant = all(p.constant for p in self.parameters)
            blocks = [p.carry(epoch_s) for p in self.parameters]
            self._carries[epoch_s] = None if constant else self._of_parameters(blocks)
        return self._carries[epoch_s]

    @cached_property
    def _carries(self) -> dict[float, Array | None]:
        """What ``carry`` has found, by the length of the epoch."""
        return {}

    def added(self, epoch_s: float) -> Array:
        """Return the covariance (k, k) of what an epoch adds to the parameters, in their units."""
        return self._of_parameters([p.added(epoch_s) / p.si**2 for p in self.parameters])

    def _of_parameters(self, blocks: Sequence[Array]) -> Array:
        """Return the matrix (k, k) with these blocks on its diagonal."""
        own = np.zeros((self.states.size - self.core.size,) * 2)
        for p, block in zip(self.parameters, blocks, strict=True):
            here = slice(self.states[p.name].start - self.core.size, self.states[p.name].stop - self.core.size)
            own[here, here] = block
        return own

    @property
    def fed_parameters(self) -> tuple[str, ...]:
        """Names of the parameters that are fed back."""
        return tuple(p.name for p in self.parameters if p.fed)

    def _told(self, full: Array, blocks: Sequence[Array] | None = None) -> Array:
        """Turn a covariance of ERRORS into one of the model's states; parameters have the ``blocks`` (SI) or none."""
        places, units = ERRORS.places(self.core), self.core.si
        n = self.states.size
        own = np.zeros((*full.shape[:-2], n, n))
        own[..., : len(places), : len(places)] = full[..., places[:, None], places] / np.outer(units, units)
        blocks = [np.zeros((p.size, p.size)) for p in self.parameters] if blocks is None else blocks
        for p, block in zip(self.parameters, blocks, strict=True):
            own[..., self.states[p.name], self.states[p.name]] = block / p.si**2
        return own


def told(states: Layout, fed: Mapping[str, Array], errors: Array, P: Array) -> dict[str, Array]:
    """Return biases and parameters of aids by name, in SI units, and the standard deviation of each as ``<name>_sigma``.

    Each is what was fed back so far, ``fed``, and the error (..., n) that is estimated of the rest, with covariance P (..., n, n).
    """
    found: dict[str, Array] = {}
    for name in states.without(*NAVIGATION.names).names:
        here = states[name]
        found[name] = fed.get(name, 0.0) + states.si[here] * errors[..., here]
        found[f"{name}_sigma"] = states.si[here] * np.sqrt(np.diagonal(P[..., here, here], axis1=-2, axis2=-1))
    return found


def each_by(A: Array, x: Array) -> Array:
    """Return A x for each x (..., n). The bits of a row do not depend on how many there are, as those of ``x @ A.T`` do."""
    return np.asarray(np.matmul(A, x[..., None])[..., 0])


def carried(x: Array, carry: Array | None) -> Array:
    """Return x (..., n), in place, after the matrix ``carry`` (k, k) has taken the last k states through an epoch."""
    if carry is not None:
        x[..., -len(carry) :] = each_by(carry, x[..., -len(carry) :])
    return x
