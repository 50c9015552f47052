"""Models of the noise as a Markov chain: factors of the told noise of gyros and accelerometers, and an offset of the fixes.

All models of a slice share its inertial solution and its tangent; they differ in Q, and one of them has an offset b of the fixes.
Before each prediction the models mix, as in docs/mathematics/filters.md#interacting-models. The offset exists in its own model
alone: it enters with a variance of its own, and leaves without a trace.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from solvers.blocks.square_root import symmetrize
from solvers.types import Gaussian

MEMORY_S = 100.0  #: s, mean time until a model of the IMU's noise is drawn anew
OTHER = 0.002  #: probability of each model of the IMU's noise but the told one, when one is drawn
OFFSET_EVERY_S = 1000.0 / 3.0  #: s, mean time between offsets of the fixes
OFFSET_LASTS_S = 10.0  #: s, mean length of an offset
OFFSET_STD = 0.5  #: m/s, standard deviation of each component of an offset


class Mixed(NamedTuple):
    """Models before a prediction."""

    weight: Array  #: (..., M)
    x: Gaussian  #: (..., M, n), (..., M, n, n)
    share: Array  #: (..., M, M), probability that a model (row) came from another (column)


@dataclass(frozen=True)
class Models:
    """The models: ``factors`` of the told variances of gyros and accelerometers, the told ones first, then the offset."""

    factors: tuple[tuple[float, float], ...]
    offset: bool  #: whether the last model has an offset of the fixes

    @property
    def count(self) -> int:
        """The number of models."""
        return len(self.factors) + self.offset

    @cached_property
    def gyro(self) -> Array:
        """Factors (M, 1, 1) of the variance of the gyros."""
        return self._factors[:, 0, None, None]

    @cached_property
    def accel(self) -> Array:
        """Factors (M, 1, 1) of the variance of the accelerometers."""
        return self._factors[:, 1, None, None]

    @property
    def _factors(self) -> Array:
        return np.array([*self.factors, *[(1.0, 1.0)] * self.offset])

    @cached_property
    def first(self) -> Array:
        """Probabilities (M,) at the start; there is no offset yet."""
        p = np.zeros(self.count)
        p[: len(self.factors)] = OTHER
        p[0] = 1.0 - OTHER * (len(self.factors) - 1)
        return p

    def chain(self, epoch_s: float) -> Array:
        """Return the probabilities (M, M) that a model (row) is followed by another (column) at the next epoch."""
        anew = 1.0 - math.exp(-epoch_s / MEMORY_S)
        A = (1.0 - anew) * np.eye(self.count) + anew * self.first
        if self.offset:
            enter, leave = (1.0 - math.exp(-epoch_s / time) for time in (OFFSET_EVERY_S, OFFSET_LASTS_S))
            A[:-1] *= 1.0 - enter
            A[:-1, -1] = enter
            A[-1] = leave * self.first
            A[-1, -1] = 1.0 - leave
        return A

    def mix(self, p: Array, x: Gaussian, chain: Array, b: slice) -> Mixed:
        """Return the models (..., M) before a prediction; ``b`` are the states of the offset."""
        joint = p[..., None] * chain  # (..., from, to)
        ahead = np.add.reduce(joint, axis=-2)
        reached = ahead > 0.0
        share = np.where(reached[..., None, :], joint, np.eye(self.count)) / np.where(reached, ahead, 1.0)[..., None, :]
        share = share.mT  # (..., to, from)
        mean = share @ x.mean
        *batch, M, n, _ = x.cov.shape
        cov = (share @ x.cov.reshape(*batch, M, n * n)).reshape(x.cov.shape)
        apart = x.mean[..., None, :, :] - mean[..., None, :]  # (..., to, from, n)
        cov += (apart * share[..., None]).mT @ apart
        if self.offset:
            for there in (mean[..., :-1, b], cov[..., :-1, b, :], cov[..., :-1, :, b]):
                there[...] = 0.0
            entered = OFFSET_STD**2 * (1.0 - share[..., -1, -1])
            cov[..., -1, b, b] += entered[..., None, None] * np.eye(b.stop - b.start)
        return Mixed(ahead, Gaussian(mean, cov), share)


def propagate(x: Gaussian, F: Array, Q: Array, k: int) -> Gaussian:
    """Return F x and F P F' + Q of models (..., M, n) that share F (..., n, n); only the first k states are not constant."""
    P = carried(F, x.cov, k)
    P[..., :k, :k] += Q[..., :k, :k]
    return Gaussian(x.mean @ F.mT, P)


def carried(F: Array, P: Array, k: int) -> Array:
    """Return F P F' for symmetric P (..., M, n, n) and F (..., n, n), whose rows from k on are those of the identity."""
    *batch, M, n, _ = P.shape
    top = F[..., :k, :]
    X = (P.reshape(*batch, M * n, n) @ top.mT).reshape(*batch, M, n, k)  # P F', one product for all models
    out = P.copy()
    out[..., :k, :k] = symmetrize(top[..., None, :, :] @ X)
    out[..., k:, :k] = X[..., k:, :]
    out[..., :k, k:] = X[..., k:, :].mT
    return out
