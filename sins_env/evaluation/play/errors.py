"""Errors of attitudes as Euler angles, and errors held against their covariance."""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array, Mask


def euler_errors(q_nb: Array, phi: Array) -> Array:
    """Errors of heading, pitch and roll (..., 3) rad of attitudes (..., 4) with the misalignment phi (..., 3)."""
    C = attitude.to_dcm(attitude.normalize(q_nb))
    true = np.matmul(np.swapaxes(attitude.misalignment_dcm(phi), -1, -2), C)
    pairs = zip(attitude.to_euler(C), attitude.to_euler(true), strict=True)
    return attitude.wrap(np.stack([angle - other for angle, other in pairs], axis=-1))


def nees(errors: Array, covariance: Array) -> Array:
    """e' P^-1 e of each run: (R, n), (R, n, n) -> (R,); inf where P is not a covariance.

    The scale of each component is taken out first: radians beside metres would cost half of the digits.
    """
    scale = np.sqrt(np.abs(np.diagonal(covariance, axis1=-2, axis2=-1)))
    finite: Mask = np.asarray(np.isfinite(covariance).all(axis=(-2, -1)) & (scale > 0).all(axis=-1))
    scale = np.where(finite[:, None], scale, 1.0)
    P = np.where(finite[:, None, None], covariance, np.eye(scale.shape[1])) / (scale[:, :, None] * scale[:, None, :])
    values, vectors = np.linalg.eigh(0.5 * (P + np.swapaxes(P, -1, -2)))
    valid = finite & (values[:, 0] > 0)
    across = np.matmul((errors / scale)[:, None, :], vectors)[:, 0, :]
    ratio = np.square(across) / np.where(valid[:, None], values, 1.0)
    return np.where(valid, ratio.sum(axis=1), np.inf)
