"""Attitude: quaternions, direction cosines, Euler angles and the misalignment between two navigation frames.

Quaternions are Hamilton's, scalar first, and ``q_nb`` turns body vectors into n. Heading is clockwise from north, pitch
is nose up, roll is right side down. A misalignment phi (E, N, U) turns n into the computed frame c by right-handed
rotations about U, then E, then N, so that C_hat_nb = C_n^c(phi) C_nb. See docs/mathematics/frames.md.

Functions are batch first; angles are in rad.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    Matrix,
    Quaternion,
    Vector,
    angles,
    correction,
    matrix,
    misaligned,
    put_matrix,
    put_quaternion,
    put_vector,
    quaternion,
    rate_matrix,
    sincos3,
    vector,
)
from sins_env.kernels.algebra import from_rotvec as exp_map
from sins_env.kernels.algebra import multiply as hamilton
from sins_env.kernels.algebra import normalize as unit
from sins_env.kernels.algebra import to_dcm as dcm
from sins_env.kernels.algebra import wrap as wrap

__all__ = [
    "body_rate",
    "conjugate",
    "correction_quaternion",
    "davenport",
    "from_dcm",
    "from_euler",
    "from_rotvec",
    "misalignment",
    "misalignment_dcm",
    "misalignment_from_dcm",
    "misalignment_quaternion",
    "misalignment_rate_matrix",
    "multiply",
    "normalize",
    "rotation_angle",
    "skew",
    "slerp",
    "to_dcm",
    "to_euler",
    "wrap",
]


def _left_table() -> Array:
    """Return T (4, 16) with (q T).reshape(4, 4) @ p = q p, the Hamilton product."""
    table = np.zeros((4, 4, 4))
    for i, j, k, sign in [
        (0, 0, 0, 1), (1, 1, 0, -1), (2, 2, 0, -1), (3, 3, 0, -1),
        (0, 1, 1, 1), (1, 0, 1, 1), (2, 3, 1, 1), (3, 2, 1, -1),
        (0, 2, 2, 1), (2, 0, 2, 1), (3, 1, 2, 1), (1, 3, 2, -1),
        (0, 3, 3, 1), (3, 0, 3, 1), (1, 2, 3, 1), (2, 1, 3, -1),
    ]:  # fmt: skip
        table[i, k, j] = sign  # q_i p_j contributes to component k
    return table.reshape(4, 16)


_LEFT = _left_table()
_RIGHT = np.ascontiguousarray(_LEFT.reshape(4, 4, 4).transpose(2, 1, 0)).reshape(4, 16)


def _dcm_table() -> Array:
    """Return T (16, 9) with (q q').ravel() T = (C(q) - I).ravel() for unit q.

    No column has more than two terms, so that the order in which BLAS adds them does not change the last bits.
    """
    table = np.zeros((4, 4, 3, 3))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        table[j + 1, j + 1, i, i] = table[k + 1, k + 1, i, i] = -2.0
        table[j + 1, k + 1, j, k] += 2.0
        table[j + 1, k + 1, k, j] += 2.0
        table[0, i + 1, k, j] += 2.0
        table[0, i + 1, j, k] -= 2.0
    return table.reshape(16, 9)


_DCM = _dcm_table()
_SKEW = np.zeros((3, 9))
_SKEW[[2, 1, 0], [1, 2, 5]] = -1.0, 1.0, -1.0
_SKEW[[2, 1, 0], [3, 6, 7]] = 1.0, -1.0, 1.0


def sincos(angle: Array) -> tuple[Array, Array]:
    """Compute sine and cosine from the tangent of the half angle, to two units in the last place.

    This is five times faster than NumPy, which has a vector tangent but calls the C library for each sine and cosine.
    """
    t = np.tan(0.5 * angle)
    t2 = t * t
    scale = 1.0 / (1.0 + t2)
    return (t + t) * scale, (1.0 - t2) * scale


def left_matrix(q: Array) -> Array:
    """Return the matrix (..., 4, 4) of a product from the left: left_matrix(q) @ p = q p."""
    return (q @ _LEFT).reshape(*q.shape[:-1], 4, 4)


def right_matrix(q: Array) -> Array:
    """Return the matrix (..., 4, 4) of a product from the right: right_matrix(q) @ p = p q."""
    return (q @ _RIGHT).reshape(*q.shape[:-1], 4, 4)


@kernel("(4),(4)->(4)")
def multiply(q: Array, p: Array, out: Array) -> None:
    """Multiply quaternions: the Hamilton product q p, (..., 4)."""
    put_quaternion(hamilton(quaternion(q), quaternion(p)), out)


def conjugate(q: Array) -> Array:
    """Return the conjugate quaternion (..., 4), the inverse of a unit quaternion."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


@kernel("(4)->(4)")
def normalize(q: Array, out: Array) -> None:
    """Scale a quaternion (..., 4) to unit length."""
    put_quaternion(unit(quaternion(q)), out)


TINY = 1e-300  #: smallest divisor; it keeps a rotation by zero from being 0 / 0


@kernel("(3)->(4)")
def from_rotvec(rotvec: Array, q: Array) -> None:
    """Turn a rotation vector (..., 3), rad, into a quaternion (..., 4). See docs/mathematics/frames.md#quaternion."""
    put_quaternion(exp_map(vector(rotvec)), q)


@helper
def angle_of(q: Quaternion) -> float:
    """Return the angle of a rotation in [0, pi], rad. It is accurate near 0 and pi."""
    return 2.0 * math.atan2(math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), abs(q[0]))


@kernel("(4)->()")
def rotation_angle(q: Array, angle: Array) -> None:
    """Return the angle of a rotation in [0, pi], rad, (...,). It is accurate near 0 and pi, and NaN if q is not finite."""
    angle[0] = angle_of(quaternion(q))


def slerp(q0: Array, q1: Array, w: Array) -> Array:
    """Interpolate from q0 (..., 4) at w = 0 to q1 at w = 1 along the shorter arc; ``w`` is (...,). Both ends are exact."""
    dot = np.sum(q0 * q1, axis=-1, keepdims=True)
    q1 = np.where(dot < 0, -q1, q1)
    w = w[..., None]
    apart, together = (np.sqrt(np.sum(v * v, axis=-1, keepdims=True)) for v in (q1 - q0, q1 + q0))
    theta = 2.0 / np.pi * np.arctan2(apart, together)  # in half turns; accurate where they are small
    mixed = (1.0 - w) * np.sinc((1.0 - w) * theta) * q0 + w * np.sinc(w * theta) * q1
    return np.where(w == 0.0, q0, np.where(w == 1.0, q1, normalize(mixed)))


@kernel("(4)->(3,3)")
def to_dcm(q: Array, C: Array) -> None:
    """Turn a unit quaternion q_nb (..., 4) into C_nb (..., 3, 3). 000 (2.2.11)."""
    put_matrix(dcm(quaternion(q)), C)


def from_dcm(C: Array) -> Array:
    """Turn a direction cosine matrix (..., 3, 3) into a unit quaternion (..., 4) with q_0 >= 0.

    Shepperd's method computes the largest component first. See docs/mathematics/frames.md#quaternion.
    """
    d = np.diagonal(C, axis1=-2, axis2=-1)
    trace = d.sum(-1, keepdims=True)
    squares = np.concatenate([1.0 + trace, 1.0 + 2.0 * d - trace], axis=-1)  # 4 q_i^2
    pair = np.empty((*C.shape[:-2], 4, 4))  # 4 q_i q_j
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        pair[..., 0, i + 1] = pair[..., i + 1, 0] = C[..., k, j] - C[..., j, k]
        pair[..., j + 1, k + 1] = pair[..., k + 1, j + 1] = C[..., k, j] + C[..., j, k]
    for i in range(4):
        pair[..., i, i] = squares[..., i]
    best = np.argmax(squares, axis=-1)[..., None]
    q = np.take_along_axis(pair, best[..., None], axis=-2)[..., 0, :]
    q = q / np.sqrt(np.sum(q * q, axis=-1, keepdims=True))
    return np.where(q[..., :1] < 0, -q, q)


def from_euler(heading: Array | float, pitch: Array | float, roll: Array | float) -> Array:
    """Turn heading (clockwise), pitch and roll, rad, into q_nb = Rz(-heading) Rx(pitch) Ry(roll), (..., 4).

    000 (2.2.6) to (2.2.8).
    """
    q: Array = _from_euler(heading, pitch, roll)
    return q


@kernel("(),(),()->(4)")
def _from_euler(heading: float, pitch: float, roll: float, q: Array) -> None:
    put_quaternion(correction((pitch, roll, -heading)), q)


@helper
def euler_of(C: Matrix) -> Vector:
    """Read heading, pitch and roll from C_nb as :func:`to_euler` does."""
    level = math.hypot(C[1], C[4])
    pitch = math.atan2(C[7], level)
    if level > 1e-9:
        return math.atan2(C[1], C[4]), pitch, math.atan2(-C[6], C[8])
    return math.atan2(-C[3], C[0]), pitch, 0.0


@kernel("(3,3)->(),(),()")
def _to_euler(C: Array, heading: Array, pitch: Array, roll: Array) -> None:
    heading[0], pitch[0], roll[0] = euler_of(matrix(C))


def to_euler(C: Array) -> tuple[Array, Array, Array]:
    """Read heading in (-pi, pi], pitch and roll, rad, from C_nb (..., 3, 3). 000 (2.2.9).

    At a pitch of +-90 deg the roll is set to zero.
    """
    found: tuple[Array, Array, Array] = _to_euler(C)
    return found


def body_rate(angles: Array, rates: Array) -> Array:
    """Return omega_nb^b (..., 3), rad/s, from heading, pitch, roll and their rates, (..., 3) each.

    See docs/mathematics/frames.md#body-rate.
    """
    tilt = np.moveaxis(angles, -1, 0)[1:]
    return np.stack(body_rate_planes(np.sin(tilt), np.cos(tilt), np.moveaxis(rates, -1, 0)), axis=-1)


@helper
def body_rate_planes(sine: Any, cosine: Any, rates: Any) -> tuple[Any, Any, Any]:
    """Return the components of :func:`body_rate` with components in front, of arrays, or of numbers in a kernel.

    ``sine`` and ``cosine`` are those of pitch and roll, (2, ...); ``rates`` are those of heading, pitch, roll, (3, ...).
    """
    (sp, sr), (cp, cr), (dh, dp, dr) = sine, cosine, rates
    return dp * cr + dh * sr * cp, dr - dh * sp, dp * sr - dh * cr * cp


def cross_planes(a: Array, b: Array) -> Array:
    """Return a x b of (3, ...), with components along the first axis."""
    first = a[1] * b[2] - a[2] * b[1]
    out = np.empty((3, *first.shape))
    out[0] = first
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


def davenport(M: Array) -> Array:
    """Return Davenport's matrix K (..., 4, 4) of M (..., 3, 3), up to a multiple of I.

    K is symmetric, with q' K q = tr(C(q)' M) - tr M for unit q. The eigenvector of its largest eigenvalue is the
    quaternion of the rotation nearest to M.
    """
    K = (M.reshape(*M.shape[:-2], 9) @ _DCM.T).reshape(*M.shape[:-2], 4, 4)
    return 0.5 * (K + np.swapaxes(K, -1, -2))


def skew(v: Array) -> Array:
    """Return the matrix (..., 3, 3) of a cross product: skew(v) @ u = v x u."""
    return (v @ _SKEW).reshape(*v.shape, 3)


def misalignment_rows(phi: Array) -> tuple[Array, Array, Array]:
    """Return C_n^c (3, 3, ...) and sine and cosine (3, ...) of phi (3, ...), with the components in front.

    Sigma-point filters evaluate this thousands of times per epoch, and NumPy is fast along long last axes.
    C_n^c = R_N(phi_N) R_E(phi_E) R_U(phi_U) is 001 (6) with its misprint corrected, erratum 66.
    See docs/mathematics/frames.md#misalignment.
    """
    s, c = sincos(phi)
    sx, sy, sz = s
    cx, cy, cz = c
    C = np.empty((3, *phi.shape))
    # rows of R_E R_U first, then R_N mixes the first and the last
    C[1, 0], C[1, 1], C[1, 2] = -cx * sz, cx * cz, sx
    turned = np.empty((2, 3, *phi.shape[1:]))
    turned[0, 0], turned[0, 1], turned[0, 2] = cz, sz, 0.0
    turned[1, 0], turned[1, 1], turned[1, 2] = sx * sz, -sx * cz, cx
    C[0] = cy * turned[0] - sy * turned[1]
    C[2] = sy * turned[0] + cy * turned[1]
    return C, s, c


@kernel("(3)->(3,3)")
def misalignment_dcm(phi: Array, C: Array) -> None:
    """Return C_n^c (..., 3, 3) of phi (..., 3), rad. See docs/mathematics/frames.md#misalignment."""
    put_matrix(misaligned(*sincos3(vector(phi))), C)


@kernel("(3)->(4)")
def correction_quaternion(phi: Array, q: Array) -> None:
    """Return the quaternion (..., 4) of C_n^c(phi)' = Rz(phi_U) Rx(phi_E) Ry(phi_N), which removes a misalignment."""
    put_quaternion(correction(vector(phi)), q)


def misalignment_quaternion(phi: Array) -> Array:
    """Return the quaternion (..., 4) of C_n^c(phi)."""
    return conjugate(correction_quaternion(phi))


@kernel("(3,3)->(3)")
def misalignment_from_dcm(C: Array, phi: Array) -> None:
    """Read phi (..., 3), rad, from C_n^c (..., 3, 3); phi_E is within +-90 deg.

    See docs/mathematics/frames.md#misalignment.
    """
    put_vector(angles(matrix(C)), phi)


@helper
def error_of(q_computed: Quaternion, q_true: Quaternion) -> Quaternion:
    """Return the quaternion of the misalignment of a computed attitude: that of C_n^c(phi) = C_hat_nb C_nb'.

    The products are summed in pairs that cancel between equal attitudes, so that their misalignment is zero to the bit.
    """
    (a, b, c, d), (w, x, y, z) = q_computed, q_true
    return (
        a * w + b * x + c * y + d * z,
        (b * w - a * x) + (d * y - c * z),
        (c * w - a * y) + (b * z - d * x),
        (d * w - a * z) + (c * x - b * y),
    )


@kernel("(4),(4)->(3)")
def misalignment(q_computed: Array, q_true: Array, phi: Array) -> None:
    """Return the misalignment phi (..., 3), rad, of a computed attitude."""
    put_vector(angles(dcm(error_of(quaternion(q_computed), quaternion(q_true)))), phi)


@kernel("(3)->(3,3)")
def misalignment_rate_matrix(phi: Array, C_w: Array) -> None:
    """Return C_w (..., 3, 3) with omega_nc^c = C_w phi_dot. See docs/mathematics/frames.md#misalignment."""
    put_matrix(rate_matrix(*sincos3(vector(phi))), C_w)
