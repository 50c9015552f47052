"""The rotation C (..., 3, 3) that takes vectors v into vectors u: exactly for two of them, or best for many.

Wahba's problem, min sum_k w_k |u_k - C v_k|^2, hangs on the profile M = sum_k w_k u_k v_k' alone (its solution maximises
tr(C'M)) and so needs no memory of the pairs. docs/mathematics/coarse_alignment.md#fits. A profile of rank one leaves
the turn about that vector
open: C is some rotation that takes it over; one of zero gives the identity; one that is not finite gives NaN.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array, Mask
from solvers.pipeline.strapdown import cross

Fit = Callable[[Array], Array]


def by_svd(M: Array) -> Array:
    """U diag(1, 1, det U det V) V' of M = U S V'; of a matrix that is nearly a rotation, the nearest one."""
    M, finite = _finite(M)
    U, _, Vt = np.linalg.svd(M)
    U[..., 2] *= (np.linalg.det(U) * np.linalg.det(Vt))[..., None]
    return np.where(finite, U @ Vt, np.nan)


def by_davenport(M: Array) -> Array:
    """C(q) of the eigenvector q to the largest eigenvalue of Davenport's K: the q-method, as OBA uses it.

    Wu, Wu, Hu, Hu, Optimization-based alignment for inertial navigation systems, IEEE Trans. Aerosp. Electron. Syst. 49
    (2013), whose K is this one turned over (they minimise).
    """
    M, finite = _finite(M)
    q = np.linalg.eigh(attitude.davenport(M))[1][..., -1]
    return np.where(finite, attitude.to_dcm(q), np.nan)


def triad(u1: Array, u2: Array, v1: Array, v2: Array) -> Array:
    """C with u1 ~ C v1 exactly and C v2 in the half plane of u1 and u2; zero where either pair spans no plane."""
    return triad_axes(u1, u2) @ np.swapaxes(triad_axes(v1, v2), -1, -2)


def triad_axes(main: Array, other: Array) -> Array:
    """Orthonormal axes as columns (..., 3, 3): along ``main``, along other x main, and their product."""
    first, second = _unit(main), _unit(cross(other, main))
    return np.stack([first, second, cross(first, second)], axis=-1)


def _unit(v: Array) -> Array:
    return v / np.maximum(np.sqrt(np.sum(v * v, axis=-1, keepdims=True)), attitude.TINY)


def _finite(M: Array) -> tuple[Array, Mask]:
    """M with zeros for runs that are not finite, which LAPACK would refuse along with all others; and (..., 1, 1) which are."""
    finite = np.asarray(np.isfinite(M).all(axis=(-2, -1), keepdims=True))
    return np.where(finite, M, 0.0), finite
