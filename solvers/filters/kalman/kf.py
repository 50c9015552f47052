"""Kalman filter.

Idea: mean and covariance pass exactly through linear functions; any other function is replaced by its tangent at the origin,
whatever the estimate is. With errors as the state this is the linear filter of the error dynamics at zero error.

Source: Kalman (1960), doi:10.1115/1.3662552; equations in 000 (3.2.10-14), (3.3.3-3.3.9).
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: the posterior covariance is P - K S K' instead of Joseph's form, for the reason in blocks/conditioning.py.
A function without ``jacobian`` gets one by central differences. The constant terms of the tangents, which 000 (3.3.1-2)
omits, are kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from solvers.blocks.moments import Linearized
from solvers.filters.gaussian import GaussianFilter
from solvers.registry import register


@register("kf")
@dataclass(frozen=True)
class KF(GaussianFilter):
    """The linear Kalman filter of the error dynamics at zero error, run closed loop, which keeps the error near zero."""

    feedback: ClassVar[str] = "closed"  #: feedback into the INS, unless a setting says otherwise

    @cached_property
    def rule(self) -> Linearized:
        return Linearized("origin")


SAME_AS = {
    "kf": (),  # the others lead to it
}
