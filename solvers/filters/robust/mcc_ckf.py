"""Maximum correntropy cubature filters: a fix that fits badly is rejected, softly.

Idea: the update maximises the sum of Gaussian kernels of the whitened residuals of prior and fix instead of minimising their
squares. Weights exp(-e^2 / (2 sigma^2)) and a fixed-point iteration do this (filters/robust/reweighting.py).

Source: Chen, Liu, Zhao & Principe (2017), doi:10.1016/j.automatica.2016.10.004; Liu, Qu, Zhao & Chen (2017),
doi:10.1016/j.sigpro.2016.12.009 (sigma points); MCC-HCKF of 003; docs/mathematics/filters.md#robust-updates.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., points, n).
Promise: if H P- H' <= R / 2, which for a random walk is Q <= R / 6 per fix, a wrong fix pulls a state that it shows by at most
1.2 sigma exp(-1/2) H P- H' / sqrt(R), and one beyond some sigma by nothing. With a larger Q the ordinary posterior, from which the
iteration starts, lies at the fix, and the filter may follow it.
Departures: the iteration starts from the ordinary posterior, because from x- it refuses every fix after a large innovation. It
ends when the weights stand still. ``robust="meas"`` leaves the prior at full weight. A guard prevents locking out
(filters/robust/base.py). P is Joseph's with the told R, as in the source. The iteration contracts only for sigma above a bound
(Chen et al., theorem 2), hence a limit to the rounds. With sigma = inf the filter is the cubature filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from solvers.filters.relations import Relation
from solvers.filters.robust.base import RobustFilter, settings_of
from solvers.filters.robust.reweighting import Correntropy, Each
from solvers.filters.sigma.ckf5 import FifthDegreeFilter
from solvers.registry import register


@register("mcc_ckf")
@dataclass(frozen=True)
class MccCKF(RobustFilter):
    """The cubature Kalman filter with the maximum correntropy update."""

    sigma: float = 3.0  #: width of the kernel in standard deviations, >= 0.5; 2 to 3 is best if 20 % of fixes have 10 R
    robust: str = "both"  #: what is reweighted: "both", which are prior and fix, or "meas", the fix alone

    @cached_property
    def weigh(self) -> Each:
        return Each(Correntropy(self.sigma), self.robust)


@register("mcc_ckf5")
@dataclass(frozen=True)
class MccCKF5(FifthDegreeFilter, MccCKF):
    """The fifth-degree cubature Kalman filter with the maximum correntropy update."""

    @cached_property
    def third(self) -> MccCKF:
        return MccCKF(**settings_of(self))


SAME_AS = {
    "mcc_ckf": (
        Relation("ckf", {"sigma": math.inf}, within=1e-9),
        Relation("ckf", {"sigma": 1e6}, within=1e-9),
    ),
    "mcc_ckf5": (Relation("ckf5", {"sigma": math.inf}, within=1e-9),),
}
UNLIKE = {
    "mcc_ckf": (Relation("mcc_ckf", of_other={"robust": "meas"}),),
    "mcc_ckf5": (Relation("mcc_ckf"),),
}
