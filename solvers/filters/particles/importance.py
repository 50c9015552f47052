"""Weighted particles (..., M, n), M per run: densities, moments, resampling, and clouds fitted to given moments.

Weights are kept as logarithms until :func:`solvers.blocks.mixtures.normalise`. Everything works on whole batches.
Equations: docs/mathematics/filters.md#particles.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from solvers.blocks.conditioning import inverse_lower
from solvers.blocks.square_root import cholesky
from solvers.types import Function, Gaussian, Linear, Moments, NoiseLaw

LIKELIHOODS = ("told", "gaussian")
TEMPORARIES = 16  #: assumed number of temporary arrays, of the size of its argument, that f or h makes


def log_density(residual: Array, R: Array, law: NoiseLaw | None = None) -> Array:
    """Return log p(v) (..., M) at v = ``residual`` (..., M, m), for N(0, R) or the told law with scale matrix R.

    Directions in which R is zero do not count.
    """
    inverse = inverse_lower(cholesky(R)[0])
    white = residual @ inverse.mT
    squared = np.square(white).sum(axis=-1)
    m = residual.shape[-1]
    pivots = np.diagonal(inverse, axis1=-2, axis2=-1)
    log_det = np.log(np.where(pivots == 0.0, 1.0, pivots)).sum(axis=-1)[..., None]  # -log sqrt(det R)
    if law is not None and law.dof:
        from scipy.special import gammaln  # slow to import, needed by heavy tails only

        constant = gammaln(0.5 * (law.dof + m)) - gammaln(0.5 * law.dof) - 0.5 * m * math.log(law.dof * math.pi)
        return np.asarray(constant + log_det - 0.5 * (law.dof + m) * np.log1p(squared / law.dof))
    clean = log_det - 0.5 * (squared + m * math.log(2.0 * math.pi))
    if law is None or not law.share:
        return np.asarray(clean)
    dirty = log_det - 0.5 * (squared / law.factor + m * math.log(2.0 * math.pi * law.factor))
    return np.logaddexp(clean + math.log1p(-law.share), dirty + math.log(law.share))


def stand_in(residual: Array, explained: Array, R: Array, law: NoiseLaw | None) -> Array:
    """Return the R (..., m, m) of a Gaussian that stands for the told law once the residual (..., m) is seen.

    It is R / E[1 / s^2], with s the factor of the law. ``explained`` (..., m, m) is the covariance of h(x), so that the
    residual has the scale S = explained + R.
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
    """Return the told law, or None for a Gaussian one if the setting ``likelihood`` says so."""
    return law if likelihood == "told" else None


def through(g: Function, x: Array, memory_mb: float) -> Array:
    """Return g at particles (*batch, M, n), in slices of the particle axis whose temporaries fit in ``memory_mb``.

    The runs cannot be separated, because g is bound to its batch. Small slices are faster too, for they stay in the cache.
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
    """Return the mean (..., 1, n) of particles (..., M, n), as a product, several times faster than NumPy's sum."""
    if weights is None:
        weights = np.full(x.shape[-2], 1.0 / x.shape[-2])
    return weights[..., None, :] @ x


def cloud_moments(x: Array, weights: Array | None = None) -> Gaussian:
    """Return mean and covariance of particles (..., M, n) with ``weights`` (..., M) of sum one; None: all equal."""
    mean = average(x, weights)
    apart = x - mean
    if weights is None:
        return Gaussian(mean[..., 0, :], apart.mT @ apart / x.shape[-2])
    apart *= np.sqrt(weights)[..., None]
    return Gaussian(mean[..., 0, :], apart.mT @ apart)


def fit(x: Array, target: Gaussian, weights: Array | None = None) -> tuple[Array, Mask | None]:
    """Give particles the moments of ``target`` by a lower triangular map, and return them with the repaired runs.

    The map is near the identity, for it only removes the chance errors of a draw.
    """
    now = cloud_moments(x, weights)
    root, repaired = cholesky(target.cov)
    own, poor = cholesky(now.cov)
    A = root @ inverse_lower(own)
    moved = (x - now.mean[..., None, :]) @ A.mT
    moved += target.mean[..., None, :]
    return moved, poor if repaired is None else repaired if poor is None else repaired | poor


def bandwidth(count: int, n: int) -> float:
    """Return the best kernel width for ``count`` points of a Gaussian in n dimensions, as a share of their spread.

    Source: Silverman (1986), eq. 4.14; Musso, Oudjane & Le Gland (2001) for particles.
    """
    return float((4.0 / (count * (n + 2.0))) ** (1.0 / (n + 4.0)))


def systematic(weights: Array, u: Array) -> NDArray[np.int64]:
    """Return the indices (..., M) of the surviving particles: as many of each as points (j + u) / M fall into its weight.

    ``weights`` (..., M) sum to one. ``u`` (...) is uniform on [0, 1), one number per run.
    """
    M = weights.shape[-1]
    edges = np.ceil(M * np.cumsum(weights, axis=-1) - u[..., None])
    edges = np.clip(np.where(np.isfinite(edges), edges, M), 0, M).astype(np.int64)
    edges[..., -1] = M
    copies = np.diff(edges, axis=-1, prepend=0)
    return np.repeat(np.broadcast_to(np.arange(M), copies.shape).ravel(), copies.ravel()).reshape(copies.shape)


def cloud_images(x: Array, y: Array, weights: Array) -> tuple[Gaussian, Moments]:
    """Return the moments of particles x (..., M, n), and those of their images y (..., M, m) with cross covariance."""
    n = x.shape[-1]
    mean, cov = cloud_moments(np.concatenate([x, y], axis=-1), weights)
    images = Moments(mean[..., n:], cov[..., n:, n:], cov[..., :n, n:])
    return Gaussian(mean[..., :n], cov[..., :n, :n]), images
