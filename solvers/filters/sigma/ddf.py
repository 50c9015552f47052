"""Divided-difference filters of first and second order, in square-root form.

Idea: replace f and h by Stirling's interpolation about the mean: central differences over intervals of h standard
deviations instead of derivatives. The filter ``ddf1`` keeps the slope. The filter ``ddf2`` also keeps the curvature along each
column of S, in mean and covariance.

Source: Norgaard, Poulsen & Ravn (2000), doi:10.1016/S0005-1098(00)00089-3; equations in 000 (3.3.10-3.3.46);
docs/mathematics/filters.md#divided-differences.
Shapes: x (..., n), S (..., n, n), z (..., m); f and h get (..., 2n + 1, n).
Departures: noise is additive, so its columns need no points. Equation (3.3.24) is corrected (docs/mathematics/errata.md
no. 21). Roots come from QR instead of Gram-Schmidt. Sums are about the image of the mean.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from sins_env.checks import keep, number
from solvers.blocks.factors import Differences
from solvers.filters.relations import Relation
from solvers.filters.sigma.square_root import SquareRootFilter
from solvers.registry import register


@register("ddf1")
@dataclass(frozen=True)
class DDF1(SquareRootFilter):
    """The divided-difference filter of first order."""

    interval: float = math.sqrt(3.0)  #: h > 0, in standard deviations; best is the root of the kurtosis

    def __post_init__(self) -> None:
        keep(self, "interval", number, above=0.0)

    @cached_property
    def factor_rule(self) -> Differences:
        return Differences(self.interval, second=False)


@register("ddf2")
@dataclass(frozen=True)
class DDF2(SquareRootFilter):
    """The divided-difference filter of second order."""

    interval: float = math.sqrt(3.0)  #: h >= 1, in standard deviations; best is the root of the kurtosis

    def __post_init__(self) -> None:
        keep(self, "interval", number, least=1.0)

    @cached_property
    def factor_rule(self) -> Differences:
        return Differences(self.interval, second=True)


SAME_AS = {
    "ddf1": (
        Relation("kf", on="linear", within=1e-10),
        Relation("ekf", {"interval": 1e-4}, within=1e-7),
    ),
    "ddf2": (Relation("kf", on="linear", within=1e-10),),
}
UNLIKE = {
    "ddf2": (
        Relation("ddf1"),
        Relation("ckf"),
    ),
}
VARIANTS = {
    "ddf2": ({"interval": 1.0},),
}
