"""Feedback of a filter's estimate into the INS: the corrected attitude, its covariance, and the reset of a closed loop.

The corrected attitude is C(phi_hat)' C_hat. The misalignment phi' that is left obeys C(phi') = C(phi_hat)' C(phi) and has the
Jacobian C_w(phi')^-1 C(phi_hat)' C_w(phi). Equations: docs/mathematics/error_models.md#feedback.
"""

from __future__ import annotations

from sins_env.arrays import Array
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    Matrix,
    Vector,
    angles,
    correction,
    misaligned,
    multiply,
    product,
    put_matrix,
    put_quaternion,
    put_row,
    put_vector,
    quaternion,
    rate_matrix,
    row,
    sincos3,
    transpose,
    turn,
    unturned_columns,
    vector,
)
from solvers.types import Function


@kernel("(4),(3)->(4)")
def corrected(q_nb: Array, phi: Array, out: Array) -> None:
    """Return the attitude (..., 4) of the INS without its estimated misalignment phi (..., 3), rad."""
    put_quaternion(multiply(correction(vector(phi)), quaternion(q_nb)), out)


@kernel("(3),(k,k)->(k,k)")
def corrected_covariance(phi: Array, P: Array, out: Array) -> None:
    """Return the covariance (..., k, k) of the errors left after the correction by phi (..., 3), rad.

    P (..., k, k) is that of phi, which comes first, and of other errors.
    """
    k = len(P)
    J = slope(vector(phi), vector(phi))
    for j in range(k):  # J P, of which the rows of phi alone change
        column = turn(J, (P[0, j], P[1, j], P[2, j]))
        out[0, j], out[1, j], out[2, j] = column
        for i in range(3, k):
            out[i, j] = P[i, j]
    for i in range(k):
        put_row(turn(J, row(out, i)), out, i)


@kernel("(3),(3)->(3,3)")
def reset_jacobian(phi: Array, phi_hat: Array, J: Array) -> None:
    """Return d phi' / d phi (..., 3, 3) at phi for the reset by phi_hat; both are (..., 3) and broadcast, rad."""
    put_matrix(slope(vector(phi), vector(phi_hat)), J)


@kernel("(3),(3)->(3)")
def remaining(phi: Array, phi_hat: Array, left: Array) -> None:
    """Return the misalignment phi' (..., 3) left after the reset, with C(phi') = C(phi_hat)' C(phi), rad."""
    put_vector(rest(vector(phi), vector(phi_hat)), left)


@helper
def rest(phi: Vector, phi_hat: Vector) -> Vector:
    """Return the misalignment that is left after the reset by phi_hat."""
    s, c = sincos3(phi)
    s_hat, c_hat = sincos3(phi_hat)
    return angles(product(transpose(misaligned(s_hat, c_hat)), misaligned(s, c)))


@helper
def slope(phi: Vector, phi_hat: Vector) -> Matrix:
    """Return C_w(phi')^-1 C(phi_hat)' C_w(phi)."""
    s, c = sincos3(phi)
    s_hat, c_hat = sincos3(phi_hat)
    s_left, c_left = sincos3(rest(phi, phi_hat))
    return unturned_columns(s_left, c_left, product(transpose(misaligned(s_hat, c_hat)), rate_matrix(s, c)))


def reset_maps(x_hat: Array, phi: slice, fed: slice) -> tuple[Function, Function]:
    """Return g and its Jacobian for ``Filter.relocate``, after states of x_hat (..., n) were fed back into the INS.

    The slices ``phi`` and ``fed`` are the misalignment and the other states that were fed back.
    """

    def like(x: Array) -> Array:
        return x_hat[..., None, :] if x.ndim > x_hat.ndim else x_hat

    first, end, _ = fed.indices(x_hat.shape[-1])

    def g(x: Array) -> Array:
        moved: Array = _moved(x, like(x), phi.start, first, end)
        return moved

    def jacobian(x: Array) -> Array:
        J: Array = _move_slope(x, like(x), phi.start)
        return J

    return g, jacobian


@kernel("(n),(n),(),(),()->(n)", "ddqqqd")
def _moved(x: Array, x_hat: Array, phi: int, fed: int, end: int, out: Array) -> None:
    for i in range(len(x)):
        out[i] = x[i] - x_hat[i] if fed <= i < end else x[i]
    put_vector(rest(vector(x[phi:]), vector(x_hat[phi:])), out[phi:])


@kernel("(n),(n),()->(n,n)", "ddqd")
def _move_slope(x: Array, x_hat: Array, phi: int, J: Array) -> None:
    for i in range(len(x)):
        for j in range(len(x)):
            J[i, j] = 1.0 if i == j else 0.0
    put_matrix(slope(vector(x[phi:]), vector(x_hat[phi:])), J[phi:, phi:])
