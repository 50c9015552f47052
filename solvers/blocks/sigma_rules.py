"""Point rules: what distinguishes one sigma-point filter from another.

A rule gives points xi and weights for N(0, I); the points of N(x, S S') are x + S xi. ``points(rule, n)`` is
cached, so a filter may ask for them at every step.
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

    An outer point has the same weight for mean and covariance; only the centre's may differ. With y0 the
    image of the centre, e = mean - y0 and ybar the weighted average of the outer images, the covariance
    sum wc (y - mean)(y - mean)' equals sum_outer wc (y - ybar)(y - ybar)' + pull e e', which stays accurate
    when the weights are huge (alpha = 1e-3 has wm[0] = -1e6).
    """

    xi: Array  #: (points, n)
    wm: Array  #: (points,) weights of the mean, summing to one
    wc: Array  #: (points,) weights of the covariance
    centre: bool  #: whether xi[0] = 0
    total: float  #: sum of the outer weights
    pull: float  #: factor of e e'; not used without a centre
    equal: float | None  #: the weight of every outer point, None if they differ
    radius: float | None = None  #: outer points at +- this distance on the axes, in their order; None: elsewhere


class PointRule(Hashable, Protocol):
    """A hashable dataclass of settings that knows its points in every dimension."""

    def build(self, n: int) -> Points: ...


@cache
def points(rule: PointRule, n: int) -> Points:
    """The points of ``rule`` in n dimensions; the arrays are read-only and shared."""
    p = rule.build(n)
    for array in (p.xi, p.wm, p.wc):
        array.setflags(write=False)
    return p


@dataclass(frozen=True)
class Cubature:
    """Third-degree spherical-radial rule, 2n points of equal weight. # 000 (3.3.82), 001 (21)"""

    def build(self, n: int) -> Points:
        w = np.full(2 * n, 0.5 / n)
        return Points(
            math.sqrt(n) * _axes(n), w, w, centre=False, total=1.0, pull=0.0, equal=0.5 / n, radius=math.sqrt(n)
        )


@dataclass(frozen=True)
class Unscented:
    """Scaled unscented rule, 2n + 1 points. # 000 (3.3.48-3.3.60), with 3.3.54 and 3.3.57-58 corrected

    alpha scales the spread of the points, beta = 2 knows of a Gaussian's fourth moment, kappa is the second
    spread parameter. (1, 0, 0) gives the moments of ``Cubature``.
    """

    alpha: float = 1.0
    beta: float = 0.0
    kappa: float = 0.0

    def __post_init__(self) -> None:
        keep(self, "alpha", number, above=0.0)
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
        pull = self.beta + self.alpha**2 * self.kappa / n  # = wc[0] + total - 2 + 1 / total, not cancelled
        return Points(xi, wm, wc, centre=True, total=n / c, pull=pull, equal=0.5 / c, radius=math.sqrt(c))


@dataclass(frozen=True)
class FifthDegree:
    """Fifth-degree spherical-radial rule, 2 n^2 + 1 points. Jia, Xin & Cheng (2013), # 003 (11-24),
    docs/mathematics/filters.md#fifth-degree

    Exact to degree 5. The points on the axes weigh (4 - n) / (2 (n + 2)^2): nothing for n = 4 and less beyond, where
    a covariance of images may come out indefinite. n = 1 is the Gauss-Hermite rule of three points.
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
