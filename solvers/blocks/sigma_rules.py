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

from solvers.types import Array


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
        for name in ("alpha", "beta", "kappa"):
            if not isinstance(getattr(self, name), (int, float)):
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be a number")
        if not (math.isfinite(self.alpha) and self.alpha > 0.0):
            raise ValueError(f"alpha = {self.alpha!r}: must be a finite number > 0")
        for name in ("beta", "kappa"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be a finite number")

    def build(self, n: int) -> Points:
        if n + self.kappa <= 0.0:
            raise ValueError(f"kappa = {self.kappa!r}: must be greater than -{n}, for there are {n} states")
        c = self.alpha**2 * (n + self.kappa)  # n + lambda
        xi = np.vstack([np.zeros(n), math.sqrt(c) * _axes(n)])
        wm = np.full(2 * n + 1, 0.5 / c)
        wm[0] = 1.0 - n / c
        wc = wm.copy()
        wc[0] += 1.0 - self.alpha**2 + self.beta
        pull = self.beta + self.alpha**2 * self.kappa / n  # = wc[0] + total - 2 + 1 / total, not cancelled
        return Points(xi, wm, wc, centre=True, total=n / c, pull=pull, equal=0.5 / c, radius=math.sqrt(c))


def _axes(n: int) -> Array:
    return np.vstack([np.eye(n), -np.eye(n)])
