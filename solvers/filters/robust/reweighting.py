"""Robust updates: a fix, and the prior, count less the worse they fit; written once for every influence function.

The update is the regression of u = S_p^-1 (x - x-) on the whitened prior and the whitened fix, # 003,
docs/mathematics/filters.md#robust-updates

    0 = u + e_p,    r = B u + e_m,    r = S_r^-1 (z - z-),    B = S_r^-1 P_zx S_p^-T,

with P- = S_p S_p' and S_r S_r' = Rbar = P_zz - H P- H', H = P_zx P-^-1: R itself for a linear h, R and the part of
h that no line explains for others. Ordinary least squares gives the Kalman update. A robust one weighs e_p and e_m by
weights c of their own size and solves again, until the weights stand still.

Residuals of the prior are those of its lower Cholesky factor, in the order of the states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import choice, keep, number
from solvers.blocks.conditioning import gain, inverse_lower
from solvers.blocks.square_root import cholesky, either, symmetrize
from solvers.types import Gaussian, Moments

FLOOR = 1e-8  #: smallest weight; a fix with no weight above it is skipped
TARGETS = ("both", "meas")


class Residuals(NamedTuple):
    prior: Array  #: (..., n) e_p
    fix: Array  #: (..., m) e_m
    spread: Array  #: (...) trace of the covariance that the posterior of x gives to e_m


Weigh = Callable[[Residuals], tuple[Array, Array]]  #: weights of e_p (..., n) and e_m (..., m)


@dataclass(frozen=True)
class Huber:
    """c = min(1, alpha / |e|): quadratic cost up to alpha standard deviations, linear beyond. Huber (1964)"""

    alpha: float = 1.345  #: 95 % efficient on Gaussian noise

    def __post_init__(self) -> None:
        keep(self, "alpha", number, least=1e-3, infinite=True)

    def __call__(self, e: Array) -> Array:
        size = np.abs(e)
        return np.divide(self.alpha, size, out=np.ones(e.shape), where=~(size <= self.alpha))


@dataclass(frozen=True)
class Correntropy:
    """c = exp(-e^2 / (2 sigma^2)): the maximum correntropy criterion with a Gaussian kernel. Chen et al. (2017)"""

    sigma: float = 3.0  #: in standard deviations

    def __post_init__(self) -> None:
        keep(self, "sigma", number, least=0.5, infinite=True)  # below, good fixes are refused too

    def __call__(self, e: Array) -> Array:
        return np.exp(-0.5 * np.square(e / self.sigma))


@dataclass(frozen=True)
class Each:
    """Each residual weighed by its own size, those of the prior too (``robust="both"``) or of the fix alone ("meas")."""

    influence: Callable[[Array], Array]
    robust: str = "both"

    def __post_init__(self) -> None:
        keep(self, "robust", choice, TARGETS)

    def __call__(self, e: Residuals) -> tuple[Array, Array]:
        prior = self.influence(e.prior) if self.robust == "both" else np.ones(e.prior.shape)
        return prior, self.influence(e.fix)


@dataclass(frozen=True)
class StudentT:
    """One weight for the whole fix, the expected precision of a Student-t noise with ``dof`` degrees of freedom.

    c = (dof + m) / (dof + E |e_m|^2), the expectation over the posterior of x: the variational Bayes update.
    """

    dof: float = 3.0

    def __post_init__(self) -> None:
        keep(self, "dof", number, least=1e-3, infinite=True)

    def __call__(self, e: Residuals) -> tuple[Array, Array]:
        m = e.fix.shape[-1]
        squared = np.square(e.fix).sum(axis=-1) + e.spread
        precision = (1.0 + m / self.dof) / (1.0 + squared / self.dof)
        return np.ones(e.prior.shape), np.repeat(precision[..., None], m, axis=-1)


class Reweighted(NamedTuple):
    gain: Array  #: (..., n, m) K~ of the last weights
    weights: Array  #: (..., m) of the fix
    R: Array  #: (..., m, m) Rbar
    repaired: Mask | None  #: runs whose P- or Rbar was repaired


def reweight(
    prior: Gaussian, predicted: Moments, z: Array, weigh: Weigh, rounds: int, tolerance: float = 1e-6
) -> Reweighted:
    """The gain of the robust update, by fixed-point iteration from the ordinary posterior.

    ``predicted``: the moments of z (..., m) under ``prior``, R included. A run whose weights move by less than
    ``tolerance`` keeps them, whatever its neighbours do; none does more than ``rounds``.
    """
    S, repaired = cholesky(prior.cov)
    A = inverse_lower(S) @ predicted.cross
    R = symmetrize(predicted.cov - A.mT @ A)
    root, repaired_R = cholesky(R)
    whiten = inverse_lower(root)
    A, r = A @ whiten.mT, (whiten @ (z - predicted.mean)[..., None])[..., 0]
    n, c = A.shape[-2], np.ones((*r.shape[:-1], sum(A.shape[-2:])))
    moving = np.ones((*r.shape[:-1], 1), dtype=bool)
    for _ in range(rounds):
        new = np.concatenate(weigh(_solve(A, r, c)[1]), axis=-1)
        new = np.where(moving, np.maximum(new, FLOOR), c)
        moving = np.asarray((np.abs(new - c) > tolerance).any(axis=-1, keepdims=True))
        c = new
        if not moving.any():
            break
    K = S @ _solve(A, r, c)[0] @ whiten
    return Reweighted(K, c[..., n:], R, either(repaired, repaired_R))


def widened(prior: Gaussian, y: Moments, R: Array, residual: Array) -> tuple[Gaussian, Moments]:
    """``prior`` with beta P-, beta >= 1 such that E r' R^-1 r = m + beta tr(R^-1 H P- H') is what r is, and its moments of z.

    ``y``: the moments of h(x), without R. The fading factor of a strong tracking filter, Zhou & Frank (1996).
    """
    root, _ = cholesky(np.broadcast_to(R, y.cov.shape))
    whiten = inverse_lower(root)
    r = (whiten @ residual[..., None])[..., 0]
    explained = np.trace(whiten @ y.cov @ whiten.mT, axis1=-2, axis2=-1)
    excess = np.square(r).sum(axis=-1) - r.shape[-1]
    beta = np.divide(excess, explained, out=np.ones(excess.shape), where=explained > 0.0)
    beta = np.maximum(beta, 1.0)[..., None, None]
    return Gaussian(prior.mean, beta * prior.cov), Moments(y.mean, beta * y.cov + R, beta * y.cross)


def _solve(A: Array, r: Array, c: Array) -> tuple[Array, Residuals]:
    """The gain of u on r under weights c (..., n + m), A = B' (..., n, m), and the residuals that it leaves."""
    prior, fix = np.split(c, [A.shape[-2]], axis=-1)
    cross = A / prior[..., None]
    explained = A.mT @ cross
    cov = explained + (1.0 / fix)[..., None] * np.eye(r.shape[-1])
    K, W, _ = gain(Moments(r, cov, cross))
    u = (K @ r[..., None])[..., 0]
    left = np.trace(explained, axis1=-2, axis2=-1) - np.square(W @ A).sum(axis=(-2, -1))
    return K, Residuals(-u, r - (A.mT @ u[..., None])[..., 0], left)
