"""Cubature Kalman filter.

Idea: the moments of f and h by the third-degree spherical-radial rule: 2n points of equal weight, a pair on
each axis of the covariance; no parameter.

Source: Arasaratnam & Haykin (2009), doi:10.1109/TAC.2009.2019800; equations in 000 (3.3.71-96), 001 (13-33).
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., 2n, n).
Departures: centred sums instead of sum(chi chi') - x x', which cancels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from solvers.blocks.moments import SigmaPoints
from solvers.blocks.sigma_rules import Cubature
from solvers.filters.gaussian import GaussianFilter
from solvers.filters.registry import register


@register("ckf")
@dataclass(frozen=True)
class CKF(GaussianFilter):
    """The cubature Kalman filter."""

    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance

    def __post_init__(self) -> None:
        _ = self.rule  # checks the settings

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(Cubature(), self.root)
