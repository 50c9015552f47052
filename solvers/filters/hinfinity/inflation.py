"""The H-infinity inflation P = (D^-1 - theta L'L)^-1 with theta = gamma^-2, and when it exists.

Equations 000 (4.2.17-24), (4.3.14-15). L is diagonal and given by its diagonal ``weight`` (..., n); D is (..., n, n), theta
(...). The code uses P = D + theta D L'(I - theta L D L')^-1 L D. It needs neither the inverse of D nor that of the indefinite
matrix R_e, which the source inverts. See docs/mathematics/filters.md#h-infinity.
"""

from __future__ import annotations

import numpy as np

from sins_env.arrays import Array, Mask
from solvers.blocks.moments import standard_deviations
from solvers.blocks.square_root import finite_items, symmetrize

ROUNDING = 1e-8  #: smallest 1 - theta lambda_max(L D L') allowed, because the inflation divides by it


def reciprocal_deviations(P: Array) -> Array:
    """Return the diagonal 1 / sigma_i (..., n) of the L for which L P L' has ones on its diagonal; 0 for sigma_i = 0."""
    sigma = standard_deviations(P)
    return np.divide(1.0, sigma, out=np.zeros(sigma.shape), where=sigma > 0.0)


def weighed(D: Array, weight: Array) -> Array:
    """Return L D L', shape (..., n, n)."""
    return weight[..., :, None] * D * weight[..., None, :]


def largest(D: Array, weight: Array) -> Array:
    """Return lambda_max(L D L') (...); NaN for a D that is not finite."""
    M = weighed(D, weight)
    finite = finite_items(M)
    top = np.linalg.eigvalsh(np.where(finite[..., None, None], M, 0.0))[..., -1]
    return np.where(finite, top, np.nan)


def admissible(D: Array, weight: Array, theta: Array, cap: float) -> tuple[Array, Mask | None]:
    """Lower ``theta`` (...) so that P exists and lambda_max(L P L') is at most ``cap``, and return the lowered runs.

    P exists if theta lambda_max(L D L') < 1. Each eigenvalue l of L D L' becomes l / (1 - theta l). If D is beyond the cap
    already, theta becomes 0. Equation 000 (4.2.18) with no. 42 of docs/mathematics/errata.md corrected.
    """
    trace = (np.diagonal(D, axis1=-2, axis2=-1) * weight**2).sum(axis=-1)  # no eigenvalue is larger
    close = np.asarray(theta > 0.0) & ((theta + 1.0 / cap) * trace > 1.0)
    if not close.any():
        return theta, None
    limit = np.full(theta.shape, np.inf)
    top = largest(D[close], weight[close])
    limit[close] = np.maximum(np.minimum(1.0 / top - 1.0 / cap, (1.0 - ROUNDING) / top), 0.0)
    lowered: Mask = theta > limit
    return (np.minimum(theta, limit), lowered) if lowered.any() else (theta, None)


def inflate(D: Array, weight: Array, theta: Array) -> Array:
    """Return the inflated P (..., n, n) for a theta that is ``admissible``."""
    LD = weight[..., :, None] * D
    A = np.eye(D.shape[-1]) - theta[..., None, None] * weighed(D, weight)
    return D + theta[..., None, None] * symmetrize(LD.mT @ np.linalg.solve(A, LD))
