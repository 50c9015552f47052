"""Huber cubature filters: a fix that fits badly pulls with bounded force.

Idea: the update is a regression on the whitened prior and fix; residuals beyond ``alpha`` standard deviations enter the
cost linearly instead of squared, by weights alpha / |e| and a few rounds of the update (blocks/robust.py).

Source: Huber (1964), doi:10.1214/aoms/1177703732; Karlgaard & Schaub (2007), doi:10.2514/1.26809; Huber-HCKF of 003,
docs/mathematics/filters.md#robust-updates.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., points, n).
Departures: rounds end when the weights stand still, not the state; ``robust="meas"`` leaves the prior at full weight; a
guard against locking out (filters/robust.py). P is Joseph's with the told R, as the source has it: too small where the
fixes are contaminated. alpha = inf is the cubature filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from solvers.filters.registry import register
from solvers.filters.robust.base import RobustFilter, settings_of
from solvers.filters.robust.reweighting import Each, Huber
from solvers.filters.sigma.ckf5 import FifthDegreeFilter


@register("huber_ckf")
@dataclass(frozen=True)
class HuberCKF(RobustFilter):
    """The cubature Kalman filter with Huber's update."""

    alpha: float = 1.345  #: standard deviations beyond which a residual counts linearly, > 0
    robust: str = "both"  #: "both": prior and fix are reweighted; "meas": the fix alone

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
