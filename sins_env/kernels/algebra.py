"""Vectors, quaternions and rotation matrices of one run, as tuples of numbers: what kernels share.

A vector has three numbers, a quaternion four, and a matrix nine, by rows. Frames and conventions: docs/mathematics/frames.md.
"""

from __future__ import annotations

import math
from typing import Any

from sins_env.arrays import Array
from sins_env.kernels.compiling import helper, reduction
from sins_env.kernels.trigonometry import NEAR, cosine_series, sincos, sine_excess

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]


@helper
def vector(a: Array) -> Vector:
    """Return the numbers of an array (3,)."""
    return a[0], a[1], a[2]


@helper
def row(a: Array, i: int) -> Vector:
    """Return the numbers of row i of an array (k, 3)."""
    return a[i, 0], a[i, 1], a[i, 2]


@helper
def quaternion(a: Array) -> Quaternion:
    """Return the numbers of an array (4,)."""
    return a[0], a[1], a[2], a[3]


@helper
def matrix(a: Array) -> Matrix:
    """Return the numbers of an array (3, 3), by rows."""
    return a[0, 0], a[0, 1], a[0, 2], a[1, 0], a[1, 1], a[1, 2], a[2, 0], a[2, 1], a[2, 2]


@helper
def put_vector(a: Vector, out: Array) -> None:
    """Write a vector into an array (3,)."""
    out[0], out[1], out[2] = a


@helper
def put_row(a: Vector, out: Array, i: int) -> None:
    """Write a vector into row i of an array (k, 3)."""
    out[i, 0], out[i, 1], out[i, 2] = a


@helper
def put_quaternion(q: Quaternion, out: Array) -> None:
    """Write a quaternion into an array (4,)."""
    out[0], out[1], out[2], out[3] = q


@helper
def put_matrix(C: Matrix, out: Array) -> None:
    """Write a matrix into an array (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2], out[1, 0], out[1, 1], out[1, 2], out[2, 0], out[2, 1], out[2, 2] = C


@helper
def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@helper
def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@helper
def scale(k: float, a: Vector) -> Vector:
    """Return k a."""
    return k * a[0], k * a[1], k * a[2]


@helper
def times(a: Vector, b: Vector) -> Vector:
    """Return the products of the numbers of a and b, one by one."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@helper
def dot(a: Vector, b: Vector) -> float:
    """Return a' b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@helper
def cross3(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@helper
def turn(C: Matrix, a: Vector) -> Vector:
    """Return C a."""
    return (
        C[0] * a[0] + C[1] * a[1] + C[2] * a[2],
        C[3] * a[0] + C[4] * a[1] + C[5] * a[2],
        C[6] * a[0] + C[7] * a[1] + C[8] * a[2],
    )


@helper
def product(A: Matrix, B: Matrix) -> Matrix:
    """Return A B."""
    return (
        A[0] * B[0] + A[1] * B[3] + A[2] * B[6],
        A[0] * B[1] + A[1] * B[4] + A[2] * B[7],
        A[0] * B[2] + A[1] * B[5] + A[2] * B[8],
        A[3] * B[0] + A[4] * B[3] + A[5] * B[6],
        A[3] * B[1] + A[4] * B[4] + A[5] * B[7],
        A[3] * B[2] + A[4] * B[5] + A[5] * B[8],
        A[6] * B[0] + A[7] * B[3] + A[8] * B[6],
        A[6] * B[1] + A[7] * B[4] + A[8] * B[7],
        A[6] * B[2] + A[7] * B[5] + A[8] * B[8],
    )


@helper
def mix(a: float, A: Matrix, b: float, B: Matrix) -> Matrix:
    """Return a A + b B."""
    return (
        a * A[0] + b * B[0], a * A[1] + b * B[1], a * A[2] + b * B[2],
        a * A[3] + b * B[3], a * A[4] + b * B[4], a * A[5] + b * B[5],
        a * A[6] + b * B[6], a * A[7] + b * B[7], a * A[8] + b * B[8],
    )  # fmt: skip


@helper
def transpose(C: Matrix) -> Matrix:
    """Return C'."""
    return C[0], C[3], C[6], C[1], C[4], C[7], C[2], C[5], C[8]


@helper
def multiply(q: Quaternion, p: Quaternion) -> Quaternion:
    """Return the Hamilton product q p."""
    return (
        q[0] * p[0] - q[1] * p[1] - q[2] * p[2] - q[3] * p[3],
        q[0] * p[1] + q[1] * p[0] + q[2] * p[3] - q[3] * p[2],
        q[0] * p[2] - q[1] * p[3] + q[2] * p[0] + q[3] * p[1],
        q[0] * p[3] + q[1] * p[2] - q[2] * p[1] + q[3] * p[0],
    )


@helper
def normalize(q: Quaternion) -> Quaternion:
    """Return a quaternion of unit length."""
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm


@helper
def from_rotvec(r: Vector) -> Quaternion:
    """Return the quaternion of a rotation vector, rad."""
    z = 0.25 * dot(r, r)
    if z < NEAR:
        c, k = cosine_series(z), 0.5 + 0.5 * sine_excess(z)
    else:
        half = math.sqrt(z)
        s, c = sincos(half)
        k = 0.5 * s / half
    return c, k * r[0], k * r[1], k * r[2]


@helper
def to_dcm(q: Quaternion) -> Matrix:
    """Return the matrix of a unit quaternion, 000 (2.2.11)."""
    xx, yy, zz = q[1] * q[1], q[2] * q[2], q[3] * q[3]
    xy, xz, yz = q[1] * q[2], q[1] * q[3], q[2] * q[3]
    wx, wy, wz = q[0] * q[1], q[0] * q[2], q[0] * q[3]
    return (
        1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy),
        2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx),
        2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy),
    )  # fmt: skip


@helper
def conjugated(q: Quaternion) -> Quaternion:
    """Return the inverse of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


@helper
def sincos3(a: Vector) -> tuple[Vector, Vector]:
    """Return the sines and the cosines of three angles."""
    sx, cx = sincos(a[0])
    sy, cy = sincos(a[1])
    sz, cz = sincos(a[2])
    return (sx, sy, sz), (cx, cy, cz)


@helper
def misaligned(sine: Vector, cosine: Vector) -> Matrix:
    """Return C_n^c = R_N R_E R_U, with the sines and cosines of phi: 001 (6) with its misprint corrected, erratum 66.

    See docs/mathematics/frames.md#misalignment.
    """
    sx, sy, sz = sine
    cx, cy, cz = cosine
    return (
        cy * cz - sy * sx * sz, cy * sz + sy * sx * cz, -sy * cx,
        -cx * sz, cx * cz, sx,
        sy * cz + cy * sx * sz, sy * sz - cy * sx * cz, cy * cx,
    )  # fmt: skip


@helper
def rate_matrix(sine: Vector, cosine: Vector) -> Matrix:
    """Return C_w with omega_nc^c = C_w phi_dot, with the sines and cosines of phi."""
    sx, sy, _ = sine
    cx, cy, _ = cosine
    return cy, 0.0, -sy * cx, 0.0, 1.0, sx, sy, 0.0, cy * cx


@helper
def unturned(s: Vector, c: Vector, r: Vector) -> Vector:
    """Return C_w^-1 r, with the sines and cosines of phi: docs/mathematics/frames.md#misalignment."""
    k = (c[1] * r[2] - s[1] * r[0]) / c[0]
    return c[1] * r[0] + s[1] * r[2], r[1] - s[0] * k, k


@helper
def unturned_columns(s: Vector, c: Vector, M: Matrix) -> Matrix:
    """Return C_w^-1 M, with the sines and cosines of phi."""
    x, y, z = unturned(s, c, (M[0], M[3], M[6])), unturned(s, c, (M[1], M[4], M[7])), unturned(s, c, (M[2], M[5], M[8]))
    return x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]


@helper
def wrap(angle: Any) -> Any:
    """Wrap an angle, or an array of them, to [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@helper
def angles(C: Matrix) -> Vector:
    """Read phi from C_n^c; phi_E is within +-90 deg."""
    level = math.sqrt(C[2] * C[2] + C[8] * C[8])
    return math.atan2(C[5], level), math.atan2(-C[2], C[8]), math.atan2(-C[3], C[4])


@helper
def correction(phi: Vector) -> Quaternion:
    """Return the quaternion of C_n^c(phi)' = Rz(phi_U) Rx(phi_E) Ry(phi_N)."""
    (sx, sy, sz), (cx, cy, cz) = sincos3((0.5 * phi[0], 0.5 * phi[1], 0.5 * phi[2]))
    cxcy, sxsy, sxcy, cxsy = cx * cy, sx * sy, sx * cy, cx * sy
    return cz * cxcy - sz * sxsy, cz * sxcy - sz * cxsy, cz * cxsy + sz * sxcy, cz * sxsy + sz * cxcy


@helper
def skewed(a: Vector) -> Matrix:
    """Return the matrix of a x."""
    return 0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0


@helper
def add_skew(k: float, a: Vector, out: Array, column: int) -> None:
    """Add k times the matrix of a x to three columns of an array (3, n)."""
    out[0, column + 1] -= k * a[2]
    out[0, column + 2] += k * a[1]
    out[1, column] += k * a[2]
    out[1, column + 2] -= k * a[0]
    out[2, column] -= k * a[1]
    out[2, column + 1] += k * a[0]


@reduction
def inner(a: Array, b: Array, count: int) -> float:
    """Return the inner product of the first ``count`` numbers of two contiguous rows."""
    total = 0.0
    for i in range(count):
        total += a[i] * b[i]
    return total
