"""Gain and conditioning, written once for every Gaussian filter: equations 000 (3.2.10-14).

With S = L L' the innovation covariance and W = L^-1 P_yx, the gain is K = W' L^-1 and the posterior covariance is
P - K S K' = P - W'W. This form is exactly symmetric. It needs only the moments, so it serves linear, linearised and
sigma-point rules alike; Joseph's form needs H, which a sigma-point rule does not have. If rounding makes the result
indefinite, the next square root repairs it and the repair is counted. See docs/mathematics/filters.md#gaussian-update.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.kernels import helper, kernel
from solvers.blocks.moments import Affine, grow, linear_moments, look, products
from solvers.blocks.square_root import cholesky, decompose, some, symmetrize
from solvers.types import Gaussian, Innovation, Moments

#: Least variance after a fix, relative to that before. P - W'W keeps no more digits: without a floor a prior of 1e16 would
#: leave variances of either sign.
ROUNDING = 2e-15
BROKEN = 1e3  #: a variance that is negative by more than so many times the rounding is broken, and stays as it is


def gain(predicted: Moments) -> tuple[Array, Array, Mask | None]:
    """Return K (..., n, m), W (..., m, n) with W'W = K S K', and a mask (...) of the runs whose S was repaired.

    ``predicted`` holds the moments of z, so its covariance S includes R.
    """
    L, repaired = cholesky(predicted.cov)
    return *root_gain(L, predicted.cross), repaired


@helper
def reciprocal(pivot: float) -> float:
    """Return 1 / pivot, and zero for a direction known exactly (a zero pivot), which hence gets no gain."""
    return 1.0 / pivot if pivot != 0.0 else 0.0


@helper
def whiten(L: Array, cross: Array, W: Array) -> None:
    """Fill W (m, n) with L^-1 P_yx, for a lower L (m, m) and P_xy (n, m)."""
    for i in range(len(L)):
        inverse = reciprocal(L[i, i])
        for j in range(len(cross)):
            total = cross[j, i]
            for k in range(i):
                total -= L[i, k] * W[k, j]
            W[i, j] = inverse * total


@helper
def whiten_vector(L: Array, residual: Array, e: Array) -> None:
    """Fill e (m) with L^-1 residual, for a lower L (m, m)."""
    for i in range(len(L)):
        total = residual[i]
        for k in range(i):
            total -= L[i, k] * e[k]
        e[i] = reciprocal(L[i, i]) * total


@kernel("(m,m),(n,m)->(n,m),(m,n)")
def root_gain(L: Array, cross: Array, K: Array, W: Array) -> None:
    """Return K (..., n, m) and W (..., m, n) with W'W = K S K', from the lower root L of S and P_xy (..., n, m)."""
    whiten(L, cross, W)
    m = len(L)
    for j in range(len(cross)):
        for i in range(m - 1, -1, -1):
            total = W[i, j]
            for k in range(i + 1, m):
                total -= L[k, i] * K[j, k]
            K[j, i] = reciprocal(L[i, i]) * total


def condition(prior: Gaussian, predicted: Moments, z: Array) -> tuple[Gaussian, Innovation, Mask | None]:
    """Return the Gaussian given z (..., m), the innovation, and a mask (...) of the runs whose S was repaired.

    ``prior`` is (..., n), (..., n, n). ``predicted`` holds the moments of z under it, with R in the covariance.
    """
    L, repaired = cholesky(predicted.cov)
    mean, cov, residual = _posterior(prior.mean, prior.cov, predicted.mean, predicted.cross, L, z)
    return Gaussian(mean, cov), Innovation(residual, predicted.cov), repaired


def condition_affine(prior: Gaussian, h: Affine, R: Array, z: Array) -> tuple[Gaussian, Innovation, Mask | None]:
    """Return what ``condition`` does for z = h(x) + v with v ~ N(0, R), to the bit: in one kernel if no S needs a repair."""
    (H, offset), value = h
    if H.shape[-2] < H.shape[-1]:
        given, known = _prediction(H, offset, value)
        mean, cov, residual, S, bad = _corrected(prior.mean, prior.cov, H, given, known, R, z)
        if not some(bad):
            return Gaussian(mean, cov), Innovation(residual, S), None
    return condition(prior, linear_moments(h.map, prior, R, value), z)


def advance_affine(
    x: Gaussian, f: Affine, Q: Array, h: Callable[[Array], Affine | None], R: Array, z: Array
) -> tuple[Array, Array, Array, Array] | None:
    """Return mean and covariance of f(x) + w, w ~ N(0, Q), given z = h(x) + v, with residual and S: both steps in one kernel.

    ``h`` gives the affine map that stands for h, for the predicted mean. The results have the bits of the steps one by one.
    None: these are needed, for there is no such map, it has as many rows as states, some S needs a repair, or a result is not
    finite.
    """
    ahead, P, _ = products(f, x)
    line = h(ahead)
    if line is None:
        return None
    (H, offset), value = line
    if H.shape[-2] >= H.shape[-1]:
        return None
    given, known = _prediction(H, offset, value)
    mean, cov, residual, S, bad = _advanced(ahead, P, Q, H, given, known, R, z)
    return None if some(bad) else (mean, cov, residual, S)


def _prediction(H: Array, offset: Array | None, value: Array | None) -> tuple[Array, bool]:
    """Return the value of an affine map or, if it is not known, its offset, and whether it is the value."""
    if value is not None:
        return value, True
    return _zeros(H.shape[-2]) if offset is None else offset, False


@cache
def _zeros(m: int) -> Array:
    """Return zeros (m,), which nobody may change."""
    zeros = np.zeros(m)
    zeros.setflags(write=False)
    return zeros


@kernel("(n),(n,n),(m,n),(m),(),(m,m),(m)->(n),(n,n),(m),(m,m),()", "dddd?dddddd?")
def _corrected(
    x: Array, P: Array, H: Array, given: Array, known: bool, R: Array, z: Array,
    mean: Array, cov: Array, residual: Array, S: Array, bad: Mask,
) -> None:  # fmt: skip
    bad[0] = not correct(x, P, H, given, known, R, z, mean, cov, residual, S)


@kernel("(n),(n,n),(n,n),(m,n),(m),(),(m,m),(m)->(n),(n,n),(m),(m,m),()", "ddddd?dddddd?")
def _advanced(
    x: Array, P: Array, Q: Array, H: Array, given: Array, known: bool, R: Array, z: Array,
    mean: Array, cov: Array, residual: Array, S: Array, bad: Mask,
) -> None:  # fmt: skip
    n = len(x)
    ahead, size = np.empty((n, n)), 0.0
    grow(P, Q, ahead)
    bad[0] = not correct(x, ahead, H, given, known, R, z, mean, cov, residual, S)
    if bad[0]:
        return
    for i in range(n):
        row = abs(mean[i])
        for j in range(i + 1):
            row += abs(cov[i, j])
        size += row
    bad[0] = not size < math.inf


@helper
def correct(
    x: Array, P: Array, H: Array, given: Array, known: bool, R: Array, z: Array,
    mean: Array, cov: Array, residual: Array, S: Array,
) -> bool:  # fmt: skip
    """Fill in what ``condition`` returns, and return True; if S is not positive definite, return False.

    The prediction of z is ``given`` if it is ``known``, else H x + ``given``.
    """
    m, n = H.shape
    rows = np.empty((1 + m + n, m))
    y, L, cross = rows[0], rows[1 : 1 + m], rows[1 + m :]
    look(H, x, P, y, S, cross)
    for i in range(m):
        y[i] = given[i] if known else y[i] + given[i]
        for j in range(m):
            S[i, j] += R[i, j]
    if not decompose(S, L):
        return False
    posterior(x, P, y, cross, L, z, mean, cov, residual)
    return True


@kernel("(n),(n,n),(m),(n,m),(m,m),(m)->(n),(n,n),(m)")
def _posterior(
    x: Array, P: Array, y: Array, cross: Array, L: Array, z: Array, mean: Array, cov: Array, residual: Array
) -> None:
    posterior(x, P, y, cross, L, z, mean, cov, residual)


@helper
def posterior(
    x: Array, P: Array, y: Array, cross: Array, L: Array, z: Array, mean: Array, cov: Array, residual: Array
) -> None:
    """Fill in mean and covariance given z, and z - y, from the moments y, P_xy and the lower root L of S."""
    n, m = cross.shape
    both = np.empty((m, n + 1))
    W, e = both[:, :n], both[:, n]
    for i in range(m):
        residual[i] = z[i] - y[i]
    whiten(L, cross, W)
    whiten_vector(L, residual, e)
    for j in range(n):
        mean[j] = x[j]
        for k in range(j + 1):
            cov[j, k] = P[j, k]
        for i in range(m):
            mean[j] += W[i, j] * e[i]
            for k in range(j + 1):
                cov[j, k] -= W[i, j] * W[i, k]
        least = ROUNDING * P[j, j]
        if -BROKEN * least < cov[j, j] < least:
            cov[j, j] = least
        for k in range(j):
            cov[k, j] = cov[j, k]


def posterior_cov(prior: Gaussian, predicted: Moments, K: Array) -> Array:
    """Return the covariance (..., n, n) of the error after an update with any gain K (..., n, m), the best or not.

    The best gain K* leaves P - K* S K*', and another one adds (K - K*) S (K - K*)'. This equals Joseph's form
    (I - K H) P (I - K H)' + K R K' with R = S - H P H', without the need for H.
    """
    best, W, _ = gain(predicted)
    apart = K - best
    return above_rounding(prior.cov - W.mT @ W + symmetrize(apart @ predicted.cov @ apart.mT), prior.cov)


def above_rounding(cov: Array, before: Array) -> Array:
    """Return a covariance (..., n, n) after a fix with variances of at least ``ROUNDING`` times those before it, unless broken."""
    least, variance = (np.diagonal(P, axis1=-2, axis2=-1) for P in (ROUNDING * before, cov))
    lost = np.where((-BROKEN * least < variance) & (variance < least), least - variance, 0.0)
    return cov + lost[..., None] * np.eye(lost.shape[-1]) if lost.any() else cov


def noise_about(R: Array, S: Array, told: Array) -> Array:
    """Return the noise about the slope of h, R (..., m, m) = S - H P H', where it is more than the rounding of S.

    In the other runs it is the told noise. One that is zero becomes the least that the rounding of S lets see.
    """
    size = np.diagonal(S, axis1=-2, axis2=-1)
    low = np.asarray((np.diagonal(R, axis1=-2, axis2=-1) < 1e-12 * size).any(axis=-1))
    if not low.any():
        return R
    least = np.where(np.diagonal(told, axis1=-2, axis2=-1) > 10.0 * ROUNDING**2 * size, 0.0, ROUNDING * size)
    return np.where(low[..., None, None], told + least[..., None] * np.eye(size.shape[-1]), R)


def nis(innovation: Innovation) -> Array:
    """Return the normalised innovation squared r' S^-1 r, shape (...); directions known exactly do not count."""
    return _whitened(cholesky(innovation.cov)[0], innovation.residual)[0]


@kernel("(m,m),(m)->(),()")
def _whitened(L: Array, residual: Array, squared: Array, log_pivots: Array) -> None:
    """Fill in r' S^-1 r and -log sqrt(det S); directions known exactly do not count."""
    e = np.empty(len(L))
    whiten_vector(L, residual, e)
    squared[0] = log_pivots[0] = 0.0
    for i in range(len(L)):
        squared[0] += e[i] * e[i]
        if L[i, i] != 0.0:
            log_pivots[0] -= math.log(L[i, i])


@cache
def gate_limit(gate: float, m: int) -> float:
    """Return the ``gate`` quantile of chi-square with ``m`` degrees of freedom, the limit of the NIS; inf for 1."""
    from scipy.special import gammaincinv  # slow to import, needed by gates only; scipy.stats is slower still

    return float(2.0 * gammaincinv(0.5 * m, gate))  # the quantile of chi-square


def log_likelihood(innovation: Innovation) -> Array:
    """Return log N(r; 0, S), shape (...), as in 004 (9); directions known exactly do not count."""
    return log_normal(innovation.residual, cholesky(innovation.cov)[0])


def log_normal(residual: Array, L: Array) -> Array:
    """Return log N(r; 0, L L'), shape (...), for residuals r (..., m) and a lower root L (..., m, m)."""
    squared, log_pivots = _whitened(L, residual)
    m = residual.shape[-1]
    return np.asarray(log_pivots - 0.5 * (squared + m * math.log(2.0 * math.pi)))


def inverse(P: Array) -> tuple[Array, Mask | None]:
    """Return P^-1 (..., n, n) and a mask (...) of repaired runs; rows of states known exactly are zero."""
    known = np.diagonal(P, axis1=-2, axis2=-1) == 0.0
    L, repaired = cholesky(P + known[..., None] * np.eye(P.shape[-1]))
    root = np.where(known[..., None, :], 0.0, inverse_lower(L))
    return root.mT @ root, repaired


@kernel("(m,m)->(m,m)")
def inverse_lower(L: Array, inverse: Array) -> None:
    """Return L^-1 of a lower L (..., m, m). A direction known exactly (a zero row) gets zero, hence no gain."""
    inverse[:] = 0.0
    for i in range(len(L)):
        pivot = reciprocal(L[i, i])
        inverse[i, i] = pivot
        for j in range(i):
            total = 0.0
            for k in range(j, i):
                total += L[i, k] * inverse[k, j]
            inverse[i, j] = -pivot * total
