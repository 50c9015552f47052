"""Extended Kalman filter.

Idea: replace f and h by their tangents at the current mean, then do as the Kalman filter does.

Source: Jazwinski (1970), Stochastic Processes and Filtering Theory, ch. 8; equations in 000 (3.3.1-3.3.9).
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: x- = f(x) and z- = h(x-), for which 000 prints Phi x and H x- (docs/mathematics/errata.md no. 19). The posterior
covariance is P - K S K' instead of Joseph's form. A function without ``jacobian`` gets one by central differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from solvers.blocks.moments import Linearized
from solvers.filters.gaussian import GaussianFilter
from solvers.filters.relations import Relation
from solvers.registry import register


@register("ekf")
@dataclass(frozen=True)
class EKF(GaussianFilter):
    """The extended Kalman filter."""

    @cached_property
    def rule(self) -> Linearized:
        return Linearized("mean")


SAME_AS = {
    "ekf": (Relation("kf", on="linear", within=1e-10),),
}
UNLIKE = {
    "ekf": (Relation("ckf"),),
}
