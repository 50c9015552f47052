"""Unscented Kalman filter.

Idea: send 2n + 1 weighted points, which match mean and covariance, through f and h and take the moments of their images. No
Jacobian is needed.

Source: Julier & Uhlmann (2004), doi:10.1109/JPROC.2003.823141; scaled points: Julier (2002),
doi:10.1109/ACC.2002.1025369; equations in 000 (3.3.48-3.3.70); docs/mathematics/filters.md#sigma-points.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., 2n + 1, n).
Departures, with the numbers of docs/mathematics/errata.md#chapter-3:

- The points are drawn anew after the prediction. Reusing them, as 000 (3.3.64) and (3.3.67) do, leaves Q out of the
  update (27).
- Equations (3.3.54) and (3.3.57-58) are corrected (23, 24).
- Sums are about the centre point, so that no digits are lost with alpha = 1e-3.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from solvers.blocks.sigma_rules import Unscented
from solvers.filters.relations import Relation
from solvers.filters.sigma.sigma_point import SigmaPointFilter
from solvers.registry import register


@register("ukf")
@dataclass(frozen=True)
class UKF(SigmaPointFilter):
    """The unscented Kalman filter; the default settings make it the cubature filter."""

    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n
    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance
    form: str = "covariance"  #: "covariance", or "square-root", which carries a root of it and updates it by QR

    @cached_property
    def point_rule(self) -> Unscented:
        return Unscented(self.alpha, self.beta, self.kappa)


_SPREAD = {"alpha": 0.7, "beta": 2.0, "kappa": 1.0}
SAME_AS = {
    "ukf": (
        Relation("ckf"),
        Relation("ckf", {"root": "svd"}, {"root": "svd"}),
        Relation("ckf", {"alpha": 1e-3, "beta": 2.0}, on="linear", within=1e-8),
        Relation("ukf", {"form": "square-root", **_SPREAD}, _SPREAD, within=1e-10),
    ),
}
UNLIKE = {
    "ukf": (
        Relation("ukf", of_other={"beta": 2.0}),
        Relation("ukf", of_other={"alpha": 0.5}),
        Relation("ukf", of_other={"kappa": 1.0}),
    ),
}
VARIANTS = {
    "ukf": (
        {"alpha": 0.1, "beta": 2.0},  # with alpha = 1e-3 the rule magnifies rounding by 1e6
        {"root": "svd"},
        {"form": "square-root", "alpha": 0.1, "beta": 2.0},
    ),
}
