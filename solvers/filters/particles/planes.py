"""Particles (..., M, n) in kernels: moments and affine maps, a few hundred particles at a time.

A kernel copies ``LANES`` particles to planes, with a row for each component. Loops over a row are vector code, and planes of
this size stay in the nearest cache. See docs/kernels.md.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import inner
from solvers.types import Gaussian

LANES = 128  #: number of particles in a plane


@helper
def load(x: Array, start: int, origin: Array, X: Array) -> int:
    """Fill planes X (n, LANES) with x - origin of the particles (M, n) from ``start`` on; return how many there were.

    Planes behind them are zero.
    """
    count = min(LANES, len(x) - start)
    part = x[start : start + count]
    for i in range(len(X)):
        for j in range(count):
            X[i, j] = part[j, i] - origin[i]
        for j in range(count, LANES):
            X[i, j] = 0.0
    return count


@helper
def store(X: Array, start: int, count: int, x: Array) -> None:
    """Write planes X (n, LANES) into the ``count`` particles of x (M, n) from ``start`` on."""
    part = x[start : start + count]
    for j in range(count):
        for i in range(len(X)):
            part[j, i] = X[i, j]


@helper
def add_product(A: Array, X: Array, Y: Array) -> None:
    """Add A X to Y, for planes X (n, LANES) and Y (m, LANES); zeros of A cost nothing."""
    for i in range(len(Y)):
        for k in range(len(X)):
            a = A[i, k]
            if a != 0.0:
                for j in range(LANES):
                    Y[i, j] += a * X[k, j]


@helper
def weighted_sums(x: Array, weights: Array, origin: Array, first: Array, second: Array) -> None:
    """Fill first (n) and second (n, n) with the sums of w d and w d d' over particles x (M, n), d = x - origin."""
    points, n = x.shape
    X, weighted, ones = np.empty((n, LANES)), np.empty(LANES), np.ones(LANES)
    first[:] = 0.0
    second[:] = 0.0
    for start in range(0, points, LANES):
        count = load(x, start, origin, X)
        w = weights[start : start + count]
        for i in range(n):
            for j in range(count):
                weighted[j] = w[j] * X[i, j]
            for j in range(count, LANES):
                weighted[j] = 0.0
            first[i] += inner(weighted, ones, LANES)
            for k in range(i + 1):
                second[i, k] += inner(weighted, X[k], LANES)
    for i in range(n):
        for k in range(i):
            second[k, i] = second[i, k]


def equal(count: int) -> Array:
    """Return equal weights (M,) of sum one."""
    return np.broadcast_to(1.0 / count, (count,))


def cloud_moments(x: Array, weights: Array | None = None) -> Gaussian:
    """Return mean and covariance of particles (..., M, n) with ``weights`` (..., M) of sum one; None: all equal."""
    return Gaussian(*_moments(x, equal(x.shape[-2]) if weights is None else weights))


@kernel("(p,n),(p)->(n),(n,n)")
def _moments(x: Array, weights: Array, mean: Array, cov: Array) -> None:
    n = len(mean)
    origin = np.empty(n)
    for i in range(n):
        origin[i] = x[0, i]  # near the mean, so that nothing cancels
    weighted_sums(x, weights, origin, mean, cov)
    for i in range(n):
        for k in range(n):
            cov[i, k] -= mean[i] * mean[k]
    for i in range(n):
        mean[i] += origin[i]


@kernel("(p,n)->(n,n)")
def second_moments(x: Array, out: Array) -> None:
    """Return the mean (..., n, n) of x x' over particles (..., M, n)."""
    points, n = x.shape
    weighted_sums(x, np.full(points, 1.0 / points), np.zeros(n), np.empty(n), out)


@kernel("(p,n),(n),(m,n),(m)->(p,m)")
def affine(x: Array, origin: Array, A: Array, to: Array, out: Array) -> None:
    """Return A (x - origin) + to (..., M, m) for particles x (..., M, n)."""
    points, n = x.shape
    m = len(to)
    X, Y = np.empty((n, LANES)), np.empty((m, LANES))
    for start in range(0, points, LANES):
        count = load(x, start, origin, X)
        for i in range(m):
            Y[i] = to[i]
        add_product(A, X, Y)
        store(Y, start, count, out)


@kernel("(p,n),(n),(),(p,k),(n,k)->(p,n)")
def roughened(x: Array, mean: Array, shrink: float, N: Array, S: Array, out: Array) -> None:
    """Return mean + shrink (x - mean) + S N for particles x (..., M, n) and normal numbers N (..., M, k)."""
    points, n = x.shape
    k = N.shape[1]
    X, Z, origin = np.empty((n, LANES)), np.empty((k, LANES)), np.zeros(k)
    for start in range(0, points, LANES):
        count = load(x, start, mean, X)
        for i in range(n):
            for j in range(LANES):
                X[i, j] = mean[i] + shrink * X[i, j]
        load(N, start, origin, Z)
        add_product(S, Z, X)
        store(X, start, count, out)


@kernel("(p,n),(p)->(p,n)", "dqd")
def taken(x: Array, indices: NDArray[np.int64], out: Array) -> None:
    """Return the particles (..., M, n) with the ``indices`` (..., M)."""
    for j in range(len(indices)):
        for i in range(out.shape[1]):
            out[j, i] = x[indices[j], i]
