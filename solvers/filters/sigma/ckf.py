"""Cubature Kalman filter.

Idea: the moments of f and h by the third-degree spherical-radial rule: 2n points of equal weight, a pair on each axis of the
covariance. The rule has no parameter.

Source: Arasaratnam & Haykin (2009), doi:10.1109/TAC.2009.2019800; equations in 000 (3.3.71-96), 001 (13-33);
docs/mathematics/filters.md#sigma-points.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., 2n, n).
Departures: sums are about the mean; sum(chi chi') - x x' would cancel digits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from solvers.blocks.sigma_rules import Cubature
from solvers.filters.relations import Relation
from solvers.filters.sigma.sigma_point import SigmaPointFilter
from solvers.registry import register


@register("ckf")
@dataclass(frozen=True)
class CKF(SigmaPointFilter):
    """The cubature Kalman filter."""

    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance
    form: str = "covariance"  #: "covariance", or "square-root", which carries a root of it and updates it by QR

    @cached_property
    def point_rule(self) -> Cubature:
        return Cubature()


SAME_AS = {
    "ckf": (
        Relation("kf", on="linear", within=1e-10),
        Relation("ckf", {"root": "svd"}, on="linear", within=1e-10),
        Relation("ckf", {"form": "square-root"}, within=1e-10),
    ),
}
VARIANTS = {
    "ckf": (
        {"root": "svd"},
        {"form": "square-root"},
    ),
}
