"""The update with a fix whose noise may be smaller or larger than told: a mixture over factors of R, collapsed at once.

A regime r multiplies the told R and follows a Markov chain from fix to fix. The told law of a fix adds factors of its own: shares
of contamination, or cells of Student-t. For all factors rho of R together, one eigenvalue problem is enough. With L L' = R,

    L^-1 H P H' L^-T = U diag(a) U',   B = P H' L^-T U,   y = U' L^-1 nu,   t = y / (a + rho),

the update under rho is x + B t, P - B diag(1 / (a + rho)) B', and -2 log N(nu; 0, S) = sum of log(a + rho) + y t, up to what all
share. The collapsed mixture is x + B E[t], P + B (Cov(t) - diag E[1 / (a + rho)]) B'.
Equations: docs/mathematics/filters.md#bank-of-inertial-solutions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.kernels import helper, kernel
from solvers.blocks.conditioning import inverse_lower
from solvers.blocks.square_root import cholesky
from solvers.types import Gaussian, NoiseLaw

STAY = 0.99  #: probability that a regime lasts until the next fix; else one is drawn anew
OTHER = 0.025  #: probability of each regime but that of the told R
SWEEPS = 20  #: most sweeps of Jacobi's method, of which five are usual
STUDENT_LOGS = np.arange(-0.5, 2.75, 0.5)  #: log10 s^2 in the middle of the cells of Student-t


class Update(NamedTuple):
    """The result of a fix."""

    x: Gaussian  #: (..., n), (..., n, n)
    log_likelihood: Array  #: (...), of the fix, up to what all hypotheses share
    regimes: Array  #: (..., C), probabilities of the regimes after the fix


class Cells(NamedTuple):
    """A distribution of the factor s^2 of R that the told law of a fix has."""

    factors: Array  #: (F,)
    weights: Array  #: (F,)


def stationary(count: int, told: int) -> Array:
    """Return probabilities (count,) with that of the told R at index ``told``."""
    p = np.full(count, OTHER)
    p[told] = 1.0 - OTHER * (count - 1)
    return p


def ahead(p: Array, rest: Array) -> Array:
    """Return the probabilities (..., C) of the regimes at the next fix, for those at the last fix, p (..., C)."""
    moved: Array = STAY * p + (1.0 - STAY) * rest
    return moved


def cells(law: NoiseLaw | None) -> Cells:
    """Return the factors of R under the told law: one, two for contamination, seven for Student-t."""
    if law is None:
        return Cells(np.ones(1), np.ones(1))
    if law.dof:
        from scipy.special import gammaincc  # slow to import, needed for Student-t only

        edges = 10.0 ** (0.5 * (STUDENT_LOGS[1:] + STUDENT_LOGS[:-1]))
        below = gammaincc(0.5 * law.dof, 0.5 * law.dof / edges)  # probability that s^2 = dof / chi^2 is below an edge
        return Cells(10.0**STUDENT_LOGS, np.diff(np.concatenate([[0.0], below, [1.0]])))
    return Cells(np.array([1.0, law.factor]), np.array([1.0 - law.share, law.share]))


def update(x: Gaussian, nu: Array, H: Array, R: Array, p: Array, factors: Array, told: Cells) -> Update:
    """Return the state after a fix under all regimes together.

    Args:
        x: mean (..., n) and covariance (..., n, n) before it.
        nu: innovation z - H x, (..., m).
        H: what the fix shows, (..., m, n) or what broadcasts to it.
        R: its told covariance, (..., m, m) or what broadcasts to it.
        p: probabilities (..., C) of the regimes at this fix.
        factors: factors (C,) of R in the regimes.
        told: factors of R under the told law.
    """
    whiten = inverse_lower(cholesky(R)[0])
    mean, cov, log_likelihood, after = _update(x.mean, x.cov, nu, H, whiten, p, factors, told.factors, told.weights)
    return Update(Gaussian(mean, cov), log_likelihood, after)


@kernel("(n),(n,n),(m),(m,n),(m,m),(c),(c),(f),(f)->(n),(n,n),(),(c)")
def _update(
    x: Array, P: Array, nu: Array, H: Array, whiten: Array, p: Array, factors: Array, told: Array, shares: Array,
    mean: Array, cov: Array, log_likelihood: Array, after: Array,
) -> None:  # fmt: skip
    n, m = len(x), len(nu)
    if _lost(x, P, nu, H, p):
        mean[:], cov[:], log_likelihood[:], after[:] = math.nan, math.nan, math.nan, math.nan
        return
    white, PH, a, U, B = np.empty((m, n)), np.empty((n, m)), np.empty((m, m)), np.empty((m, m)), np.empty((n, m))
    y, t = np.empty(m), np.empty((len(p) * len(told), m))
    inverse, w = np.empty((len(p) * len(told), m)), np.empty(len(p) * len(told))
    for i in range(m):  # L^-1 H, and y = L^-1 nu
        y[i] = 0.0
        for j in range(n):
            white[i, j] = 0.0
        for k in range(i + 1):
            y[i] += whiten[i, k] * nu[k]
            for j in range(n):
                white[i, j] += whiten[i, k] * H[k, j]
    for j in range(n):
        for i in range(m):
            PH[j, i] = 0.0
            for k in range(n):
                PH[j, i] += P[j, k] * white[i, k]
    for i in range(m):
        for j in range(m):
            a[i, j] = 0.0
            U[i, j] = 1.0 if i == j else 0.0
            for k in range(n):
                a[i, j] += white[i, k] * PH[k, j]
    diagonalize(a, U)
    for j in range(n):
        for i in range(m):
            B[j, i] = 0.0
            for k in range(m):
                B[j, i] += PH[j, k] * U[k, i]
    for i in range(m):  # y in the axes of U; t's first row lends its place
        t[0, i] = 0.0
        for k in range(m):
            t[0, i] += U[k, i] * y[k]
    for i in range(m):
        y[i] = t[0, i]
    top = -math.inf
    for c in range(len(p)):
        for f in range(len(told)):
            q = c * len(told) + f
            prior = p[c] * shares[f]
            log = math.log(prior) if prior > 0.0 else -math.inf
            for i in range(m):
                S = max(a[i, i], 0.0) + factors[c] * told[f]
                inverse[q, i] = 1.0 / S
                t[q, i] = y[i] / S
                log -= 0.5 * (math.log(abs(S)) + y[i] * t[q, i])
            w[q] = log
            top = max(top, log)
    total = 0.0
    for q in range(len(w)):
        w[q] = math.exp(w[q] - top)
        total += w[q]
    log_likelihood[0] = top + math.log(total)
    for c in range(len(p)):
        after[c] = 0.0
        for f in range(len(told)):
            w[c * len(told) + f] /= total
            after[c] += w[c * len(told) + f]
    expected = y  # E[t] takes the place of y
    for i in range(m):
        expected[i] = 0.0
        for q in range(len(w)):
            expected[i] += w[q] * t[q, i]
    for i in range(m):  # a becomes Cov(t) - diag E[1 / (a + rho)]
        for j in range(m):
            a[i, j] = 0.0
            for q in range(len(w)):
                a[i, j] += w[q] * (t[q, i] - expected[i]) * (t[q, j] - expected[j])
        for q in range(len(w)):
            a[i, i] -= w[q] * inverse[q, i]
    for j in range(n):
        mean[j] = x[j]
        for i in range(m):
            mean[j] += B[j, i] * expected[i]
            PH[j, i] = 0.0
            for k in range(m):
                PH[j, i] += B[j, k] * a[k, i]
    for j in range(n):
        for k in range(j + 1):
            change = P[j, k]
            for i in range(m):
                change += PH[j, i] * B[k, i]
            cov[j, k] = cov[k, j] = change


@helper
def _lost(x: Array, P: Array, nu: Array, H: Array, p: Array) -> bool:
    """Return whether any number is NaN."""
    total = 0.0
    for i in range(len(x)):
        total += x[i]
        for j in range(len(x)):
            total += P[i, j]
        for j in range(len(nu)):
            total += H[j, i]
    for j in range(len(nu)):
        total += nu[j]
    for c in range(len(p)):
        total += p[c]
    return total != total


@helper
def diagonalize(a: Array, U: Array) -> None:
    """Turn a symmetric a (m, m) into a diagonal matrix in place, and U (m, m) into U V with the eigenvectors V: Jacobi's method."""
    m = len(a)
    for _ in range(SWEEPS):
        off, size = 0.0, 0.0
        for i in range(m):
            size += a[i, i] * a[i, i]
            for j in range(i):
                off += a[i, j] * a[i, j]
        if not off > 1e-32 * size:
            return
        for i in range(m - 1):
            for j in range(i + 1, m):
                if abs(a[i, j]) <= 1e-18 * (abs(a[i, i]) + abs(a[j, j])):
                    continue
                theta = 0.5 * (a[j, j] - a[i, i]) / a[i, j]
                tangent = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(tangent * tangent + 1.0)
                s = tangent * c
                for k in range(m):
                    a[k, i], a[k, j] = c * a[k, i] - s * a[k, j], s * a[k, i] + c * a[k, j]
                for k in range(m):
                    a[i, k], a[j, k] = c * a[i, k] - s * a[j, k], s * a[i, k] + c * a[j, k]
                    U[k, i], U[k, j] = c * U[k, i] - s * U[k, j], s * U[k, i] + c * U[k, j]
