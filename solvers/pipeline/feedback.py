"""What a filter's estimate does to the INS: the corrected attitude, its covariance, and the reset of a closed loop.

docs/mathematics/error_models.md#feedback: C_b^n <- C(phi_hat)' C_hat; what is left, C(phi') = C(phi_hat)' C(phi), has the Jacobian
C_w(phi')^-1 C(phi_hat)' C_w(phi).
"""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from solvers.types import Function


def corrected(q_nb: Array, phi: Array) -> Array:
    """The INS's attitude (..., 4) without its estimated misalignment phi (..., 3)."""
    return attitude.multiply(attitude.correction_quaternion(phi), q_nb)


def corrected_covariance(phi: Array, P: Array) -> Array:
    """Covariance (..., k, k) of what is left after the correction by phi, from P (..., k, k) of phi and, behind it, others."""
    J = np.broadcast_to(np.eye(P.shape[-1]), P.shape).copy()
    J[..., :3, :3] = reset_jacobian(phi, phi)
    return J @ P @ np.swapaxes(J, -1, -2)


def reset_jacobian(phi: Array, phi_hat: Array) -> Array:
    """d phi' / d phi (..., 3, 3) of the reset by phi_hat, at phi. Both (..., 3), broadcast against each other."""
    left = remaining(phi, phi_hat)
    turn = np.swapaxes(attitude.misalignment_dcm(phi_hat), -1, -2)
    J = np.linalg.solve(attitude.misalignment_rate_matrix(left), turn @ attitude.misalignment_rate_matrix(phi))
    return np.asarray(J, dtype=np.float64)


def remaining(phi: Array, phi_hat: Array) -> Array:
    """phi' with C(phi') = C(phi_hat)' C(phi), (..., 3)."""
    turn = np.swapaxes(attitude.misalignment_dcm(phi_hat), -1, -2)
    return attitude.misalignment_from_dcm(turn @ attitude.misalignment_dcm(phi))


def reset_maps(x_hat: Array, phi: slice, fed: slice) -> tuple[Function, Function]:
    """g and its Jacobian for ``Filter.relocate`` after the states ``phi`` and ``fed`` of x_hat (..., n) went into the INS."""

    def like(x: Array) -> Array:
        return x_hat[..., None, :] if x.ndim > x_hat.ndim else x_hat

    def g(x: Array) -> Array:
        out = x.copy()
        out[..., fed] -= like(x)[..., fed]
        out[..., phi] = remaining(x[..., phi], like(x)[..., phi])
        return out

    def jacobian(x: Array) -> Array:
        n = x.shape[-1]
        J = np.broadcast_to(np.eye(n), (*x.shape, n)).copy()
        J[..., phi, phi] = reset_jacobian(x[..., phi], like(x)[..., phi])
        return J

    return g, jacobian
