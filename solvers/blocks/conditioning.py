"""Gain and conditioning: written once for every Gaussian filter. # 000 (3.2.10-14)

With S = L L' the innovation covariance and W = L^-1 P_yx, the gain is K = W' L^-1 and the posterior
P - K S K' = P - W'W. That form needs the moments alone, so it serves linear, linearised and sigma-point rules
alike (Joseph's form needs H and R apart, and a sigma-point rule has no H), and it is exactly symmetric.
Where rounding makes the result indefinite, the next square root repairs it and the repair is counted.
"""

from __future__ import annotations

import math

import numpy as np

from solvers.blocks.square_root import Mask, cholesky
from solvers.types import Array, Gaussian, Innovation, Moments


def gain(predicted: Moments) -> tuple[Array, Array, Mask | None]:
    """K (..., n, m), W (..., m, n) with W'W = K S K', and the runs whose S was repaired.

    ``predicted`` is of z, so its covariance S includes R.
    """
    inverse, repaired = _inverse_root(predicted.cov)
    W = inverse @ predicted.cross.mT
    return W.mT @ inverse, W, repaired


def condition(prior: Gaussian, predicted: Moments, z: Array) -> tuple[Gaussian, Innovation, Mask | None]:
    """The belief after z (..., m) was seen, the innovation, and the runs whose S was repaired.

    ``prior`` (..., n), (..., n, n); ``predicted``: the moments of z under it, R included in the covariance.
    """
    K, W, repaired = gain(predicted)
    residual = z - predicted.mean
    mean = prior.mean + (K @ residual[..., None])[..., 0]
    return Gaussian(mean, prior.cov - W.mT @ W), Innovation(residual, predicted.cov), repaired


def nis(innovation: Innovation) -> Array:
    """Normalised innovation squared r' S^-1 r, shape (...); directions known exactly do not count."""
    return _squared(_inverse_root(innovation.cov)[0], innovation.residual)


def log_likelihood(innovation: Innovation) -> Array:
    """log N(r; 0, S), shape (...). # 004 (9)"""
    inverse, _ = _inverse_root(innovation.cov)
    log_pivots = np.log(np.diagonal(inverse, axis1=-2, axis2=-1)).sum(axis=-1)  # -log sqrt(det S)
    m = innovation.residual.shape[-1]
    return log_pivots - 0.5 * (_squared(inverse, innovation.residual) + m * math.log(2.0 * math.pi))


def _squared(inverse: Array, residual: Array) -> Array:
    white = (inverse @ residual[..., None])[..., 0]
    squared: Array = (white * white).sum(axis=-1)
    return squared


def _inverse_root(S: Array) -> tuple[Array, Mask | None]:
    """L^-1 with S = L L'; a direction that is known exactly (zero row of S) gets zero, hence no gain."""
    L, repaired = cholesky(S)
    pivots = np.diagonal(L, axis1=-2, axis2=-1)
    reciprocal = np.divide(1.0, pivots, out=np.zeros(pivots.shape), where=pivots != 0.0)
    inverse = np.zeros(L.shape)
    for i in range(L.shape[-1]):  # forward substitution: a loop over the few rows, for all runs at once
        inverse[..., i, i] = reciprocal[..., i]
        if i:
            row = (L[..., i : i + 1, :i] @ inverse[..., :i, :i])[..., 0, :]
            inverse[..., i, :i] = -reciprocal[..., i, None] * row
    return inverse, repaired
