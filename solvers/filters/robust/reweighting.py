"""Robust updates: the worse a fix or the prior fits, the less it counts; written once for every influence function.

The update is the regression of u = S_p^-1 (x - x-) on the whitened prior and the whitened fix,

    0 = u + e_p,    r = B u + e_m,    r = S_r^-1 (z - z-),    B = S_r^-1 P_zx S_p^-T,

with P- = S_p S_p' and S_r S_r' = Rbar = P_zz - H P- H', H = P_zx P-^-1. For a linear h, Rbar is R. Otherwise it also holds the
part of h that no linear function explains. Ordinary least squares gives the Kalman update. A robust update weighs e_p and e_m
by weights c that depend on their size, and solves again until the weights stand still.

The residuals of the prior are whitened by its lower Cholesky factor, in the order of the states.
Source: 003, reconstructed; docs/mathematics/filters.md#robust-updates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import choice, keep, number
from solvers.blocks.conditioning import gain, inverse_lower, noise_about
from solvers.blocks.square_root import cholesky, either, symmetrize, without_known
from solvers.types import Gaussian, Moments

FLOOR = 1e-8  #: smallest weight; a fix with no weight above it is skipped
FAR = 1e3  #: innovation, in standard deviations, beyond which the iteration starts from the prior
SINGULAR = 1e-5  #: least deviation of a noise given that of the components before it, relative to its own
TARGETS = ("both", "meas")


class Residuals(NamedTuple):
    """Whitened residuals of prior and fix at one round of the iteration."""

    prior: Array  #: (..., n), e_p
    fix: Array  #: (..., m), e_m
    spread: Array  #: (...), trace of the covariance of e_m under the posterior of x


Weigh = Callable[[Residuals], tuple[Array, Array]]  #: from residuals to the weights of e_p (..., n) and e_m (..., m)


@dataclass(frozen=True)
class Huber:
    """Huber's weights (1964), c = min(1, alpha / |e|): the cost is quadratic up to alpha standard deviations, then linear."""

    alpha: float = 1.345  #: in standard deviations; the default is 95 % efficient for Gaussian noise

    def __post_init__(self) -> None:
        keep(self, "alpha", number, least=1e-3, infinite=True)

    def __call__(self, e: Array) -> Array:
        size = np.abs(e)
        return np.divide(self.alpha, size, out=np.ones(e.shape), where=~(size <= self.alpha))


@dataclass(frozen=True)
class Correntropy:
    """The weights of maximum correntropy with a Gaussian kernel, c = exp(-e^2 / (2 sigma^2)): Chen et al. (2017)."""

    sigma: float = 3.0  #: width of the kernel, in standard deviations

    def __post_init__(self) -> None:
        keep(self, "sigma", number, least=0.5, infinite=True)  # a narrower kernel refuses good fixes too

    def __call__(self, e: Array) -> Array:
        return np.exp(-0.5 * np.square(e / self.sigma))


@dataclass(frozen=True)
class Each:
    """A weight for each residual by its own size."""

    influence: Callable[[Array], Array]  #: from residuals to weights of the same shape
    robust: str = "both"  #: what is weighed: "both", which are prior and fix, or "meas", the fix alone

    def __post_init__(self) -> None:
        keep(self, "robust", choice, TARGETS)

    def __call__(self, e: Residuals) -> tuple[Array, Array]:
        prior = self.influence(e.prior) if self.robust == "both" else np.ones(e.prior.shape)
        return prior, self.influence(e.fix)


@dataclass(frozen=True)
class StudentT:
    """One weight for the whole fix: the expected precision of a Student-t noise.

    It is c = (dof + m) / (dof + E |e_m|^2) with the expectation over the posterior of x, the variational Bayes update.
    """

    dof: float = 3.0  #: degrees of freedom

    def __post_init__(self) -> None:
        keep(self, "dof", number, least=1e-3, infinite=True)

    def __call__(self, e: Residuals) -> tuple[Array, Array]:
        m = e.fix.shape[-1]
        squared = np.square(e.fix).sum(axis=-1) + e.spread
        precision = (1.0 + m / self.dof) / (1.0 + squared / self.dof)
        return np.ones(e.prior.shape), np.repeat(precision[..., None], m, axis=-1)


class Reweighted(NamedTuple):
    """The result of a robust update."""

    gain: Array  #: (..., n, m), gain with the last weights
    weights: Array  #: (..., m), weights of the components of the fix
    R: Array  #: (..., m, m), Rbar
    repaired: Mask | None  #: (...), runs whose P- or Rbar was repaired; None: no run


def reweight(
    prior: Gaussian,
    predicted: Moments,
    z: Array,
    weigh: Weigh,
    rounds: int,
    tolerance: float = 1e-6,
    told: Array | None = None,
) -> Reweighted:
    """Return the gain of the robust update, by fixed-point iteration from the ordinary posterior or, far off, the prior.

    ``predicted`` holds the moments of z (..., m) under ``prior``, R included. A run whose weights change by less than
    ``tolerance`` keeps them, whatever the other runs do. No run takes more than ``rounds`` rounds. ``told`` (..., m, m) is the R
    for runs in which rounding hides it.
    """
    S, repaired = cholesky(prior.cov)
    A = inverse_lower(S) @ predicted.cross
    R = symmetrize(predicted.cov - A.mT @ A)
    if told is not None:
        R = noise_about(R, predicted.cov, told)
    root, repaired_R = _noise_root(R)
    whiten = inverse_lower(root)
    A, r = A @ whiten.mT, (whiten @ (z - predicted.mean)[..., None])[..., 0]
    n, c = A.shape[-2], np.ones((*r.shape[:-1], sum(A.shape[-2:])))
    explained = np.square(A).sum(axis=-2)
    far = np.asarray((np.abs(r) > FAR * np.sqrt(1.0 + explained)).any(axis=-1, keepdims=True))
    if far.any():  # from the ordinary posterior the rounds would not get back in time
        start = np.concatenate(weigh(Residuals(np.zeros(A.shape[:-1]), r, explained.sum(axis=-1))), axis=-1)
        c = np.where(far, np.maximum(start, FLOOR), c)
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
    """Widen P- to beta P- so that it explains the ``residual`` r (..., m), and return it with its moments of z.

    The factor beta >= 1 makes the expectation of r' R^-1 r, m + beta tr(R^-1 H P- H'), equal to its value. ``y`` holds the moments
    of h(x) without R. This is the fading factor of a strong tracking filter, Zhou & Frank (1996).
    """
    root, _ = _noise_root(np.broadcast_to(R, y.cov.shape))
    whiten = inverse_lower(root)
    r = (whiten @ residual[..., None])[..., 0]
    explained = np.trace(whiten @ y.cov @ whiten.mT, axis1=-2, axis2=-1)
    excess = np.square(r).sum(axis=-1) - r.shape[-1]
    beta = np.divide(excess, explained, out=np.ones(excess.shape), where=explained > 0.0)
    beta = np.maximum(beta, 1.0)[..., None, None]
    return Gaussian(prior.mean, beta * prior.cov), Moments(y.mean, beta * y.cov + R, beta * y.cross)


def _noise_root(R: Array) -> tuple[Array, Mask | None]:
    """Return the lower root of a noise without components that follow from others, and a mask (...) of the runs this changes."""
    root, repaired = cholesky(R)
    root, dropped = without_known(root, SINGULAR)
    return root, either(repaired, dropped)


def _solve(A: Array, r: Array, c: Array) -> tuple[Array, Residuals]:
    """Return the gain of u on r under weights c (..., n + m), with A = B' (..., n, m), and the residuals that it leaves."""
    prior, fix = np.split(c, [A.shape[-2]], axis=-1)
    cross = A / prior[..., None]
    explained = A.mT @ cross
    cov = explained + (1.0 / fix)[..., None] * np.eye(r.shape[-1])
    K, W, _ = gain(Moments(r, cov, cross))
    u = (K @ r[..., None])[..., 0]
    left = np.trace(explained, axis1=-2, axis2=-1) - np.square(W @ A).sum(axis=(-2, -1))
    return K, Residuals(-u, r - (A.mT @ u[..., None])[..., 0], left)
