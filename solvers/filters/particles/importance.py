"""Weighted particles (..., M, n), M per run: densities, moments, resampling, and clouds fitted to given moments.

Weights are kept as logarithms until :func:`solvers.blocks.mixtures.normalise`. Everything works on whole batches.
Equations: docs/mathematics/filters.md#particles.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.kernels import kernel
from solvers.blocks.conditioning import inverse_lower, reciprocal
from solvers.blocks.moments import linear_moments
from solvers.blocks.square_root import cholesky, either
from solvers.filters.particles.planes import LANES, affine, cloud_moments, load
from solvers.types import Function, Gaussian, Linear, Moments, NoiseLaw

LIKELIHOODS = ("told", "gaussian")
#: Assumed number of temporary arrays, of the size of its argument, that f or h makes, unless its ``temporaries`` says so.
TEMPORARIES = 16


def log_density(residual: Array, R: Array, law: NoiseLaw | None = None, exact: bool = False) -> Array:
    """Return log p(v) (..., M) at v = ``residual`` (..., M, m), for N(0, R) or the told law with scale matrix R.

    Directions in which R is zero do not count. With ``exact`` they do: the density of a residual that is not zero there is zero.
    """
    law = law or NoiseLaw()
    density: Array = _log_density(residual, cholesky(R)[0], law.share, law.factor, law.dof, exact)
    return density


@kernel("(p,m),(m,m),(),(),(),()->(p)", "ddddd?d")
def _log_density(v: Array, L: Array, share: float, factor: float, dof: float, exact: bool, out: Array) -> None:
    points, m = v.shape
    log_det = -0.5 * m * math.log(2.0 * math.pi)
    for i in range(m):
        if L[i, i] != 0.0:
            log_det -= math.log(L[i, i])
    X, squared, origin = np.empty((m, LANES)), np.empty(LANES), np.zeros(m)
    for start in range(0, points, LANES):
        count = load(v, start, origin, X)
        squared[:] = 0.0
        for i in range(m):  # L^-1 v
            for k in range(i):
                for j in range(LANES):
                    X[i, j] -= L[i, k] * X[k, j]
            inverse = reciprocal(L[i, i])
            if exact and inverse == 0.0:
                for j in range(LANES):
                    if X[i, j] != 0.0:
                        squared[j] = math.inf
            for j in range(LANES):
                X[i, j] *= inverse
                squared[j] += X[i, j] * X[i, j]
        part = out[start : start + count]
        for j in range(count):
            part[j] = log_det - 0.5 * squared[j]
    if dof != 0.0:
        constant = math.lgamma(0.5 * (dof + m)) - math.lgamma(0.5 * dof) + 0.5 * m * math.log(2.0 / dof) + log_det
        for j in range(points):
            out[j] = constant - 0.5 * (dof + m) * math.log1p(2.0 * (log_det - out[j]) / dof)
    elif share != 0.0:
        clean, dirty = math.log1p(-share), math.log(share) - 0.5 * m * math.log(factor)
        for j in range(points):
            exponent = out[j] - log_det
            a, b = clean + exponent, dirty + exponent / factor
            top = a if a > b else b
            out[j] = log_det + top + math.log1p(math.exp(min(a, b) - top))


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

    The runs cannot be separated, because g is bound to its batch. Small slices are faster too, for they stay in the cache. A
    compiled map makes no temporaries and gets all particles at once.
    """
    if isinstance(g, Linear):
        m, n = g.matrix.shape[-2:]
        image: Array = affine(x, np.zeros(n), g.matrix, np.zeros(m) if g.offset is None else g.offset)
        return image
    per_particle = getattr(g, "temporaries", TEMPORARIES) * x[..., :1, :].nbytes
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


def fit(x: Array, target: Gaussian, weights: Array | None = None) -> tuple[Array, Mask | None]:
    """Give particles the moments of ``target`` by a lower triangular map, and return them with the repaired runs.

    The map is near the identity, for it only removes the chance errors of a draw.
    """
    now = cloud_moments(x, weights)
    root, repaired = cholesky(target.cov)
    own, poor = cholesky(now.cov)
    return affine(x, now.mean, root @ inverse_lower(own), target.mean), either(repaired, poor)


def bandwidth(count: int, n: int) -> float:
    """Return the best kernel width for ``count`` points of a Gaussian in n dimensions, as a share of their spread.

    Source: Silverman (1986), eq. 4.14; Musso, Oudjane & Le Gland (2001) for particles.
    """
    return float((4.0 / (count * (n + 2.0))) ** (1.0 / (n + 4.0)))


@kernel("(p),()->(p)", "ddq")
def systematic(weights: Array, u: float, out: NDArray[np.int64]) -> None:
    """Return the indices (..., M) of the surviving particles: as many of each as points (j + u) / M fall into its weight.

    ``weights`` (..., M) sum to one. ``u`` (...) is uniform on [0, 1), one number per run.
    """
    M = len(weights)
    total, filled = 0.0, 0
    for i in range(M):
        total += weights[i]
        edge = np.ceil(M * total - u)
        lost = edge != edge  # NaN, which a comparison by size would report
        end = M if i == M - 1 or lost else int(min(max(edge, 0.0), M))
        for j in range(filled, end):
            out[j] = i
        filled = max(filled, end)


def cloud_images(h: Function, x: Array, y: Array, weights: Array) -> tuple[Gaussian, Moments]:
    """Return the moments of particles x (..., M, n), and those of their images y = h(x) (..., M, m) with cross covariance."""
    if isinstance(h, Linear):
        prior = cloud_moments(x, weights)
        return prior, linear_moments(h, prior)
    n = x.shape[-1]
    mean, cov = cloud_moments(np.concatenate([x, y], axis=-1), weights)
    images = Moments(mean[..., n:], cov[..., n:, n:], cov[..., :n, n:])
    return Gaussian(mean[..., :n], cov[..., :n, :n]), images
