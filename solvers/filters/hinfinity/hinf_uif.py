"""H-infinity unscented information filter: hinf_ukf with the correction in Y = P^-1.

Idea: a fix adds information, Y = Y- + Hs' R^-1 Hs, with the statistical slope Hs = P_xy' Y- in place of a Jacobian. The
H-infinity bound takes some away, P = (Y - gamma^-2 L'L)^-1. The filter equals hinf_ukf up to rounding.

Source: 000 (4.3.23-37); docs/mathematics/filters.md#h-infinity.
Shapes: x (..., n), P, Y (..., n, n), z (..., m), Hs (..., m, n).
Departures:

- R is increased by the spread of h about its slope, P_yy - Hs P- Hs', which (4.3.32-33) leave out. Without it the filter is
  not hinf_ukf for a nonlinear h (docs/mathematics/errata.md no. 46).
- The information vector is taken about x-. A state known exactly, whose information is infinite, then keeps its value.
- R must be positive definite, because an exact fix has infinite information too.
- L, gamma and its raising are those of hinf.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from solvers.blocks.conditioning import inverse
from solvers.blocks.moments import moments
from solvers.blocks.square_root import symmetrize
from solvers.filters.base import count
from solvers.filters.hinfinity.hinf import HinfBelief, UnscentedHinf
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Gaussian, Innovation, Measurement


@register("hinf_uif")
@dataclass(frozen=True)
class HinfUIF(UnscentedHinf[HinfBelief]):
    """The H-infinity unscented information filter."""

    def correct(self, b: HinfBelief, me: Measurement) -> tuple[HinfBelief, Innovation]:
        y, repaired = moments(me.h, Gaussian(b.mean, b.cov), self.rule)
        Y, repaired_P = inverse(b.cov)  # (4.3.36)
        Hs = y.cross.mT @ Y  # (4.3.29)
        R = symmetrize(y.cov + me.R - Hs @ y.cross)
        R_inverse, repaired_R = inverse(R)
        weighted = Hs.mT @ R_inverse
        residual = me.z - y.mean
        d = weighted @ residual[..., None]  # (4.3.32) about x-
        Y = Y + symmetrize(weighted @ Hs)  # (4.3.33)
        D, repaired_Y = inverse(Y)
        b = self.bound(b, D)
        L2 = (b.weight**2)[..., None] * np.eye(b.mean.shape[-1])
        P, repaired_bound = inverse(Y - b.theta[..., None, None] * L2)  # (4.3.24)
        b = b._replace(mean=b.mean + (D @ d)[..., 0], cov=P)  # (4.3.35)
        for mask in (repaired, repaired_P, repaired_R, repaired_Y, repaired_bound):
            b = count(b, mask)
        return b, Innovation(residual, y.cov + me.R)


SAME_AS = {
    "hinf_uif": (
        Relation("ukf", {"gamma2": math.inf}, within=1e-9),
        Relation("hinf_ukf", within=1e-9),
    ),
}
