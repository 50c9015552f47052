"""Jacobians on the group of :mod:`solvers.pipeline.errors.group`, in closed form at errors of any size.

Equations: docs/mathematics/error_models.md#invariant-coordinates.
"""

from __future__ import annotations

import math

from sins_env.arrays import Array
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    Matrix,
    Quaternion,
    Vector,
    dot,
    misaligned,
    mix,
    product,
    put_matrix,
    rate_matrix,
    row,
    sincos3,
    skewed,
    subtract,
    transpose,
    unturned_columns,
    vector,
)
from sins_env.kernels.trigonometry import sincos
from sins_env.states import Layout
from solvers.pipeline.errors.group import SMALL, coefficients, part


def right_jacobian(xi: Array, states: Layout) -> Array:
    """Return J (..., n, n) with Exp(xi + d) = Exp(xi) Exp(J d) to first order in d (..., n); biases have the identity.

    J is the sum of A^k / (k + 1)! with A = [theta x, 0; xi_v x, theta x], and the same for a position. A^5 is a combination
    of A and A^3, so four terms are enough. Source: Barfoot & Furgale (2014), doi:10.1109/TRO.2014.2298059.
    """
    J: Array = _right_jacobian(xi, 2 if "dp" in states else 1)
    return J


@helper
def begun(theta: Vector, J: Array) -> bool:
    """Make J (n, n) the identity, and return whether theta is known; if not, one entry of J is NaN."""
    put_identity(J)
    if dot(theta, theta) == dot(theta, theta):
        return True
    J[0, 0] = math.nan
    return False


@kernel("(n),()->(n,n)", "dqd")
def _right_jacobian(xi: Array, rows: int, J: Array) -> None:
    theta = vector(xi)
    if not begun(theta, J):
        return
    T, c = right_turn(theta)
    put_block(T, J, 0, 0)
    for i in range(rows):
        put_block(T, J, i + 1, i + 1)
        put_block(right_below(theta, part(xi, i), c), J, i + 1, 0)


@helper
def right_turn(theta: Vector) -> tuple[Matrix, Quaternion]:
    """Return the block of J that turns a vector, and the coefficients of A, A^2, A^3, A^4 in J."""
    t2 = dot(theta, theta)
    c1, c2, c3, c4 = 1 / 2, 1 / 6, 1 / 24, 1 / 120
    if t2 >= SMALL:
        t = math.sqrt(t2)
        s, c = sincos(t)
        c1 = (4.0 - t * s - 4.0 * c) / (2.0 * t2)
        c2 = (4.0 * t - 5.0 * s + t * c) / (2.0 * t2 * t)
        c3 = (2.0 - t * s - 2.0 * c) / (2.0 * t2 * t2)
        c4 = (2.0 * t - 3.0 * s + t * c) / (2.0 * t2 * t2 * t)
    T = skewed(theta)
    return add_identity(mix(c1 - t2 * c3, T, c2 - t2 * c4, product(T, T))), (c1, c2, c3, c4)  # T^3 = -t^2 T


@helper
def right_below(theta: Vector, change: Vector, c: Quaternion) -> Matrix:
    """Return the block of J below the first, for the velocity or place ``change`` of xi."""
    t2, T, V = dot(theta, theta), skewed(theta), skewed(change)
    T2, TV, VT = product(T, T), product(T, V), product(V, T)
    TVT, TTVT, TVTT = product(TV, T), product(T2, VT), product(TV, T2)
    third = mix(1.0, mix(1.0, product(T2, V), 1.0, product(V, T2)), 1.0, TVT)
    fourth = mix(1.0, mix(-t2, TV, -t2, VT), 1.0, mix(1.0, TTVT, 1.0, TVTT))
    return mix(1.0, mix(c[0], V, c[1], mix(1.0, TV, 1.0, VT)), 1.0, mix(c[2], third, c[3], fourth))


@kernel("(n),(n),(h,3)->(n,n)")
def errors_slope(xi: Array, x: Array, held: Array, J: Array) -> None:
    """Return d x / d xi (..., n, n) at xi (..., n) and its errors x (..., n).

    A change d of xi turns the true frame by e = J_r d, with J_r the right Jacobian. It changes phi by C_w^-1 C e_theta, and dv
    by v x e_theta + e_v with the true velocity v. The place changes as the velocity does.
    """
    theta = vector(xi)
    if not begun(theta, J):
        return
    T, c = right_turn(theta)
    put_block(product(from_turn(vector(x)), T), J, 0, 0)
    for i in range(len(held)):
        true = subtract(row(held, i), part(x, i))
        put_block(T, J, i + 1, i + 1)
        put_block(mix(1.0, product(skewed(true), T), 1.0, right_below(theta, part(xi, i), c)), J, i + 1, 0)


@kernel("(n),(n),(h,3)->(n,n)")
def logarithm_slope(xi: Array, x: Array, held: Array, J: Array) -> None:
    """Return d xi / d x (..., n, n) at xi (..., n) and its errors x (..., n): the inverse of ``errors_slope``, block by block."""
    theta = vector(xi)
    if not begun(theta, J):
        return
    c = right_turn(theta)[1]
    back, to = turned_back(theta), to_turn(vector(x))
    put_block(product(back, to), J, 0, 0)
    for i in range(len(held)):
        true = subtract(row(held, i), part(x, i))
        below = mix(1.0, product(right_below(theta, part(xi, i), c), back), 1.0, skewed(true))
        put_block(back, J, i + 1, i + 1)
        put_block(mix(-1.0, product(product(back, below), to), 0.0, to), J, i + 1, 0)


@helper
def turned_back(theta: Vector) -> Matrix:
    """Return the inverse of the block of J that turns a vector."""
    T = skewed(theta)
    return add_identity(mix(-0.5, T, coefficients(theta)[3], product(T, T)))


@helper
def from_turn(phi: Vector) -> Matrix:
    """Return C_w^-1 C, the change of phi with a turn of the true frame."""
    s, c = sincos3(phi)
    return unturned_columns(s, c, misaligned(s, c))


@helper
def to_turn(phi: Vector) -> Matrix:
    """Return C' C_w, the turn of the true frame with a change of phi."""
    s, c = sincos3(phi)
    return product(transpose(misaligned(s, c)), rate_matrix(s, c))


@helper
def add_identity(A: Matrix) -> Matrix:
    """Return I + A."""
    return 1.0 + A[0], A[1], A[2], A[3], 1.0 + A[4], A[5], A[6], A[7], 1.0 + A[8]


@helper
def put_identity(J: Array) -> None:
    """Fill a square array with the identity."""
    for i in range(len(J)):
        for j in range(len(J)):
            J[i, j] = 1.0 if i == j else 0.0


@helper
def put_block(A: Matrix, J: Array, i: int, j: int) -> None:
    """Write a matrix into block (i, j) of an array of blocks (3, 3)."""
    put_matrix(A, J[3 * i : 3 * i + 3, 3 * j : 3 * j + 3])
