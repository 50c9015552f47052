"""Cubature Kalman filter of the fifth degree.

Idea: the moments of f and h by the fifth-degree spherical-radial rule, 2 n^2 + 1 points. The rule is exact for polynomials of
degree 5, that of ``ckf`` for degree 3.

Source: Jia, Xin & Cheng (2013), doi:10.1016/j.automatica.2012.11.014; 003 (11-24);
docs/mathematics/filters.md#fifth-degree.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., 2 n^2 + 1, n).
Departures: for n > 4 the points on the axes have negative weights. In a strongly nonlinear step P-, S or P may then come out
indefinite beyond repair, and a negative variance reverses the gain. Such a run takes this prediction or correction with the
third-degree rule, whose weights are positive. The step is counted as a fallback.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

from solvers.blocks.moments import SigmaPoints
from solvers.blocks.sigma_rules import FifthDegree
from solvers.blocks.square_root import either, indefinite
from solvers.filters.base import choose, fall_back
from solvers.filters.gaussian import GaussianFilter
from solvers.filters.relations import Relation
from solvers.filters.sigma.ckf import CKF
from solvers.registry import register
from solvers.types import Innovation, Linear, Measurement, Transition

B = TypeVar("B", bound=Any)


class FifthDegreeFilter(GaussianFilter[B]):
    """The fifth-degree rule for a filter; ``third`` takes over if its negative weights break a covariance."""

    root: str

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(FifthDegree(), self.root)

    @cached_property
    def third(self) -> GaussianFilter[B]:
        """The same filter with the third-degree rule, whose weights are positive."""
        raise NotImplementedError(f"{type(self).__name__} has nothing to fall back on")

    def predict(self, b: B, tr: Transition) -> B:
        x = super().predict(b, tr)
        broken = None if isinstance(tr.f, Linear) else indefinite(x.cov)
        return x if broken is None else fall_back(broken, x, self.third.predict(b, tr))

    def correct(self, b: B, me: Measurement) -> tuple[B, Innovation]:
        x, innovation = super().correct(b, me)
        if isinstance(me.h, Linear):
            return x, innovation
        broken = either(indefinite(x.cov, whole=b.cov), indefinite(innovation.cov))
        if broken is None:
            return x, innovation
        y, other = self.third.correct(b, me)
        return fall_back(broken, x, y), choose(broken, other, innovation)


@register("ckf5")
@dataclass(frozen=True)
class CKF5(FifthDegreeFilter):
    """The cubature Kalman filter of the fifth degree."""

    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance

    def __post_init__(self) -> None:
        _ = self.rule  # checks the settings

    @cached_property
    def third(self) -> CKF:
        return CKF(self.root)


SAME_AS = {
    "ckf5": (Relation("kf", on="linear", within=1e-10),),
}
UNLIKE = {
    "ckf5": (Relation("ckf"),),
}
VARIANTS = {
    "ckf5": ({"root": "svd"},),
}
