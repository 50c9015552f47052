"""Mean and covariance of y = g(x) for Gaussian x: the one place where sigma points are drawn and tangents are taken.

Every rule maps ``Linear`` functions exactly. Any other function is left to the rule: ``SigmaPoints`` sends points through
it, ``Linearized`` takes its Jacobian. Equations: docs/mathematics/filters.md#sigma-points and #extended-kalman-filters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Literal, NamedTuple, Protocol

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import choice, keep
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import inner
from solvers.blocks.sigma_rules import PointRule, Points, points
from solvers.blocks.square_root import ROOTS, symmetrize
from solvers.types import Function, Gaussian, Linear, Moments

STEP = 1e-4  #: step of the numerical Jacobian, in standard deviations
RELATIVE_STEP = float(np.finfo(float).eps) ** (1 / 3)  #: smallest step of the numerical Jacobian, relative to the state


class MomentRule(Protocol):
    """How a Gaussian passes through a function that is not ``Linear``; see the functions of the same names."""

    def transform(self, g: Function, x: Gaussian) -> tuple[Gaussian, Mask | None]: ...
    def moments(self, g: Function, x: Gaussian) -> tuple[Moments, Mask | None]: ...


class Affine(NamedTuple):
    """An affine map in the place of a function, and its value at the mean of a Gaussian."""

    map: Linear
    value: Array | None = None  #: (..., m); None: not known


def affine(g: Function, mean: Array, cov: Array | None, rule: MomentRule) -> Affine | None:
    """Return the affine map that stands for g: g itself, or its tangent. None: the rule has none.

    ``mean`` (..., n) and ``cov`` (..., n, n) are those of x; without ``cov`` only a g with its own Jacobian has a tangent.
    """
    if isinstance(g, Linear):
        return Affine(g)
    return rule.tangent(g, mean, cov) if isinstance(rule, Linearized) else None


def has_tangent(g: Function) -> bool:
    """Return whether g is ``Linear`` or has its own Jacobian."""
    if isinstance(g, Linear) or getattr(g, "value_and_jacobian", None) is not None:
        return True
    return getattr(g, "jacobian", None) is not None


def transform(g: Function, x: Gaussian, rule: MomentRule, noise: Array | None = None) -> tuple[Gaussian, Mask | None]:
    """Return mean (..., m) and covariance (..., m, m) of g(x) + w, and a mask (...) of runs whose covariance was repaired.

    ``noise`` (..., m, m) is the covariance of w; None: there is no w.
    """
    line = affine(g, *x, rule)
    if line is not None:
        mean, cov, _ = linear_moments(line.map, x, noise, line.value)
        return Gaussian(mean, cov), None
    y, repaired = rule.transform(g, x)
    return y if noise is None else Gaussian(y.mean, y.cov + noise), repaired


def moments(g: Function, x: Gaussian, rule: MomentRule) -> tuple[Moments, Mask | None]:
    """Return mean and covariance of g(x) as ``transform`` does, and the cross covariance (..., n, m) of x and g(x) with them."""
    line = affine(g, *x, rule)
    return rule.moments(g, x) if line is None else (linear_moments(line.map, x, None, line.value), None)


def linear_moments(g: Linear, x: Gaussian, noise: Array | None = None, mean: Array | None = None) -> Moments:
    """Return the exact moments of an affine map, with the covariance ``noise`` (..., m, m) added.

    ``mean`` (..., m) is that of the map, if it is known.
    """
    F, offset = g
    if F.shape[-2] < F.shape[-1]:
        seen, cov, cross = _seen(F, x.mean, x.cov)
        cov = cov if noise is None else cov + noise
        mean = mean if mean is not None else seen if offset is None else seen + offset
        return Moments(mean, cov, cross)
    mean, cov, cross = products(Affine(g, mean), x)
    return Moments(mean, symmetrize(cov) if noise is None else _grown(cov, noise), cross)


def correlated_moments(H: Array, x: Gaussian, R: Array, M: Array) -> Moments:
    """Return the moments of z = H x + v, for noise v of covariance R (..., m, m) that has covariance M (..., n, m) with x.

    Such is a reading whose noise drives the prediction too.
    """
    cross, HM = x.cov @ H.mT, H @ M
    S = symmetrize(H @ cross) + HM + HM.mT + R
    return Moments(np.matmul(H, x.mean[..., None])[..., 0], S, cross + M)


def products(g: Affine, x: Gaussian) -> tuple[Array, Array, Array]:
    """Return mean (..., m), covariance (..., m, m) and cross covariance (..., n, m) of an affine map of many rows.

    The covariance is symmetric but for rounding. Full matrices are three times as fast in BLAS as in a kernel.
    """
    (F, offset), mean = g
    cross = x.cov @ F.mT
    if mean is None:
        mean = np.matmul(F, x.mean[..., None])[..., 0]
        mean = mean if offset is None else mean + offset
    return mean, F @ cross, cross


@helper
def look(H: Array, x: Array, P: Array, mean: Array, cov: Array, cross: Array) -> None:
    """Fill in H x, H P H' and P H' for a few rows H; zeros are left out, since a row often has a single state."""
    m, n = H.shape
    for j in range(m):
        mean[j] = 0.0
        for i in range(n):
            cross[i, j] = 0.0
        for k in range(n):
            h = H[j, k]
            if h != 0.0:
                mean[j] += h * x[k]
                for i in range(n):
                    cross[i, j] += P[i, k] * h
    for i in range(m):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                if H[i, k] != 0.0:
                    total += H[i, k] * cross[k, j]
            cov[i, j] = cov[j, i] = total


@kernel("(m,n),(n),(n,n)->(m),(m,m),(n,m)")
def _seen(H: Array, x: Array, P: Array, mean: Array, cov: Array, cross: Array) -> None:
    look(H, x, P, mean, cov, cross)


@kernel("(n,n),(n,n)->(n,n)")
def _grown(P: Array, Q: Array, out: Array) -> None:
    grow(P, Q, out)


@helper
def grow(P: Array, Q: Array, out: Array) -> None:
    """Fill in (P + P') / 2 + Q."""
    for i in range(len(P)):
        for j in range(len(P)):
            out[i, j] = 0.5 * (P[i, j] + P[j, i]) + Q[i, j]


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
        return weigh(g(draw(x.mean, S, p)), p), repaired

    def moments(self, g: Function, x: Gaussian) -> tuple[Moments, Mask | None]:
        p = points(self.rule, x.mean.shape[-1])
        S, repaired = ROOTS[self.root](x.cov)
        deviation = draw(np.zeros_like(x.mean), S, p)
        return weigh_pair(deviation, g(deviation + x.mean[..., None, :]), p), repaired


def draw(mean: Array, S: Array, p: Points) -> Array:
    """Return the points mean + S xi, shape (..., points, n)."""
    if p.radius is None:
        chi = p.xi @ S.mT
        chi += mean[..., None, :]  # in place: a second array of this size costs more than the sum
        return chi
    chi = _draw(mean, S, p.xi, p.radius)
    return chi


@kernel("(n),(n,n),(p,n),()->(p,n)")
def _draw(mean: Array, S: Array, xi: Array, radius: float, chi: Array) -> None:
    """Fill in a centre, if there is a point more, and pairs at the radius on the axes S; ``xi`` tells the number of points."""
    n = len(mean)
    first = len(xi) - 2 * n
    for i in range(n):
        if first:
            chi[0, i] = mean[i]
        for j in range(n):
            step = radius * S[i, j]
            chi[first + j, i] = mean[i] + step
            chi[first + n + j, i] = mean[i] - step


def weigh(y: Array, p: Points) -> Gaussian:
    """Return mean (..., m) and covariance (..., m, m) of images y (..., points, m)."""
    return Gaussian(*_weigh(y, p.wm, p.wc, p.centre, p.total, p.pull))


def weigh_pair(x: Array, y: Array, p: Points) -> Moments:
    """Return the moments of y (..., points, m) and its cross covariance with x (..., points, n), for the same points."""
    n = x.shape[-1]
    mean, cov = weigh(np.concatenate([x, y], axis=-1), p)
    return Moments(mean[..., n:], cov[..., n:, n:], cov[..., :n, n:])


@kernel("(p,m),(p),(p),(),(),()->(m),(m,m)", "ddd?dddd")
def _weigh(y: Array, wm: Array, wc: Array, centre: bool, total: float, pull: float, mean: Array, cov: Array) -> None:
    """Fill in the moments of weighted points, as the docstring of ``Points`` has them."""
    points, m = y.shape
    first = 1 if centre else 0
    outer = points - first
    rows = np.empty((m + 1, outer))
    spread, weighted = rows[:m], rows[m]
    for i in range(outer):
        weighted[i] = wm[first + i]
        for j in range(m):
            spread[j, i] = y[first + i, j] - (y[0, j] if centre else 0.0)
    for j in range(m):
        e = inner(spread[j], weighted, outer)
        mean[j] = e  # without the centre
        shift = e / total if centre else e
        for i in range(outer):
            spread[j, i] -= shift
    for j in range(m):
        for i in range(outer):
            weighted[i] = wc[first + i] * spread[j, i]
        for k in range(j + 1):
            product = inner(spread[k], weighted, outer)
            cov[j, k] = cov[k, j] = product + (pull * mean[j] * mean[k] if centre else 0.0)
    if centre:
        for j in range(m):
            mean[j] += y[0, j]


@dataclass(frozen=True)
class Linearized:
    """Moments of the tangent of g, taken at the mean or, whatever the mean is, at the origin: 000 (3.3.1-3)."""

    at: Literal["mean", "origin"] = "mean"

    def tangent(self, g: Function, mean: Array, cov: Array | None) -> Affine | None:
        """Return the tangent of g, with its value if it is taken at the mean; see :func:`affine`."""
        if cov is None and not has_tangent(g):
            return None
        if self.at == "mean":
            value, J = _tangent_at(g, mean, cov)
            return Affine(Linear(J), value)
        value, J = _tangent_at(g, np.zeros_like(mean), cov)
        return Affine(Linear(J, value))

    def transform(self, g: Function, x: Gaussian) -> tuple[Gaussian, Mask | None]:
        return transform(g, x, self)

    def moments(self, g: Function, x: Gaussian) -> tuple[Moments, Mask | None]:
        return moments(g, x, self)


def tangent_moments(g: Function, x: Gaussian, at: Array) -> tuple[Moments, Array]:
    """Return the moments under the tangent of g at ``at`` (..., n), and the tangent's matrix (..., m, n)."""
    value, J = _tangent_at(g, at, x.cov)
    if at is x.mean:
        return linear_moments(Linear(J), x, None, value), J
    return linear_moments(Linear(J, value), Gaussian(x.mean - at, x.cov)), J


def _tangent_at(g: Function, at: Array, cov: Array | None) -> tuple[Array, Array]:
    """Return value (..., m) and Jacobian (..., m, n) of g, with differences in units of the covariance (..., n, n) if needed."""
    known = _known_tangent(g, at)
    if known is not None:
        return known
    assert cov is not None, "a g without its own Jacobian needs it"
    return _differences(g, *_stencil_of(at, cov, _signs(at.shape[-1])))


@kernel("(n,n)->(n)")
def standard_deviations(P: Array, out: Array) -> None:
    """Return the standard deviations (..., n) of a covariance (..., n, n); zero for a negative variance."""
    for i in range(len(P)):
        out[i] = deviation(P[i, i])


@helper
def deviation(variance: float) -> float:
    """Return the square root of a variance; zero for a negative one."""
    return 0.0 if variance < 0.0 else math.sqrt(variance)


def tangent(g: Function, x: Array, scale: Array) -> tuple[Array, Array]:
    """Return value (..., m) and Jacobian (..., m, n) of g at x (..., n).

    Both are ``g.value_and_jacobian(x)``, or the Jacobian is ``g.jacobian(x)``, if g has these. Otherwise it comes from central
    differences, with all 2n + 1 points in one call. Steps are ``STEP`` times the standard deviations ``scale`` (..., n), but no
    smaller than rounding allows.
    """
    known = _known_tangent(g, x)
    return _differences(g, *_stencil(x, scale, _signs(x.shape[-1]))) if known is None else known


def _known_tangent(g: Function, x: Array) -> tuple[Array, Array] | None:
    """Return value and Jacobian of a g that has its own, or None."""
    if isinstance(g, Linear):
        return g(x), g.matrix
    both, slope = getattr(g, "value_and_jacobian", None), getattr(g, "jacobian", None)
    if both is not None:
        value, J = both(x)
        return value, J
    return None if slope is None else (g(x), slope(x))


def _differences(g: Function, grid: Array, width: Array) -> tuple[Array, Array]:
    """Return value and Jacobian of g by central differences, from points and distances as ``_stencil`` has them."""
    value, J = _slope(g(grid), width)
    return value, J


@cache
def _signs(n: int) -> Array:
    """Return the steps (2n + 1, n) of central differences in units of each: forward, back, and none."""
    return np.vstack([np.eye(n), -np.eye(n), np.zeros(n)])


@kernel("(n),(n),(p,n)->(p,n),(n)")
def _stencil(x: Array, scale: Array, signs: Array, grid: Array, width: Array) -> None:
    for j in range(len(x)):
        put_step(x[j], scale[j], j, signs, grid, width)


@kernel("(n),(n,n),(p,n)->(p,n),(n)")
def _stencil_of(x: Array, P: Array, signs: Array, grid: Array, width: Array) -> None:
    for j in range(len(x)):
        put_step(x[j], deviation(P[j, j]), j, signs, grid, width)


@helper
def put_step(x: float, scale: float, j: int, signs: Array, grid: Array, width: Array) -> None:
    """Fill in state j of the points of central differences, and the distance between its two as it is after rounding."""
    h, least = STEP * scale, RELATIVE_STEP * abs(x)
    if h - least != h - least:  # NaN, which a comparison by size would report
        h = np.nan
    elif h < least:
        h = least
    h = RELATIVE_STEP if h == 0.0 else h
    for i in range(len(signs)):
        grid[i, j] = x + signs[i, j] * h
    width[j] = grid[j, j] - grid[len(width) + j, j]


@kernel("(p,m),(n)->(m),(m,n)")
def _slope(y: Array, width: Array, value: Array, J: Array) -> None:
    n, m = len(width), len(value)
    for i in range(m):
        value[i] = y[2 * n, i]
    for j in range(n):
        for i in range(m):
            J[i, j] = (y[j, i] - y[n + j, i]) / width[j]
