"""Point rules: what distinguishes one sigma-point filter from another.

A rule gives points xi and weights for N(0, I). The points of N(x, S S') are x + S xi. The results of ``points(rule, n)`` are
cached, so a filter may ask for them at every step. Equations: docs/mathematics/filters.md#sigma-points.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import keep, number, refused


class Points(NamedTuple):
    """Weighted points of N(0, I). A centre point, if the rule has one, comes first.

    An outer point has one weight for mean and covariance; the centre may have two. Let y0 be the image of the centre,
    e = mean - y0, and ybar the weighted average of the outer images. Then the covariance is

        sum wc (y - mean)(y - mean)' = sum_outer wc (y - ybar)(y - ybar)' + pull e e'.

    The right side stays accurate when weights are huge: alpha = 1e-3 has wm[0] = -1e6.
    """

    xi: Array  #: (points, n)
    wm: Array  #: (points,), weights of the mean, with sum one
    wc: Array  #: (points,), weights of the covariance
    centre: bool  #: whether the first point is the origin
    total: float  #: sum of the outer weights
    pull: float  #: factor of e e' in the covariance; not used without a centre
    equal: float | None  #: the weight of every outer point; None: they differ
    radius: float | None = None  #: distance of the outer points on the axes, first +, then -; None: they lie elsewhere


class PointRule(Hashable, Protocol):
    """A hashable dataclass of settings that knows its points in every dimension."""

    def build(self, n: int) -> Points:
        """Make the points in n dimensions."""
        ...


@cache
def points(rule: PointRule, n: int) -> Points:
    """Return the points of ``rule`` in n dimensions; the arrays are shared and read-only."""
    p = rule.build(n)
    for array in (p.xi, p.wm, p.wc):
        array.setflags(write=False)
    return p


@dataclass(frozen=True)
class Cubature:
    """The third-degree spherical-radial rule with 2n points of equal weight: 000 (3.3.82), 001 (21)."""

    def build(self, n: int) -> Points:
        w = np.full(2 * n, 0.5 / n)
        return Points(
            math.sqrt(n) * _axes(n), w, w, centre=False, total=1.0, pull=0.0, equal=0.5 / n, radius=math.sqrt(n)
        )


@dataclass(frozen=True)
class Unscented:
    """The scaled unscented rule with 2n + 1 points: 000 (3.3.48-60), with nos. 23 and 24 of docs/mathematics/errata.md.

    The settings (1, 0, 0) give the moments of ``Cubature``.

    Raises:
        ValueError: a setting outside its range; in ``build``, a kappa that is not above -n.
    """

    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n

    def __post_init__(self) -> None:
        keep(self, "alpha", number, "a finite number > 0, at least 1e-20", least=1e-20)
        keep(self, "beta", number)
        keep(self, "kappa", number)

    def build(self, n: int) -> Points:
        if n + self.kappa <= 0.0:
            raise refused("kappa", self.kappa, f"a number > -{n}, for there are {n} states")
        c = self.alpha**2 * (n + self.kappa)  # n + lambda
        xi = np.vstack([np.zeros(n), math.sqrt(c) * _axes(n)])
        wm = np.full(2 * n + 1, 0.5 / c)
        wm[0] = 1.0 - n / c
        wc = wm.copy()
        wc[0] += 1.0 - self.alpha**2 + self.beta
        pull = self.beta + self.alpha**2 * self.kappa / n  # = wc[0] + total - 2 + 1 / total, without cancellation
        return Points(xi, wm, wc, centre=True, total=n / c, pull=pull, equal=0.5 / c, radius=math.sqrt(c))


@dataclass(frozen=True)
class FifthDegree:
    """The fifth-degree spherical-radial rule with 2 n^2 + 1 points, exact for polynomials of degree 5.

    The points on the axes weigh (4 - n) / (2 (n + 2)^2). For n > 4 this is negative, and a covariance of images may come out
    indefinite. For n = 1 it is the Gauss-Hermite rule of three points.
    Source: Jia, Xin & Cheng (2013); 003 (11-24) as reconstructed in docs/mathematics/filters.md#fifth-degree.
    """

    def build(self, n: int) -> Points:
        k, l = np.triu_indices(n, 1)
        e = np.eye(n)
        pairs = math.sqrt(0.5) * np.vstack([e[k] + e[l], e[k] - e[l]])
        xi = math.sqrt(n + 2) * np.vstack([np.zeros(n), pairs, -pairs, _axes(n)])
        wm = np.full(len(xi), 1.0 / (n + 2) ** 2)
        wm[0] = 2.0 / (n + 2)
        wm[-2 * n :] = (4.0 - n) / (2.0 * (n + 2) ** 2)
        return Points(xi, wm, wm.copy(), centre=True, total=n / (n + 2), pull=2.0 / n, equal=None)


def _axes(n: int) -> Array:
    return np.vstack([np.eye(n), -np.eye(n)])
