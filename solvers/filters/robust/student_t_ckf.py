"""Student-t cubature filter: the noise of each fix has a variance of its own, which the fix itself tells.

Idea: Student-t noise is Gaussian with covariance R / lambda and a Gamma-distributed lambda. Variational Bayes alternates the
Kalman update with R / E[lambda] and the expectation of lambda given how well the fix then fits
(filters/robust/reweighting.py).

Source: Agamennoni, Nieto & Nebot (2012), doi:10.1109/TSP.2012.2208106; Piche, Sarkka & Hartikainen (2012),
doi:10.1109/MLSP.2012.6349794; Roth, Ozkan & Gustafsson (2013), doi:10.1109/ICASSP.2013.6638770;
docs/mathematics/filters.md#robust-updates.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., 2n, n).
Promise: if H P- H' <= R, which for a random walk is Q <= R / 2 per fix, a single fix pulls the state that it shows by at most
(dof + 1) / (2 sqrt(dof)) H P- H' / sqrt(R), and by less the worse it is. With a larger Q the iteration may follow it.
Departures: lambda scales the whole vector, as the noise of the tasks does. R is the scale matrix of the t distribution, whose
covariance is R dof / (dof - 2). For a nonlinear h the expectation is that of its statistical linearisation. A guard prevents
locking out (filters/robust/base.py). P is that of the last round, with R / lambda. With dof = inf the filter is the cubature
filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from sins_env.arrays import Array
from solvers.filters.relations import Relation
from solvers.filters.robust.base import RobustFilter
from solvers.filters.robust.reweighting import StudentT
from solvers.registry import register
from solvers.types import Moments


@register("student_t_ckf")
@dataclass(frozen=True)
class StudentTCKF(RobustFilter):
    """The cubature Kalman filter for Student-t measurement noise."""

    dof: float = 3.0  #: degrees of freedom, > 0

    @cached_property
    def weigh(self) -> StudentT:
        return StudentT(self.dof)

    def believed(self, y: Moments, R: Array, weights: Array) -> Moments:
        """Return the moments of z with R / lambda in place of R."""
        return y._replace(cov=y.cov + (1.0 / weights[..., :1, None] - 1.0) * R)


SAME_AS = {
    "student_t_ckf": (Relation("ckf", {"dof": math.inf}, within=1e-9),),
}
