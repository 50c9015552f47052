"""Weighted particles (..., M, n), M per run: densities, moments, resampling, and clouds fitted to given moments.

Weights are kept as logarithms until they are normalised (``mixtures.normalise``); all is written for whole batches.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from sins_env.arrays import Array, Mask
from solvers.blocks.conditioning import inverse_lower
from solvers.blocks.square_root import cholesky
from solvers.types import Function, Gaussian, Linear, Moments, NoiseLaw

LIKELIHOODS = ("told", "gaussian")
TEMPORARIES = 16  #: arrays of the size of its argument that a model is taken to make


def log_density(residual: Array, R: Array, law: NoiseLaw | None = None) -> Array:
    """log p(v) (..., M) at v = ``residual`` (..., M, m), of N(0, R), or of the told law with the scale matrix R.

    Directions in which R is zero do not count.
    """
    inverse = inverse_lower(cholesky(R)[0])
    white = residual @ inverse.mT
    squared = np.square(white).sum(axis=-1)
    m = residual.shape[-1]
    pivots = np.diagonal(inverse, axis1=-2, axis2=-1)
    log_det = np.log(np.where(pivots == 0.0, 1.0, pivots)).sum(axis=-1)[..., None]  # of R^-1/2
    if law is not None and law.dof:
        constant = gammaln(0.5 * (law.dof + m)) - gammaln(0.5 * law.dof) - 0.5 * m * math.log(law.dof * math.pi)
        return np.asarray(constant + log_det - 0.5 * (law.dof + m) * np.log1p(squared / law.dof))
    clean = log_det - 0.5 * (squared + m * math.log(2.0 * math.pi))
    if law is None or not law.share:
        return np.asarray(clean)
    dirty = log_det - 0.5 * (squared / law.factor + m * math.log(2.0 * math.pi * law.factor))
    return np.logaddexp(clean + math.log1p(-law.share), dirty + math.log(law.share))


def stand_in(residual: Array, explained: Array, R: Array, law: NoiseLaw | None) -> Array:
    """The R of a Gaussian that stands for the told law once the residual (..., m) is seen: R / E[1 / s^2]. (..., m, m)

    ``explained`` (..., m, m) is the covariance of h(x), so that the residual has the scale S = explained + R.
    """
    if law is None:
        return R
    S = explained + R
    if law.dof:
        inverse = inverse_lower(cholesky(S)[0])
        squared = np.square((inverse @ residual[..., None])[..., 0]).sum(axis=-1)
        precision = (law.dof + residual.shape[-1]) / (law.dof + squared)
    else:
        v = residual[..., None, :]
        odds = (
            law.share
            / (1.0 - law.share)
            * np.exp(np.minimum(log_density(v, S + (law.factor - 1.0) * R) - log_density(v, S), 700.0)[..., 0])
        )
        precision = (1.0 + odds / law.factor) / (1.0 + odds)
    return np.asarray(R / precision[..., None, None])


def law_for(likelihood: str, law: NoiseLaw | None) -> NoiseLaw | None:
    """The told law, or None (Gaussian) where the setting says so."""
    return law if likelihood == "told" else None


def through(g: Function, x: Array, memory_mb: float) -> Array:
    """g at particles (*batch, M, n), in slices of the particle axis whose temporaries fit in ``memory_mb``.

    Runs cannot be taken apart, for g is bound to its batch. Small slices are also faster: they stay in the cache.
    """
    if isinstance(g, Linear):  # one product for all particles of a run
        y = x @ g.matrix.mT
        return y if g.offset is None else y + (g.offset if g.offset.ndim == 1 else g.offset[..., None, :])
    per_particle = TEMPORARIES * x[..., :1, :].nbytes
    step = max(1, int(memory_mb * 1e6 / max(per_particle, 1)))
    count = x.shape[-2]
    if step >= count:
        return g(x)
    first = g(x[..., :step, :])
    y = np.empty((*x.shape[:-1], first.shape[-1]))
    y[..., :step, :] = first
    for a in range(step, count, step):
        y[..., a : a + step, :] = g(x[..., a : a + step, :])
    return y


def average(x: Array, weights: Array | None = None) -> Array:
    """The mean (..., 1, n) of particles (..., M, n); a product is several times faster than NumPy's sum over M."""
    if weights is None:
        weights = np.full(x.shape[-2], 1.0 / x.shape[-2])
    return weights[..., None, :] @ x


def cloud_moments(x: Array, weights: Array | None = None) -> Gaussian:
    """Mean and covariance of particles (..., M, n) with ``weights`` (..., M) that sum to one; None: all the same."""
    mean = average(x, weights)
    apart = x - mean
    if weights is None:
        return Gaussian(mean[..., 0, :], apart.mT @ apart / x.shape[-2])
    apart *= np.sqrt(weights)[..., None]
    return Gaussian(mean[..., 0, :], apart.mT @ apart)


def fit(x: Array, target: Gaussian, weights: Array | None = None) -> tuple[Array, Mask | None]:
    """The particles moved by the lower triangular map that gives them the moments of ``target``, and which runs were repaired.

    Makes up for what chance left in the moments of a draw: a map near the identity.
    """
    now = cloud_moments(x, weights)
    root, repaired = cholesky(target.cov)
    own, poor = cholesky(now.cov)
    A = root @ inverse_lower(own)
    moved = (x - now.mean[..., None, :]) @ A.mT
    moved += target.mean[..., None, :]
    return moved, poor if repaired is None else repaired if poor is None else repaired | poor


def bandwidth(count: int, n: int) -> float:
    """The kernel's standard deviation, as a share of the spread, that smooths ``count`` points of a Gaussian best.

    Silverman (1986), eq. 4.14; Musso, Oudjane & Le Gland (2001) for particles.
    """
    return float((4.0 / (count * (n + 2.0))) ** (1.0 / (n + 4.0)))


def systematic(weights: Array, u: Array) -> NDArray[np.int64]:
    """Indices (..., M) of the particles that survive: as many of each as points (j + u) / M fall into its weight.

    ``weights`` (..., M) sum to one; ``u`` (...) uniform on [0, 1), one number per run.
    """
    M = weights.shape[-1]
    edges = np.ceil(M * np.cumsum(weights, axis=-1) - u[..., None])
    edges = np.clip(np.where(np.isfinite(edges), edges, M), 0, M).astype(np.int64)
    edges[..., -1] = M
    copies = np.diff(edges, axis=-1, prepend=0)
    return np.repeat(np.broadcast_to(np.arange(M), copies.shape).ravel(), copies.ravel()).reshape(copies.shape)


def cloud_images(x: Array, y: Array, weights: Array) -> tuple[Gaussian, Moments]:
    """Moments of the particles x (..., M, n), and of their images y (..., M, m) with the cross covariance (..., n, m)."""
    n = x.shape[-1]
    mean, cov = cloud_moments(np.concatenate([x, y], axis=-1), weights)
    images = Moments(mean[..., n:], cov[..., n:, n:], cov[..., :n, n:])
    return Gaussian(mean[..., :n], cov[..., :n, :n]), images
