"""Gain and conditioning, written once for every Gaussian filter: equations 000 (3.2.10-14).

With S = L L' the innovation covariance and W = L^-1 P_yx, the gain is K = W' L^-1 and the posterior covariance is
P - K S K' = P - W'W. This form is exactly symmetric. It needs only the moments, so it serves linear, linearised and
sigma-point rules alike; Joseph's form needs H, which a sigma-point rule does not have. If rounding makes the result
indefinite, the next square root repairs it and the repair is counted. See docs/mathematics/filters.md#gaussian-update.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from sins_env.arrays import Array, Mask
from solvers.blocks.square_root import cholesky, symmetrize
from solvers.types import Gaussian, Innovation, Moments


def gain(predicted: Moments) -> tuple[Array, Array, Mask | None]:
    """Return K (..., n, m), W (..., m, n) with W'W = K S K', and a mask (...) of the runs whose S was repaired.

    ``predicted`` holds the moments of z, so its covariance S includes R.
    """
    L, repaired = cholesky(predicted.cov)
    return *root_gain(L, predicted.cross), repaired


def root_gain(L: Array, cross: Array) -> tuple[Array, Array]:
    """Return K (..., n, m) and W (..., m, n) with W'W = K S K', from the lower root L of S and P_xy (..., n, m)."""
    inverse = inverse_lower(L)
    W = inverse @ cross.mT
    return W.mT @ inverse, W


def condition(prior: Gaussian, predicted: Moments, z: Array) -> tuple[Gaussian, Innovation, Mask | None]:
    """Return the Gaussian given z (..., m), the innovation, and a mask (...) of the runs whose S was repaired.

    ``prior`` is (..., n), (..., n, n). ``predicted`` holds the moments of z under it, with R in the covariance.
    """
    K, W, repaired = gain(predicted)
    residual = z - predicted.mean
    mean = prior.mean + (K @ residual[..., None])[..., 0]
    return Gaussian(mean, prior.cov - W.mT @ W), Innovation(residual, predicted.cov), repaired


def posterior_cov(prior: Gaussian, predicted: Moments, K: Array) -> Array:
    """Return the covariance (..., n, n) of the error after an update with any gain K (..., n, m), the best or not.

    The best gain K* leaves P - K* S K*', and another one adds (K - K*) S (K - K*)'. This equals Joseph's form
    (I - K H) P (I - K H)' + K R K' with R = S - H P H', without the need for H.
    """
    best, W, _ = gain(predicted)
    apart = K - best
    return prior.cov - W.mT @ W + symmetrize(apart @ predicted.cov @ apart.mT)


def nis(innovation: Innovation) -> Array:
    """Return the normalised innovation squared r' S^-1 r, shape (...); directions known exactly do not count."""
    return _squared(_inverse_root(innovation.cov)[0], innovation.residual)


@cache
def gate_limit(gate: float, m: int) -> float:
    """Return the ``gate`` quantile of chi-square with ``m`` degrees of freedom, the limit of the NIS; inf for 1."""
    from scipy.special import gammaincinv  # slow to import, needed by gates only; scipy.stats is slower still

    return float(2.0 * gammaincinv(0.5 * m, gate))  # the quantile of chi-square


def log_likelihood(innovation: Innovation) -> Array:
    """Return log N(r; 0, S), shape (...), as in 004 (9); directions known exactly do not count."""
    inverse, _ = _inverse_root(innovation.cov)
    pivots = np.diagonal(inverse, axis1=-2, axis2=-1)
    log_pivots = np.log(np.where(pivots == 0.0, 1.0, pivots)).sum(axis=-1)  # -log sqrt(det S)
    m = innovation.residual.shape[-1]
    return log_pivots - 0.5 * (_squared(inverse, innovation.residual) + m * math.log(2.0 * math.pi))


def inverse(P: Array) -> tuple[Array, Mask | None]:
    """Return P^-1 (..., n, n) and a mask (...) of repaired runs; rows of states known exactly are zero."""
    known = np.diagonal(P, axis1=-2, axis2=-1) == 0.0
    root, repaired = _inverse_root(P + known[..., None] * np.eye(P.shape[-1]))
    root = np.where(known[..., None, :], 0.0, root)
    return root.mT @ root, repaired


def _squared(inverse: Array, residual: Array) -> Array:
    white = (inverse @ residual[..., None])[..., 0]
    squared: Array = (white * white).sum(axis=-1)
    return squared


def _inverse_root(S: Array) -> tuple[Array, Mask | None]:
    """Return L^-1 with S = L L', and a mask of the runs whose S was repaired."""
    L, repaired = cholesky(S)
    return inverse_lower(L), repaired


def inverse_lower(L: Array) -> Array:
    """Return L^-1 of a lower L (..., m, m). A direction known exactly (a zero row) gets zero, hence no gain."""
    pivots = np.diagonal(L, axis1=-2, axis2=-1)
    reciprocal = np.divide(1.0, pivots, out=np.zeros(pivots.shape), where=pivots != 0.0)
    inverse = np.zeros(L.shape)
    for i in range(L.shape[-1]):  # forward substitution: a loop over the few rows, for all runs at once
        inverse[..., i, i] = reciprocal[..., i]
        if i:
            row = (L[..., i : i + 1, :i] @ inverse[..., :i, :i])[..., 0, :]
            inverse[..., i, :i] = -reciprocal[..., i, None] * row
    return inverse
