"""Adaptive noise: what each fix says of the mean and covariance of w and v, and how a filter remembers it.

With x~ = x+ - x- = K e the correction, the statistics of Sage and Husa, 000 (3.4.45-48) = 002 (42-45), are

    q: x+ - f(x)              = q + K e             Q: K e e' K' + P+ - PF = Q + K e e' K' - K S K'
    r: z - h(x-)              = r + e               R: e e' - PH           = R + e e' - S

because P- = PF + Q and S = PH + R: each is the estimate in use plus the surprise of a correction against its own
covariance. That form needs no part of the filter (PF, PH, K) beside its result, and nothing cancels.

One noise is a ``Gaussian``: mean (..., p), covariance (..., p, p). The told one is the unit of every bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from solvers.blocks.conditioning import gate_limit, nis
from solvers.blocks.square_root import finite_items, symmetrize
from solvers.types import Gaussian, Innovation

PROJECTIONS = ("diagonal", "full", "none")
GUARDS = ("damp", "positive", "none")


class Noise(NamedTuple):
    """The noises that a filter believes in, in driven directions: x' = f(x) + G w, z = h(x) + v."""

    w: Gaussian  #: q (..., p), Q (..., p, p)
    v: Gaussian  #: r (..., m), R (..., m, m)


def memory_weight(k: NDArray[np.int64], b: float = 1.0) -> Array:
    """d_k (...), the weight of the k-th statistic: 1/k for b = 1, else (1 - b)/(1 - b^k). # 000 (3.4.45-48), 002 (64-71)"""
    return np.asarray(1.0 / k if b == 1.0 else (1.0 - b) / (1.0 - b**k), dtype=float)


def window_weights(k: NDArray[np.int64], m: int, b: float = 1.0) -> Array:
    """Weights (..., m) of ring buffers whose slot k % m was written last, min(k, m) slots being in use; k (...).

    A normalised exponential of the age: what the recursion 002 (75-81) sums up to, but exact after a projection too.
    """
    k = np.asarray(k)[..., None]
    age = (k - np.arange(m)) % m
    weights = np.where(age < k, float(b) ** age, 0.0)
    return weights / weights.sum(axis=-1, keepdims=True)


def gated(innovation: Innovation, gate: float) -> tuple[Array, Mask]:
    """How much (...) of each innovation counts, and which are beyond the gate: those count as if they lay on it.

    Shortened and not dropped, for a filter that is told too little noise finds every innovation too large and would
    never learn better.
    """
    size, limit = nis(innovation), gate_limit(gate, innovation.residual.shape[-1])
    beyond: Mask = size > limit
    return np.sqrt(np.divide(limit, size, out=np.ones(size.shape), where=beyond)), beyond


def variances(cov: Array) -> Array:
    """The diagonal (..., p) of (..., p, p)."""
    return np.diagonal(cov, axis1=-2, axis2=-1)


def statistic(now: Gaussian, moved: Gaussian, epochs: Array, damp: bool) -> Gaussian:
    """What a correction says of the noise ``now``: Lambda of its mean and covariance.

    ``moved``: the correction (..., p) and its covariance (..., p, p), K e and K S K' for w, e and S for v; ``epochs``
    (...): how many draws of the noise lie behind it. ``damp`` scales both by s_i = min(1, sqrt(epochs now_ii / K S K'_ii)),
    the share of the correction that the noise can have. Where other errors dominate, K S K' >> Q, the plain statistic
    is a small difference of large numbers, with a standard deviation of sqrt(2) K S K'; damped it is unbiased still, of
    relative error sqrt(2), and its variances are never negative.
    """
    step, expected = moved
    if damp:
        share = epochs[..., None] * np.maximum(variances(now.cov), 0.0)
        s = np.sqrt(np.minimum(1.0, share / np.maximum(variances(expected), np.finfo(float).tiny)))
        step, expected = s * step, s[..., :, None] * expected * s[..., None, :]
    n = epochs[..., None]
    surprise = step[..., :, None] * step[..., None, :] - expected
    return Gaussian(now.mean + step / n, now.cov + surprise / n[..., None])


def least(moved: Gaussian, epochs: Array) -> Array:
    """The statistic without its negative part, K e e' K' / epochs: biased, and positive. #
    docs/mathematics/filters.md#adaptive-noise (c), 000 (3.5.15)"""
    step = moved.mean
    return step[..., :, None] * step[..., None, :] / epochs[..., None, None]


def replace_low(cov: Array, biased: Array, floor: Array) -> Array:
    """``cov`` (..., p, p) with rows and columns of ``biased`` where a variance is below ``floor`` (..., p)."""
    low: Mask = variances(cov) < floor
    return np.where(low[..., :, None] | low[..., None, :], biased, cov)


def bound_mean(mean: Array, told: Array, cap: float) -> Array:
    """``mean`` (..., p) within sqrt(cap) standard deviations of the ``told`` covariance (..., p, p)."""
    limit = np.sqrt(cap * variances(told))
    return np.clip(mean, -limit, limit)


def bound(cov: Array, told: Array, floor: float, cap: float, project: str) -> Array:
    """``cov`` (..., p, p) within [floor, cap] of the ``told`` one; a noise told to be zero stays zero.

    "diagonal" bounds the variances and takes the told correlations, "full" the eigenvalues in units of the told
    standard deviations; "none" leaves ``cov`` alone, indefinite or not.
    """
    if project == "none":
        return cov
    given = variances(told)
    if project == "diagonal":
        s = np.sqrt(np.clip(_over(variances(cov), given), floor, cap))
        return s[..., :, None] * told * s[..., None, :]
    sd = np.sqrt(given)
    unit = _over(np.ones(given.shape), sd)
    relative = unit[..., :, None] * symmetrize(cov) * unit[..., None, :]
    finite = finite_items(relative)[..., None, None]
    eigenvalues, U = np.linalg.eigh(np.where(finite, relative, 0.0))
    clipped = symmetrize((U * np.clip(eigenvalues, floor, cap)[..., None, :]) @ U.mT)
    return np.where(finite, sd[..., :, None] * clipped * sd[..., None, :], np.nan)


def _over(a: Array, b: Array) -> Array:
    """a / b, and 0 where b is 0."""
    b = np.broadcast_to(b, a.shape)
    return np.divide(a, b, out=np.zeros(a.shape), where=b > 0.0)
