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
from sins_env.kernels import kernel
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
    regimes: Array  #: (..., M, C)


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
    def noise(self) -> Array:
        """Factors (M, 2) of the variances of gyros and accelerometers."""
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

    def mix(self, p: Array, x: Gaussian, regimes: Array, chain: Array, b: slice) -> Mixed:
        """Return the models before a prediction.

        Probabilities p (..., M), states (..., M, n) and probabilities (..., M, C) of the regimes come in. The slice ``b`` has the
        states of the offset.
        """
        entering = OFFSET_STD**2 if self.offset else -1.0
        ahead, mean, cov, moved = _mix(p, x.mean, x.cov, regimes, chain, entering, b.start, b.stop)
        return Mixed(ahead, Gaussian(mean, cov), moved)


@kernel("(m),(m,n),(m,n,n),(m,c),(m,m),(),(),()->(m),(m,n),(m,n,n),(m,c)", "ddddddqqdddd")
def _mix(
    p: Array, x: Array, P: Array, regimes: Array, chain: Array, entering: float, first: int, stop: int,
    ahead: Array, mean: Array, cov: Array, moved: Array,
) -> None:  # fmt: skip
    m, n = x.shape
    known = 0.0
    for j in range(m):
        for i in range(m):
            known += p[j] * chain[j, i]
    if known != known:
        ahead[:], mean[:], cov[:], moved[:] = math.nan, math.nan, math.nan, math.nan
        return
    share, apart = np.empty(m), np.empty((m, n))
    for to in range(m):
        ahead[to] = 0.0
        for j in range(m):
            ahead[to] += p[j] * chain[j, to]
        for j in range(m):
            share[j] = p[j] * chain[j, to] / ahead[to] if ahead[to] > 0.0 else (1.0 if j == to else 0.0)
        for c in range(regimes.shape[1]):
            moved[to, c] = 0.0
            for j in range(m):
                moved[to, c] += share[j] * regimes[j, c]
        for i in range(n):
            mean[to, i] = 0.0
            for j in range(m):
                mean[to, i] += share[j] * x[j, i]
            for j in range(m):
                apart[j, i] = x[j, i] - mean[to, i]
            for k in range(n):
                cov[to, i, k] = 0.0
        for j in range(m):
            if share[j] > 0.0:
                for i in range(n):
                    weighted = share[j] * apart[j, i]
                    for k in range(n):
                        cov[to, i, k] += share[j] * P[j, i, k] + weighted * apart[j, k]
        if entering < 0.0:
            continue
        for i in range(first, stop):  # the offset is in the last model alone
            if to == m - 1:
                cov[to, i, i] += entering * (1.0 - share[to])
                continue
            mean[to, i] = 0.0
            for k in range(n):
                cov[to, i, k] = 0.0
                cov[to, k, i] = 0.0


def propagate(x: Gaussian, F: Array, gyro: Array, accel: Array, factors: Array, k: int) -> Gaussian:
    """Return F x and F P F' + Q of models (..., M, n); only the first k states change.

    All models share F (..., n, n). Q is made of the noise ``gyro`` (..., n, n) of the gyros and ``accel`` (n, n) of the
    accelerometers, with the factors (M, 2).
    """
    return Gaussian(*_propagate(x.mean, x.cov, F, gyro, accel, factors, k))


def carried(F: Array, P: Array, k: int) -> Array:
    """Return F P F' for symmetric P (..., M, n, n) and F (..., n, n), whose rows from k on are those of the identity."""
    none = np.zeros(P.shape[-2:])
    still = np.zeros(P.shape[:-1])
    return np.asarray(_propagate(still, P, F, none, none, np.zeros((P.shape[-3], 2)), k)[1])


@kernel("(m,n),(m,n,n),(n,n),(n,n),(n,n),(m,2),()->(m,n),(m,n,n)", "ddddddqdd")
def _propagate(
    x: Array, P: Array, F: Array, gyro: Array, accel: Array, factors: Array, moving: int, mean: Array, cov: Array
) -> None:
    m, n = x.shape
    FP = np.empty((moving, n))
    for model in range(m):
        for i in range(n):
            mean[model, i] = x[model, i]
            for j in range(n):
                cov[model, i, j] = P[model, i, j]
        for i in range(moving):
            mean[model, i] = 0.0
            for j in range(n):
                mean[model, i] += F[i, j] * x[model, j]
                FP[i, j] = 0.0
            for k in range(n):
                factor = F[i, k]
                if factor != 0.0:
                    for j in range(n):
                        FP[i, j] += factor * P[model, k, j]
        for i in range(moving):
            for j in range(i + 1):
                total = factors[model, 0] * gyro[i, j] + factors[model, 1] * accel[i, j]
                for k in range(n):
                    total += FP[i, k] * F[j, k]
                cov[model, i, j] = total
                cov[model, j, i] = total
            for j in range(moving, n):
                cov[model, i, j] = FP[i, j]
                cov[model, j, i] = FP[i, j]
