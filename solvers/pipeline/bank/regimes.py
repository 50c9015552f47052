"""The update with a fix whose noise may be smaller or larger than told: a mixture over factors of R, collapsed at once.

A regime r multiplies the told R and follows a Markov chain from fix to fix. The told law of a fix adds factors of its own: shares
of contamination, or cells of Student-t. For all factors rho of R together, one eigenvalue problem is enough. With L L' = R,

    L^-1 H P H' L^-T = U diag(a) U',   B = P H' L^-T U,   y = U' L^-1 nu,   t = y / (a + rho),

the update under rho is x + B t, P - B diag(1 / (a + rho)) B', and -2 log N(nu; 0, S) = sum of log(a + rho) + y t, up to what all
share. The collapsed mixture is x + B E[t], P + B (Cov(t) - diag E[1 / (a + rho)]) B'.
Equations: docs/mathematics/filters.md#bank-of-inertial-solutions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from solvers.blocks.conditioning import inverse_lower
from solvers.blocks.mixtures import normalise
from solvers.blocks.square_root import cholesky, symmetrize
from solvers.types import Gaussian, NoiseLaw

STAY = 0.95  #: probability that a regime lasts until the next fix; else one is drawn anew
OTHER = 0.025  #: probability of each regime but that of the told R
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
        R: its told covariance, (m, m).
        p: probabilities (..., C) of the regimes at this fix.
        factors: factors (C,) of R in the regimes.
        told: factors of R under the told law.
    """
    whiten = inverse_lower(cholesky(R)[0])
    H = whiten @ H
    PH = x.cov @ H.mT
    a, U = np.linalg.eigh(symmetrize(H @ PH))
    B = PH @ U
    y = (U.mT @ (whiten @ nu[..., None]))[..., 0]
    rho = np.multiply.outer(factors, told.factors).ravel()
    S = np.maximum(a, 0.0)[..., None, :] + rho[:, None]  # (..., C F, m)
    t = y[..., None, :] / S
    log_likelihood = -0.5 * (np.log(S) + y[..., None, :] * t).sum(axis=-1)
    prior = (p[..., None] * told.weights).reshape(*p.shape[:-1], -1)
    logs = np.log(prior, out=np.full(prior.shape, -np.inf), where=prior > 0.0)
    w, total = normalise(logs + log_likelihood)
    w = np.where(prior > 0.0, w, 0.0)
    mean = (w[..., None, :] @ t)[..., 0, :]
    apart = t - mean[..., None, :]
    known = (w[..., None, :] @ (1.0 / S))[..., 0, :]
    change = (apart * w[..., None]).mT @ apart - known[..., None] * np.eye(len(R))
    after = Gaussian(x.mean + (B @ mean[..., None])[..., 0], symmetrize(x.cov + B @ change @ B.mT))
    return Update(after, total, w.reshape(*p.shape, -1).sum(axis=-1))
