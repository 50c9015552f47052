"""The rotation C (..., 3, 3) that takes vectors v into vectors u: exactly for two of them, or best for many.

Wahba's problem is to minimise sum_k w_k |u_k - C v_k|^2. Its solution maximises tr(C'M) and so depends only on the profile
M = sum_k w_k u_k v_k'. No pair needs to be stored. A profile of rank one leaves the turn about its vector open, and C is some
rotation that fits. A profile of zero gives the identity, and one that is not finite gives NaN.
Equations: docs/mathematics/coarse_alignment.md#fits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array, Mask
from solvers.pipeline.strapdown import cross

Fit = Callable[[Array], Array]  #: from a profile M (..., 3, 3) to a rotation (..., 3, 3)


def by_svd(M: Array) -> Array:
    """Return U diag(1, 1, det U det V) V' for M = U S V'; for a matrix near a rotation this is the nearest rotation."""
    M, finite = _finite(M)
    U, _, Vt = np.linalg.svd(M)
    U[..., 2] *= (np.linalg.det(U) * np.linalg.det(Vt))[..., None]
    return np.where(finite, U @ Vt, np.nan)


def by_davenport(M: Array) -> Array:
    """Return C(q) for the eigenvector q to the largest eigenvalue of Davenport's K: the q-method.

    Source: Wu, Wu, Hu, Hu, Optimization-based alignment for inertial navigation systems, IEEE Trans. Aerosp. Electron. Syst. 49
    (2013). Their K has the opposite sign, because they minimise.
    """
    M, finite = _finite(M)
    q = np.linalg.eigh(attitude.davenport(M))[1][..., -1]
    return np.where(finite, attitude.to_dcm(q), np.nan)


def triad(u1: Array, u2: Array, v1: Array, v2: Array) -> Array:
    """Return C with C v1 along u1 and C v2 in the half plane of u1 and u2; zero if either pair spans no plane."""
    return triad_axes(u1, u2) @ np.swapaxes(triad_axes(v1, v2), -1, -2)


def triad_axes(main: Array, other: Array) -> Array:
    """Return orthonormal axes as columns (..., 3, 3): along ``main``, along other x main, and their cross product."""
    first, second = _unit(main), _unit(cross(other, main))
    return np.stack([first, second, cross(first, second)], axis=-1)


def _unit(v: Array) -> Array:
    return v / np.maximum(np.sqrt(np.sum(v * v, axis=-1, keepdims=True)), attitude.TINY)


def _finite(M: Array) -> tuple[Array, Mask]:
    """Return M with zeros for runs that are not finite, and a mask (..., 1, 1) of the finite runs.

    LAPACK would refuse the whole batch because of one run that is not finite.
    """
    finite = np.asarray(np.isfinite(M).all(axis=(-2, -1), keepdims=True))
    return np.where(finite, M, 0.0), finite
