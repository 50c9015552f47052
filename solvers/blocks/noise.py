"""Adaptive noise: what each fix says about the mean and covariance of w and v, and how a filter remembers it.

With the innovation e and the correction x+ - x- = K e, the statistics of Sage and Husa, 000 (3.4.45-48) = 002 (42-45), are

    q: x+ - f(x)              = q + K e             Q: K e e' K' + P+ - PF = Q + K e e' K' - K S K'
    r: z - h(x-)              = r + e               R: e e' - PH           = R + e e' - S

because P- = PF + Q and S = PH + R. Each is the estimate in use plus the difference of a correction squared and its expected
covariance. The forms on the right need no inner parts of the filter (PF, PH), and no large terms cancel.

A noise is a ``Gaussian`` with mean (..., p) and covariance (..., p, p). Bounds are relative to the told noise.
Equations and safeguards: docs/mathematics/filters.md#adaptive-noise.
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
    """The noises that a filter assumes: x' = f(x) + G w with w along the driven directions, and z = h(x) + v."""

    w: Gaussian  #: process noise: q (..., p), Q (..., p, p)
    v: Gaussian  #: measurement noise: r (..., m), R (..., m, m)


def memory_weight(k: NDArray[np.int64], b: float = 1.0) -> Array:
    """Return the weight d_k (...) of the k-th statistic: 1/k for b = 1, else (1 - b)/(1 - b^k).

    Equations 000 (3.4.45-48), 002 (64-71).
    """
    return np.asarray(1.0 / k if b == 1.0 else (1.0 - b) / (1.0 - b**k), dtype=float)


def window_weights(k: NDArray[np.int64], m: int, b: float = 1.0) -> Array:
    """Return the weights (..., m) of ring buffers whose slot k % m was written last; min(k, m) slots are in use.

    The weights are normalised powers b^age. The recursion 002 (75-81) gives the same sum, but not after an estimate was bounded.
    """
    k = np.asarray(k)[..., None]
    age = (k - np.arange(m)) % m
    weights = np.where(age < k, float(b) ** age, 0.0)
    return weights / weights.sum(axis=-1, keepdims=True)


def gated(innovation: Innovation, gate: float) -> tuple[Array, Mask]:
    """Return the factor (...) that shortens an innovation to the gate, and a mask of the innovations beyond it.

    An innovation is shortened and not dropped. A filter that is told too little noise finds every innovation too large, and
    would otherwise never learn.
    """
    size, limit = nis(innovation), gate_limit(gate, innovation.residual.shape[-1])
    beyond: Mask = size > limit
    return np.sqrt(np.divide(limit, size, out=np.ones(size.shape), where=beyond)), beyond


def variances(cov: Array) -> Array:
    """Return the diagonal (..., p) of a covariance (..., p, p)."""
    return np.diagonal(cov, axis1=-2, axis2=-1)


def statistic(now: Gaussian, moved: Gaussian, epochs: Array, damp: bool) -> Gaussian:
    """Return the statistic of one correction: mean and covariance of the noise that it suggests instead of ``now``.

    ``moved`` is the correction (..., p) and its covariance (..., p, p): K e and K S K' for w, or e and S for v.
    ``epochs`` (...) is the number of draws of the noise that lie behind it.

    ``damp`` scales both by s_i = min(1, sqrt(epochs now_ii / K S K'_ii)), the largest share that the noise can have in the
    correction. Without it, if other errors dominate (K S K' >> Q), the statistic is a small difference of large numbers. Its
    standard deviation is then sqrt(2) K S K'. The damped statistic is unbiased too, has a relative error of sqrt(2), and
    its variances are never negative.
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
    """Return the statistic without its negative part, K e e' K' / epochs, which is biased but positive: 000 (3.5.15)."""
    step = moved.mean
    return step[..., :, None] * step[..., None, :] / epochs[..., None, None]


def replace_low(cov: Array, biased: Array, floor: Array) -> Array:
    """Replace rows and columns of ``cov`` (..., p, p) by those of ``biased`` if a variance is below ``floor`` (..., p)."""
    low: Mask = variances(cov) < floor
    return np.where(low[..., :, None] | low[..., None, :], biased, cov)


def bound_mean(mean: Array, told: Array, cap: float) -> Array:
    """Clip ``mean`` (..., p) to sqrt(cap) standard deviations of the ``told`` covariance (..., p, p)."""
    limit = np.sqrt(cap * variances(told))
    return np.clip(mean, -limit, limit)


def bound(cov: Array, told: Array, floor: float, cap: float, project: str) -> Array:
    """Bound ``cov`` (..., p, p) to [floor, cap] times the ``told`` one; a noise told to be zero stays zero.

    ``project`` says what is bounded:

    - "diagonal": the variances, while the correlations are the told ones;
    - "full": the eigenvalues, in units of the told standard deviations;
    - "none": nothing, even if ``cov`` is indefinite.
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
    """Return a / b, and 0 for b = 0."""
    b = np.broadcast_to(b, a.shape)
    return np.divide(a, b, out=np.zeros(a.shape), where=b > 0.0)
