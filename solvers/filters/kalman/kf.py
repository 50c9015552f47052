"""Kalman filter.

Idea: mean and covariance pass exactly through linear functions; a function that is not linear is replaced by
its tangent at the origin, whatever the estimate. On the error state that is the linear filter of the error
dynamics at zero error.

Source: Kalman (1960), doi:10.1115/1.3662552; equations in 000 (3.2.10-14), (3.3.3-3.3.9).
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: posterior as P - K S K' instead of Joseph's form (blocks/conditioning.py says why); Jacobians of
functions without ``jacobian`` by central differences; the constant terms of the tangents, which 000 (3.3.1-2)
omits, are kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from solvers.blocks.moments import Linearized
from solvers.filters.gaussian import GaussianFilter
from solvers.filters.registry import register


@register("kf")
@dataclass(frozen=True)
class KF(GaussianFilter):
    """The linear Kalman filter of the error dynamics at zero error; closed loop, which keeps the error near zero."""

    feedback: ClassVar[str] = "closed"  #: what the pipeline does unless told otherwise

    @cached_property
    def rule(self) -> Linearized:
        return Linearized("origin")
