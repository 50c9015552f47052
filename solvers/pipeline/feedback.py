"""Feedback of a filter's estimate into the INS: the corrected attitude, its covariance, and the reset of a closed loop.

The corrected attitude is C(phi_hat)' C_hat. The misalignment phi' that is left obeys C(phi') = C(phi_hat)' C(phi) and has the
Jacobian C_w(phi')^-1 C(phi_hat)' C_w(phi). Equations: docs/mathematics/error_models.md#feedback.
"""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from solvers.types import Function


def corrected(q_nb: Array, phi: Array) -> Array:
    """Return the attitude (..., 4) of the INS without its estimated misalignment phi (..., 3), rad."""
    return attitude.multiply(attitude.correction_quaternion(phi), q_nb)


def corrected_covariance(phi: Array, P: Array) -> Array:
    """Return the covariance (..., k, k) of the errors left after the correction by phi (..., 3), rad.

    P (..., k, k) is that of phi, which comes first, and of other errors.
    """
    J = np.broadcast_to(np.eye(P.shape[-1]), P.shape).copy()
    J[..., :3, :3] = reset_jacobian(phi, phi)
    return J @ P @ np.swapaxes(J, -1, -2)


def reset_jacobian(phi: Array, phi_hat: Array) -> Array:
    """Return d phi' / d phi (..., 3, 3) at phi for the reset by phi_hat; both are (..., 3) and broadcast, rad."""
    left = remaining(phi, phi_hat)
    turn = np.swapaxes(attitude.misalignment_dcm(phi_hat), -1, -2)
    J = np.linalg.solve(attitude.misalignment_rate_matrix(left), turn @ attitude.misalignment_rate_matrix(phi))
    return np.asarray(J, dtype=np.float64)


def remaining(phi: Array, phi_hat: Array) -> Array:
    """Return the misalignment phi' (..., 3) left after the reset, with C(phi') = C(phi_hat)' C(phi), rad."""
    turn = np.swapaxes(attitude.misalignment_dcm(phi_hat), -1, -2)
    return attitude.misalignment_from_dcm(turn @ attitude.misalignment_dcm(phi))


def reset_maps(x_hat: Array, phi: slice, fed: slice) -> tuple[Function, Function]:
    """Return g and its Jacobian for ``Filter.relocate``, after states of x_hat (..., n) were fed back into the INS.

    The slices ``phi`` and ``fed`` are the misalignment and the other states that were fed back.
    """

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
