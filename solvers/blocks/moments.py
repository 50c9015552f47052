"""Mean and covariance of y = g(x) for Gaussian x: the one place where sigma points are drawn and tangents are taken.

Every rule maps ``Linear`` functions exactly. Any other function is left to the rule: ``SigmaPoints`` sends points through
it, ``Linearized`` takes its Jacobian. Equations: docs/mathematics/filters.md#sigma-points and #extended-kalman-filters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import choice, keep
from solvers.blocks.sigma_rules import PointRule, Points, points
from solvers.blocks.square_root import ROOTS, symmetrize
from solvers.types import Function, Gaussian, Linear, Moments

STEP = 1e-4  #: step of the numerical Jacobian, in standard deviations
RELATIVE_STEP = float(np.finfo(float).eps) ** (1 / 3)  #: smallest step of the numerical Jacobian, relative to the state


class MomentRule(Protocol):
    """How a Gaussian passes through a function that is not ``Linear``; see the functions of the same names."""

    def transform(self, g: Function, x: Gaussian) -> tuple[Gaussian, Mask | None]: ...
    def moments(self, g: Function, x: Gaussian) -> tuple[Moments, Mask | None]: ...


def transform(g: Function, x: Gaussian, rule: MomentRule) -> tuple[Gaussian, Mask | None]:
    """Return mean (..., m) and covariance (..., m, m) of g(x), and a mask (...) of runs whose covariance was repaired."""
    if isinstance(g, Linear):
        y = linear_moments(g, x)
        return Gaussian(y.mean, y.cov), None
    return rule.transform(g, x)


def moments(g: Function, x: Gaussian, rule: MomentRule) -> tuple[Moments, Mask | None]:
    """Return what ``transform`` does, and the cross covariance (..., n, m) of x and g(x) with it."""
    return (linear_moments(g, x), None) if isinstance(g, Linear) else rule.moments(g, x)


def linear_moments(g: Linear, x: Gaussian) -> Moments:
    """Return the exact moments of an affine map."""
    cross = _times_transpose(x.cov, g.matrix)
    return Moments(g(x.mean), symmetrize(_times_transpose(cross.mT, g.matrix)), cross)


def _times_transpose(a: Array, matrix: Array) -> Array:
    """Return a matrix'. If all runs share the matrix this is one product, which is several times faster."""
    if matrix.ndim > 2:
        return a @ matrix.mT
    return (a.reshape(-1, a.shape[-1]) @ matrix.T).reshape(*a.shape[:-1], len(matrix))


@dataclass(frozen=True)
class SigmaPoints:
    """Moments from the points chi_i = x + S xi_i and their images g(chi_i): 000 (3.3.62-66), (3.3.83-87).

    Raises:
        ValueError: an unknown root.
    """

    rule: PointRule
    root: str = "cholesky"  #: how the root S of the covariance is taken: "cholesky" or "svd"

    def __post_init__(self) -> None:
        keep(self, "root", choice, ROOTS)

    def transform(self, g: Function, x: Gaussian) -> tuple[Gaussian, Mask | None]:
        p = points(self.rule, x.mean.shape[-1])
        S, repaired = ROOTS[self.root](x.cov)
        mean, cov, _ = _weigh(g(draw(x.mean, S, p)), p)
        return Gaussian(mean, cov), repaired

    def moments(self, g: Function, x: Gaussian) -> tuple[Moments, Mask | None]:
        p = points(self.rule, x.mean.shape[-1])
        S, repaired = ROOTS[self.root](x.cov)
        deviation = p.xi @ S.mT
        mean, cov, spread = _weigh(g(deviation + x.mean[..., None, :]), p)
        outer = deviation[..., 1:, :] if p.centre else deviation
        return Moments(mean, cov, _product(outer, spread, p)), repaired


def draw(mean: Array, S: Array, p: Points) -> Array:
    """Return the points mean + S xi, shape (..., points, n)."""
    x = mean[..., None, :]
    if p.radius is None:
        chi = p.xi @ S.mT
        chi += x  # in place: a second array of this size costs more than the sum
        return chi
    n, first = mean.shape[-1], int(p.centre)
    step = p.radius * S.mT
    chi = np.empty((*mean.shape[:-1], len(p.xi), n))
    if p.centre:
        chi[..., 0, :] = mean
    np.add(x, step, out=chi[..., first : first + n, :])
    np.subtract(x, step, out=chi[..., first + n :, :])
    return chi


def weigh(y: Array, p: Points) -> Gaussian:
    """Return mean (..., m) and covariance (..., m, m) of images y (..., points, m)."""
    mean, cov, _ = _weigh(y, p)
    return Gaussian(mean, cov)


def weigh_pair(x: Array, y: Array, p: Points) -> Moments:
    """Return the moments of y (..., points, m) and its cross covariance with x (..., points, n), for the same points."""
    n = x.shape[-1]
    mean, cov, _ = _weigh(np.concatenate([x, y], axis=-1), p)
    return Moments(mean[..., n:], cov[..., n:, n:], cov[..., :n, n:])


def _weigh(y: Array, p: Points) -> tuple[Array, Array, Array]:
    """Return mean (..., m), covariance (..., m, m) and the outer images (..., points, m) minus their average."""
    if not p.centre:
        mean = p.wm @ y
        spread = y - mean[..., None, :]
        return mean, _product(spread, spread, p), spread
    y0 = y[..., 0, :]
    spread = y[..., 1:, :] - y0[..., None, :]
    e = p.wm[1:] @ spread
    spread -= (e / p.total)[..., None, :]
    cov = _product(spread, spread, p)
    if p.pull:
        cov += p.pull * (e[..., :, None] * e[..., None, :])
    return y0 + e, cov, spread


def _product(a: Array, b: Array, p: Points) -> Array:
    """Return the sum of w a b' over the outer points, shape (..., a, b)."""
    if p.equal is not None:
        product = a.mT @ b  # exactly symmetric for a is b
        product *= p.equal
        return product
    product = (a * p.wc[1 if p.centre else 0 :, None]).mT @ b
    return symmetrize(product) if a is b else product


@dataclass(frozen=True)
class Linearized:
    """Moments of the tangent of g, taken at the mean or, whatever the mean is, at the origin: 000 (3.3.1-3)."""

    at: Literal["mean", "origin"] = "mean"

    def transform(self, g: Function, x: Gaussian) -> tuple[Gaussian, Mask | None]:
        y, repaired = self.moments(g, x)
        return Gaussian(y.mean, y.cov), repaired

    def moments(self, g: Function, x: Gaussian) -> tuple[Moments, Mask | None]:
        point = x.mean if self.at == "mean" else np.zeros_like(x.mean)
        return tangent_moments(g, x, point)[0], None


def tangent_moments(g: Function, x: Gaussian, at: Array) -> tuple[Moments, Array]:
    """Return the moments under the tangent of g at ``at`` (..., n), and the tangent's matrix (..., m, n)."""
    value, J = tangent(g, at, standard_deviations(x.cov))
    y = linear_moments(Linear(J), x._replace(mean=x.mean - at))
    return y._replace(mean=value + y.mean), J


def standard_deviations(P: Array) -> Array:
    """Return the standard deviations (..., n) of a covariance (..., n, n)."""
    return np.sqrt(np.maximum(np.diagonal(P, axis1=-2, axis2=-1), 0.0))


def tangent(g: Function, x: Array, scale: Array) -> tuple[Array, Array]:
    """Return value (..., m) and Jacobian (..., m, n) of g at x (..., n).

    The Jacobian is ``g.jacobian(x)`` if g has one. Otherwise it comes from central differences, with all 2n + 1 points in one
    call. Steps are ``STEP`` times the standard deviations ``scale`` (..., n), but no smaller than rounding allows.
    """
    analytic = getattr(g, "jacobian", None)
    if isinstance(g, Linear):
        return g(x), g.matrix
    if analytic is not None:
        return g(x), analytic(x)
    n = x.shape[-1]
    step = np.maximum(STEP * scale, RELATIVE_STEP * np.abs(x))
    step[step == 0.0] = RELATIVE_STEP
    grid = np.empty((*x.shape[:-1], 2 * n + 1, n))
    grid[...] = x[..., None, :]
    i = np.arange(n)
    grid[..., i, i] += step
    grid[..., n + i, i] -= step
    y = g(grid)
    J = (y[..., :n, :] - y[..., n : 2 * n, :]) * (0.5 / step)[..., None]
    return y[..., 2 * n, :], J.mT
