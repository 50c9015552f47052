"""H-infinity unscented information filter: hinf_ukf with the correction in Y = P^-1.

Idea: a fix adds information, Y = Y- + Hs' R^-1 Hs, with the statistical slope Hs = P_xy' Y- in place of a Jacobian. The
H-infinity bound takes some away, P = (Y - gamma^-2 L'L)^-1. The filter equals hinf_ukf up to rounding.

Source: 000 (4.3.23-37); docs/mathematics/filters.md#h-infinity.
Shapes: x (..., n), P, Y (..., n, n), z (..., m), Hs (..., m, n).
Departures:

- R is increased by the spread of h about its slope, P_yy - Hs P- Hs', which (4.3.32-33) leave out. Without it the filter is
  not hinf_ukf for a nonlinear h (docs/mathematics/errata.md no. 46).
- The information vector is taken about x-. A state known exactly, whose information is infinite, then keeps its value.
- With a diffuse prior, an exact fix or two readings of one sensor, rounding of the information reaches the noise of the fix. The
  correction is then that of hinf_ukf, and is counted as a fallback.
- L, gamma and its raising are those of hinf.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sins_env.arrays import Array, Mask
from solvers.blocks.conditioning import inverse
from solvers.blocks.moments import moments
from solvers.blocks.square_root import factor, symmetrize
from solvers.filters.base import count, fall_back
from solvers.filters.hinfinity.hinf import HinfBelief, UnscentedHinf
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Gaussian, Innovation, Measurement

#: Largest product of P_ii Y_ii, which is 1 for independent states, and S / R. Beyond it rounding costs four digits of twelve.
MOST = 1e12


@register("hinf_uif")
@dataclass(frozen=True)
class HinfUIF(UnscentedHinf[HinfBelief]):
    """The H-infinity unscented information filter."""

    def correct(self, b: HinfBelief, me: Measurement) -> tuple[HinfBelief, Innovation]:
        before = b
        y, repaired = moments(me.h, Gaussian(b.mean, b.cov), self.rule)
        Y, repaired_P = inverse(b.cov)  # (4.3.36)
        Hs = y.cross.mT @ Y  # (4.3.29)
        R = symmetrize(y.cov + me.R - Hs @ y.cross)
        R_inverse, repaired_R = inverse(R)
        lost = _lost(b.cov, Y, y.cov + me.R, np.broadcast_to(me.R, y.cov.shape)) | (
            False if repaired_R is None else repaired_R
        )
        if lost.all():
            x, innovation = super().correct(b, me)
            return count(x, fallbacks=lost), innovation
        weighted = Hs.mT @ R_inverse
        residual = me.z - y.mean
        d = weighted @ residual[..., None]  # (4.3.32) about x-
        Y = Y + symmetrize(weighted @ Hs)  # (4.3.33)
        D, repaired_Y = inverse(Y)
        b = self.bound(b, D)
        L2 = (b.weight**2)[..., None] * np.eye(b.mean.shape[-1])
        P, repaired_bound = inverse(Y - b.theta[..., None, None] * L2)  # (4.3.24)
        after = b._replace(mean=b.mean + (D @ d)[..., 0], cov=P)  # (4.3.35)
        for mask in (repaired, repaired_P, repaired_R, repaired_Y, repaired_bound):
            after = count(after, mask)
        if lost.any():
            after = fall_back(lost, after, super().correct(before, me)[0])
        return after, Innovation(residual, y.cov + me.R)


def _lost(P: Array, Y: Array, S: Array, R: Array) -> Mask:
    """Return a mask (...) of the runs in which rounding of Y = P^-1 reaches the noise R about the slope, or R is singular."""
    L, singular = factor(R)
    noise = np.where(singular[..., None], 0.0, np.square(np.diagonal(L, axis1=-2, axis2=-1)))
    seen = np.where(np.diagonal(S, axis1=-2, axis2=-1) > 0.0, noise, 1.0)
    inflated = (np.diagonal(P, axis1=-2, axis2=-1) * np.diagonal(Y, axis1=-2, axis2=-1)).max(axis=-1)
    return np.asarray(inflated * (np.diagonal(S, axis1=-2, axis2=-1) / seen).max(axis=-1) > MOST)


SAME_AS = {
    "hinf_uif": (
        Relation("ukf", {"gamma2": math.inf}, within=1e-9),
        Relation("hinf_ukf", within=1e-9),
    ),
}
