"""Square roots S of covariances, P = S S', for whole batches; the only place where a covariance is repaired.

A mask over the batch tells which items were repaired, or None if there was none.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import cast

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.kernels import helper, kernel

Root = Callable[[Array], tuple[Array, Mask | None]]  #: from P (..., n, n) to a root, and which items were repaired

KNOWN = 1e-13  #: largest pivot of a root, relative to its row, that is rounding
FLOOR = 1e-12  #: smallest eigenvalue of a repaired correlation matrix, relative to its largest


def symmetrize(P: Array) -> Array:
    """Return (P + P') / 2, shape (..., n, n)."""
    return 0.5 * (P + P.mT)


def either(a: Mask | None, b: Mask | None) -> Mask | None:
    """Return the union of two masks; None stands for an empty mask."""
    return b if a is None else a if b is None else a | b


def some(mask: Mask) -> bool:
    """Return whether any run of a mask (...) is marked; for a single run in a tenth of the time that NumPy takes."""
    return bool(mask if mask.ndim == 0 else np.count_nonzero(mask))


def any_of(mask: Mask | None) -> Mask | None:
    """Return the runs (...) of which a mask (..., G) over components has any; None stands for an empty mask."""
    return None if mask is None else np.asarray(mask.any(axis=-1))


def tria(M: Array) -> Array:
    """Return the lower triangular S (..., n, n) with S S' = M M' and diagonal >= 0, for M (..., n, k), k >= n."""
    S = cast(Array, np.linalg.qr(M.mT, mode="r")).mT
    return S * np.where(np.diagonal(S, axis1=-2, axis2=-1) < 0, -1.0, 1.0)[..., None, :]


def without_known(S: Array, rounding: float = KNOWN) -> tuple[Array, Mask | None]:
    """Return a lower root (..., m, m) without the components that follow from those before them, and a mask (...) of these runs.

    Their pivots are at most ``rounding`` of their rows. Their rows and columns become zero, so that they get no gain.
    """
    size = np.sqrt(np.square(S).sum(axis=-1))
    pivot = np.abs(np.diagonal(S, axis1=-2, axis2=-1))
    known: Mask = (pivot <= rounding * size) & (size > 0.0)
    if not known.any():
        return S, None
    runs = np.asarray(known.any(axis=-1))
    order = np.argsort(known[runs], axis=-1, kind="stable")  # the others first, in their order
    rest = np.where(known[runs][..., None], 0.0, S[runs])
    root = tria(np.take_along_axis(rest, order[..., None], axis=-2))
    back = np.argsort(order, axis=-1)
    root = np.take_along_axis(np.take_along_axis(root, back[..., None], axis=-2), back[..., None, :], axis=-1)
    out = S.copy()
    out[runs] = root
    return out, runs


def cholesky(P: Array) -> tuple[Array, Mask | None]:
    """Return the lower factor S of P = S S', shape (..., n, n), and a mask (...) of the repaired items or None.

    An item that is not positive definite is repaired: the eigenvalues of its correlation matrix are clipped at ``FLOOR``. The
    units of the states therefore do not matter, and a state of zero variance keeps it. An item that is not finite, or has
    no positive variance left, gets a NaN factor. All other items keep their bits.
    """
    S, bad = factor(P)
    if not some(bad):
        return S, None
    n = P.shape[-1]
    flat, S, bad = P.reshape(-1, n, n), S.reshape(-1, n, n), bad.reshape(-1)
    S[bad] = _clipped_factor(flat[bad])
    repaired = bad & finite_items(S)
    return S.reshape(P.shape), repaired.reshape(P.shape[:-2]) if repaired.any() else None


@helper
def decompose(P: Array, S: Array) -> bool:
    """Fill in the lower S (n, n) of P = S S', and return whether P is positive definite; if it is not, S has no meaning.

    Only the lower triangle of P is read.
    """
    n = len(P)
    inverse = np.empty(n)  # of the pivots
    S[:] = 0.0
    for i in range(n):
        pivot = P[i, i]
        for j in range(i):
            if not abs(P[i, j]) < math.inf:
                return False
            total = P[i, j]
            for k in range(j):
                total -= S[i, k] * S[j, k]
            S[i, j] = total * inverse[j]
            pivot -= S[i, j] * S[i, j]
        if not 0.0 < pivot < math.inf:
            return False
        S[i, i] = math.sqrt(pivot)
        inverse[i] = 1.0 / S[i, i]
    return True


@kernel("(n,n)->(n,n),()", "dd?")
def factor(P: Array, S: Array, bad: Mask) -> None:
    """Return the lower S of P = S S', shape (..., n, n), and a mask (...) of the items that are not positive definite.

    Only the lower triangle of P is read. The factor of a bad item has no meaning.
    """
    bad[0] = not decompose(P, S)


def svd_root(P: Array) -> tuple[Array, Mask | None]:
    """Return the root S = U sqrt(Lambda) of P = U Lambda U', and a mask (...) of the repaired items or None.

    The root is not triangular and accepts a singular P. Only a P that is indefinite beyond rounding counts as repaired.
    003 uses this root: docs/mathematics/filters.md#sigma-points.
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
    """Return a root S of a P that may be singular, such as a Q with zero rows, and a mask of repaired items or None.

    The root is Cholesky's if that exists, else the eigenvector root of the correlation matrix, for which units do not
    matter. Only an indefinite P counts as repaired.
    """
    diagonal = P * np.eye(P.shape[-1])
    if (diagonal == P).all() and (diagonal >= 0.0).all():
        return np.sqrt(diagonal), None
    S, bad = factor(P)
    if not np.count_nonzero(bad):
        return S, None
    n = P.shape[-1]
    flat, S, bad = P.reshape(-1, n, n), S.reshape(-1, n, n), bad.reshape(-1)
    scale, correlation = _correlation(flat[bad])
    S[bad], clipped = svd_root(correlation)
    S[bad] *= scale[..., None]
    repaired = np.zeros_like(bad)
    repaired[bad] = False if clipped is None else clipped
    return S.reshape(P.shape), repaired.reshape(P.shape[:-2]) if repaired.any() else None


def indefinite(P: Array, whole: Array | None = None) -> Mask | None:
    """Return a mask (...) of the items with a negative eigenvalue beyond rounding, or None; only finite ones count.

    Eigenvalues are those of the correlation matrix. With ``whole`` (..., n, n), from which P came by a subtraction, P is
    scaled by the standard deviations of ``whole`` instead.
    """
    if not factor(P)[1].any():
        return None
    finite = finite_items(P)
    _, correlation = _correlation(np.where(finite[..., None, None], P, 0.0), whole)
    negative = finite & (np.linalg.eigvalsh(correlation)[..., 0] < -FLOOR)
    return negative if negative.any() else None


ROOTS: dict[str, Root] = {"cholesky": cholesky, "svd": svd_root}  #: the roots by the name of the setting ``root``


def _clipped_factor(P: Array) -> Array:
    """Return the lower factor of P (B, n, n) without its negative part; NaN if no positive variance is left."""
    finite = finite_items(P)
    scale, correlation = _correlation(np.where(finite[:, None, None], P, 0.0))
    eigenvalues, U = np.linalg.eigh(correlation)
    largest = eigenvalues[:, -1:]
    clipped = np.maximum(eigenvalues, FLOOR * np.maximum(largest, 0.0))
    known = (scale == 0.0)[:, :, None] * np.eye(P.shape[-1])  # a unit pivot for each state of zero variance, for tria
    S = scale[:, :, None] * tria(np.concatenate([U * np.sqrt(clipped)[:, None, :], known], axis=-1))
    lost = ~finite | ((largest[:, 0] <= 0.0) & (scale > 0.0).any(axis=-1))
    S[lost] = np.nan
    return S


def _correlation(P: Array, whole: Array | None = None) -> tuple[Array, Array]:
    """Return the standard deviations (..., n) of P, or of ``whole``, and P divided by them from both sides."""
    scale = np.sqrt(np.abs(np.diagonal(P if whole is None else whole, axis1=-2, axis2=-1)))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    return scale, inverse[..., :, None] * symmetrize(P) * inverse[..., None, :]


def finite_items(P: Array) -> Mask:
    """Return a mask (...) of the finite items of P (..., n, n); on others LAPACK may raise and end the whole batch."""
    return np.asarray(np.isfinite(P).all(axis=(-2, -1)))
