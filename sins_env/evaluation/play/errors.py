"""Attitude errors as Euler angles, and the NEES of errors."""

from __future__ import annotations

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.attitude import euler_of
from sins_env.kernels import kernel
from sins_env.kernels.algebra import (
    misaligned,
    normalize,
    product,
    put_vector,
    quaternion,
    sincos3,
    subtract,
    to_dcm,
    transpose,
    vector,
    wrap,
)


@kernel("(4),(3)->(3)")
def euler_errors(q_nb: Array, phi: Array, out: Array) -> None:
    """Return errors (..., 3) of heading, pitch and roll, rad, of attitudes (..., 4) with misalignment phi (..., 3)."""
    C = to_dcm(normalize(quaternion(q_nb)))
    true = product(transpose(misaligned(*sincos3(vector(phi)))), C)
    h, p, r = subtract(euler_of(C), euler_of(true))
    put_vector((wrap(h), wrap(p), wrap(r)), out)


def nees(errors: Array, covariance: Array) -> Array:
    """Return e' P^-1 e of each run, (R, n), (R, n, n) -> (R,); inf if P is not a covariance.

    Each component is scaled by its standard deviation first; radians beside metres would cost half of the digits.
    """
    scale = np.sqrt(np.abs(np.diagonal(covariance, axis1=-2, axis2=-1)))
    finite: Mask = np.asarray(np.isfinite(covariance).all(axis=(-2, -1)) & (scale > 0).all(axis=-1))
    scale = np.where(finite[:, None], scale, 1.0)
    P = np.where(finite[:, None, None], covariance, np.eye(scale.shape[1])) / (scale[:, :, None] * scale[:, None, :])
    values, vectors = np.linalg.eigh(0.5 * (P + np.swapaxes(P, -1, -2)))
    valid = finite & (values[:, 0] > 0)
    across = np.matmul((errors / scale)[:, None, :], vectors)[:, 0, :]
    with np.errstate(over="ignore"):  # errors beside no spread at all: inf
        ratio = np.square(across) / np.where(valid[:, None], values, 1.0)
    return np.where(valid, ratio.sum(axis=1), np.inf)
