"""Huber cubature filters: a fix that fits badly pulls with bounded force.

Idea: the update is a regression on the whitened prior and fix. Residuals beyond ``alpha`` standard deviations enter the cost
linearly instead of squared. Weights alpha / |e| and a few rounds of the update do this (filters/robust/reweighting.py).

Source: Huber (1964), doi:10.1214/aoms/1177703732; Karlgaard & Schaub (2007), doi:10.2514/1.26809; Huber-HCKF of 003;
docs/mathematics/filters.md#robust-updates.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., points, n).
Promise: with ``robust="meas"`` a fix pulls by at most alpha P_xz S_r^-T 1, however wrong it is. With "both", the default, prior
and fix are both doubted, and the one with the smaller variance wins. If H P- H' <= R / 2, which for a random walk is Q <= R / 6
per fix, a fix pulls a state that it shows by at most alpha H P- H' / sqrt(R). If H P- H' > R, for a random walk Q > R / 2, the
filter follows any fix to within alpha R / sqrt(H P- H'); such a Q asks for "meas". In between the rounds may end too early.
Departures: rounds end when the weights, not the state, stand still. ``robust="meas"`` leaves the prior at full weight. A guard
prevents locking out (filters/robust/base.py). P is Joseph's with the told R, as in the source, and therefore too small for
contaminated fixes. With alpha = inf the filter is the cubature filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from solvers.filters.relations import Relation
from solvers.filters.robust.base import RobustFilter, settings_of
from solvers.filters.robust.reweighting import Each, Huber
from solvers.filters.sigma.ckf5 import FifthDegreeFilter
from solvers.registry import register


@register("huber_ckf")
@dataclass(frozen=True)
class HuberCKF(RobustFilter):
    """The cubature Kalman filter with Huber's update."""

    alpha: float = 1.345  #: residual in standard deviations beyond which the cost is linear, > 0
    robust: str = "both"  #: what is reweighted: "both", which are prior and fix, or "meas", the fix alone

    @cached_property
    def weigh(self) -> Each:
        return Each(Huber(self.alpha), self.robust)


@register("huber_ckf5")
@dataclass(frozen=True)
class HuberCKF5(FifthDegreeFilter, HuberCKF):
    """The fifth-degree cubature Kalman filter with Huber's update."""

    @cached_property
    def third(self) -> HuberCKF:
        return HuberCKF(**settings_of(self))


SAME_AS = {
    "huber_ckf": (Relation("ckf", {"alpha": math.inf}, within=1e-9),),
    "huber_ckf5": (Relation("ckf5", {"alpha": math.inf}, within=1e-9),),
}
