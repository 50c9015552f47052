"""Square roots S of covariances, P = S S', for whole batches; the only place where one is repaired.

A root that needed repair is reported by a mask over the batch, or by None when no item did: the common case
is one LAPACK call and costs nothing more.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np

from sins_env.arrays import Array, Mask

Root = Callable[[Array], tuple[Array, Mask | None]]

FLOOR = 1e-12  #: smallest eigenvalue of a repaired correlation matrix, relative to its largest


def symmetrize(P: Array) -> Array:
    """(P + P') / 2, shape (..., n, n)."""
    return 0.5 * (P + P.mT)


def either(a: Mask | None, b: Mask | None) -> Mask | None:
    """The items of one mask or the other; None: none."""
    return b if a is None else a if b is None else a | b


def any_of(mask: Mask | None) -> Mask | None:
    """The runs (...) of a mask over their components (..., G)."""
    return None if mask is None else np.asarray(mask.any(axis=-1))


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

    Not triangular. Only an indefinite P, beyond rounding, counts as repaired. # 003,
    docs/mathematics/filters.md#sigma-points "roots"
    """
    finite = finite_items(P)
    eigenvalues, U = np.linalg.eigh(np.where(finite[..., None, None], P, 0.0))
    largest = eigenvalues[..., -1]
    repaired = eigenvalues[..., 0] < -FLOOR * np.abs(largest)
    lost = ~finite | (repaired & (largest <= 0.0))
    S = U * np.sqrt(np.maximum(eigenvalues, 0.0))[..., None, :]
    if lost.any():
        S[lost] = np.nan
    repaired &= ~lost
    return S, repaired if repaired.any() else None


def semidefinite_root(P: Array) -> tuple[Array, Mask | None]:
    """A root S of a P that may be singular, such as a Q with zero rows; only an indefinite P counts as repaired.

    Cholesky where it works, else the eigen root of the correlation matrix, which does not care about units.
    """
    diagonal = P * np.eye(P.shape[-1])
    if (diagonal == P).all() and (diagonal >= 0.0).all():
        return np.sqrt(diagonal), None
    flat = np.ascontiguousarray(P).reshape(-1, *P.shape[-2:])
    S, bad = np.empty_like(flat), np.zeros(len(flat), dtype=bool)
    _factor(flat, S, bad)
    if not bad.any():
        return S.reshape(P.shape), None
    scale, correlation = _correlation(flat[bad])
    S[bad], clipped = svd_root(correlation)
    S[bad] *= scale[..., None]
    repaired = np.zeros_like(bad)
    repaired[bad] = False if clipped is None else clipped
    return S.reshape(P.shape), repaired.reshape(P.shape[:-2]) if repaired.any() else None


def indefinite(P: Array, whole: Array | None = None) -> Mask | None:
    """Which items (...) have a negative eigenvalue beyond rounding; None: none. One that is not finite does not count.

    Eigenvalues are those of the correlation matrix, or of P scaled by the variances of ``whole`` (..., n, n), which P
    came from by a subtraction.
    """
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        finite = finite_items(P)
        _, correlation = _correlation(np.where(finite[..., None, None], P, 0.0), whole)
        negative = finite & (np.linalg.eigvalsh(correlation)[..., 0] < -FLOOR)
        return negative if negative.any() else None
    return None


ROOTS: dict[str, Root] = {"cholesky": cholesky, "svd": svd_root}


def _cholesky_with_repairs(P: Array) -> tuple[Array, Mask | None]:
    n = P.shape[-1]
    flat = np.ascontiguousarray(P).reshape(-1, n, n)
    S = np.empty_like(flat)
    bad = np.zeros(len(flat), dtype=bool)
    _factor(flat, S, bad)
    S[bad] = _clipped_factor(flat[bad])
    repaired = bad & finite_items(S)
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
    finite = finite_items(P)
    scale, correlation = _correlation(np.where(finite[:, None, None], P, 0.0))
    eigenvalues, U = np.linalg.eigh(correlation)
    largest = eigenvalues[:, -1:]
    clipped = np.maximum(eigenvalues, FLOOR * np.maximum(largest, 0.0))
    known = (scale == 0.0)[:, :, None] * np.eye(P.shape[-1])  # keeps their pivots to themselves in tria
    S = scale[:, :, None] * tria(np.concatenate([U * np.sqrt(clipped)[:, None, :], known], axis=-1))
    lost = ~finite | ((largest[:, 0] <= 0.0) & (scale > 0.0).any(axis=-1))
    S[lost] = np.nan
    return S


def _correlation(P: Array, whole: Array | None = None) -> tuple[Array, Array]:
    """Deviations (..., n) of P, or of ``whole``, and P divided by them from both sides."""
    scale = np.sqrt(np.abs(np.diagonal(P if whole is None else whole, axis1=-2, axis2=-1)))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    return scale, inverse[..., :, None] * symmetrize(P) * inverse[..., None, :]


def finite_items(P: Array) -> Mask:
    """Which items (...) of P (..., n, n) are finite; LAPACK may raise on others, and end the whole batch."""
    return np.asarray(np.isfinite(P).all(axis=(-2, -1)))
