"""Square roots S of covariances, P = S S', for whole batches; the only place where one is repaired.

A root that needed repair is reported by a mask over the batch, or by None when no item did: the common case
is one LAPACK call and costs nothing more.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np
from numpy.typing import NDArray

from solvers.types import Array

Mask = NDArray[np.bool_]
Root = Callable[[Array], tuple[Array, Mask | None]]

FLOOR = 1e-12  #: smallest eigenvalue of a repaired correlation matrix, relative to its largest


def symmetrize(P: Array) -> Array:
    """(P + P') / 2, shape (..., n, n)."""
    return 0.5 * (P + P.mT)


def tria(M: Array) -> Array:
    """The lower triangular S (..., n, n), diagonal >= 0, with S S' = M M', for M (..., n, k), k >= n."""
    S = cast(Array, np.linalg.qr(M.mT, mode="r")).mT
    return S * np.where(np.diagonal(S, axis1=-2, axis2=-1) < 0, -1.0, 1.0)[..., None, :]


def cholesky(P: Array) -> tuple[Array, Mask | None]:
    """The lower factor S of P = S S', shape (..., n, n), and which items (...) were repaired (None: no item).

    An item that is not positive definite is repaired by clipping the eigenvalues of its correlation matrix at
    ``FLOOR``, so that the units of the states do not matter; a state of zero variance stays at zero. An item
    that is not finite, or has no positive variance left, gets a NaN factor. The others keep their bits.
    """
    try:
        return cast(Array, np.linalg.cholesky(P)), None
    except np.linalg.LinAlgError:
        return _cholesky_with_repairs(P)


def svd_root(P: Array) -> tuple[Array, Mask | None]:
    """The eigen root S = U sqrt(Lambda) of P = U Lambda U', which takes a singular P as it is.

    Not triangular. Only an indefinite P, beyond rounding, counts as repaired. # 003, E.4 "roots"
    """
    finite = _finite_items(P)
    eigenvalues, U = np.linalg.eigh(np.where(finite[..., None, None], P, 0.0))
    largest = eigenvalues[..., -1]
    repaired = eigenvalues[..., 0] < -FLOOR * np.abs(largest)
    lost = ~finite | (repaired & (largest <= 0.0))
    S = U * np.sqrt(np.maximum(eigenvalues, 0.0))[..., None, :]
    if lost.any():
        S[lost] = np.nan
    repaired &= ~lost
    return S, repaired if repaired.any() else None


ROOTS: dict[str, Root] = {"cholesky": cholesky, "svd": svd_root}


def _cholesky_with_repairs(P: Array) -> tuple[Array, Mask | None]:
    n = P.shape[-1]
    flat = np.ascontiguousarray(P).reshape(-1, n, n)
    S = np.empty_like(flat)
    bad = np.zeros(len(flat), dtype=bool)
    _factor(flat, S, bad)
    S[bad] = _clipped_factor(flat[bad])
    repaired = bad & _finite_items(S)
    return S.reshape(P.shape), repaired.reshape(P.shape[:-2]) if repaired.any() else None


def _factor(P: Array, S: Array, bad: Mask) -> None:
    """Factor every item of P (B, n, n) into S, marking those that fail, by halving the batch."""
    try:
        S[:] = np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        if len(P) == 1:
            bad[:] = True
            return
        half = len(P) // 2
        _factor(P[:half], S[:half], bad[:half])
        _factor(P[half:], S[half:], bad[half:])


def _clipped_factor(P: Array) -> Array:
    """The lower factor of P (B, n, n) with its negative part removed; NaN where nothing can be saved."""
    finite = _finite_items(P)
    P = np.where(finite[:, None, None], symmetrize(P), 0.0)
    scale = np.sqrt(np.abs(np.diagonal(P, axis1=-2, axis2=-1)))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    eigenvalues, U = np.linalg.eigh(inverse[:, :, None] * P * inverse[:, None, :])
    largest = eigenvalues[:, -1:]
    clipped = np.maximum(eigenvalues, FLOOR * np.maximum(largest, 0.0))
    S = tria(scale[:, :, None] * U * np.sqrt(clipped)[:, None, :])
    lost = ~finite | ((largest[:, 0] <= 0.0) & (scale > 0.0).any(axis=-1))
    S[lost] = np.nan
    return S


def _finite_items(P: Array) -> Mask:
    return np.asarray(np.isfinite(P).all(axis=(-2, -1)))
