"""The group SE_2(3) of attitude, velocity and place, in the order of the states phi, dv, dp; other states stay as they are.

``held`` (..., h, 3) is the INS's velocity in m/s and, with h = 2, its place in metres from the site. Equations:
docs/mathematics/error_models.md#invariant-coordinates.
"""

from __future__ import annotations

import math

from sins_env.arrays import Array
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    Vector,
    add,
    correction,
    cross3,
    dot,
    from_rotvec,
    multiply,
    normalize,
    put_quaternion,
    put_row,
    quaternion,
    row,
    scale,
    subtract,
    vector,
)
from sins_env.kernels.trigonometry import sincos

SMALL = 1e-4  #: squared angle below which series are used


@helper
def part(x: Array, i: int) -> Vector:
    """Return the error of velocity (i = 0) or place (i = 1) among the errors (n,)."""
    return x[3 * i + 3], x[3 * i + 4], x[3 * i + 5]


@helper
def put_part(a: Vector, x: Array, i: int) -> None:
    """Write the error of velocity (i = 0) or place (i = 1) into the errors (n,)."""
    x[3 * i + 3], x[3 * i + 4], x[3 * i + 5] = a


@helper
def turned(theta: Vector, y: Vector, a: float, b: float) -> Vector:
    """Return y + a theta x y + b theta x (theta x y)."""
    once = cross3(theta, y)
    return add(y, add(scale(a, once), scale(b, cross3(theta, once))))


@helper
def coefficients(theta: Vector) -> tuple[float, float, float, float]:
    """Return sin t / t, (1 - cos t) / t^2, (1 - sin t / t) / t^2 and (1 - (t / 2) cot(t / 2)) / t^2 with t = |theta|, rad."""
    t2 = dot(theta, theta)
    if t2 != t2 or t2 < SMALL:
        return 1.0 - t2 / 6.0 + t2 * t2 / 120.0, 0.5 - t2 / 24.0 + t2 * t2 / 720.0, 1 / 6 - t2 / 120, 1 / 12 + t2 / 720
    t = math.sqrt(t2)
    s, c = sincos(0.5 * t)
    a1, a2 = 2.0 * s * c / t, 2.0 * s * s / t2
    return a1, a2, (1.0 - a1) / t2, (1.0 - 0.5 * a1 / a2) / t2


@kernel("(n),(h,3)->(n)")
def errors(xi: Array, held: Array, x: Array) -> None:
    """Return the errors x (..., n) of the model, with the misalignment as Euler angles, for xi (..., n)."""
    theta = vector(xi)
    a1, a2, a3, _ = coefficients(theta)
    tx, ty, tz = theta
    for j in range(len(xi)):
        x[j] = xi[j]
    north, up = a1 * ty - a2 * tx * tz, 1.0 - a2 * (tx * tx + ty * ty)
    x[0] = math.atan2(a1 * tx + a2 * ty * tz, math.sqrt(north * north + up * up))
    x[1] = math.atan2(north, up)
    x[2] = math.atan2(a1 * tz - a2 * tx * ty, 1.0 - a2 * (tx * tx + tz * tz))
    for i in range(len(held)):
        value = row(held, i)
        eta = turned(theta, part(xi, i), -a2, a3)
        put_part(subtract(value, turned(theta, subtract(value, eta), a1, a2)), x, i)  # C' = Exp(theta x)


@kernel("(n),(h,3)->(n)")
def logarithm(x: Array, held: Array, xi: Array) -> None:
    """Return xi (..., n) for the errors x (..., n) of the model."""
    w, a, b, c = correction(vector(x))  # the quaternion of C'
    sign = math.copysign(1.0, w)
    sine = math.sqrt(a * a + b * b + c * c)
    angle = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 1e-8 else 2.0
    theta = scale(sign * angle, (a, b, c))
    a1, a2, _, half = coefficients(theta)
    for j in range(len(x)):
        xi[j] = x[j]
    xi[0], xi[1], xi[2] = theta
    for i in range(len(held)):
        value = row(held, i)
        eta = subtract(value, turned(theta, subtract(value, part(x, i)), -a1, a2))
        put_part(turned(theta, eta, 0.5, half), xi, i)


@kernel("(4),(h,3),(n)->(4),(h,3)")
def corrected(q_nb: Array, held: Array, xi: Array, q: Array, after: Array) -> None:
    """Return Exp(-xi) X_hat: the attitude (..., 4), and velocity and place C' (held - eta), (..., h, 3).

    C' = Exp(theta x), and eta is J times the errors of velocity and place.
    """
    theta = vector(xi)
    put_quaternion(normalize(multiply(from_rotvec(theta), quaternion(q_nb))), q)
    a1, a2, a3, _ = coefficients(theta)
    for i in range(len(held)):
        eta = turned(theta, part(xi, i), -a2, a3)
        put_row(turned(theta, subtract(row(held, i), eta), a1, a2), after, i)


@helper
def multiply_slope(F: Array, held: Array) -> None:
    """Make D F of F (n, m), with the slope D = d xi / d x at zero: -held x in the rows of velocity and place on phi."""
    for j in range(F.shape[1]):
        for k in range(len(held)):
            change = cross3(row(held, k), (F[0, j], F[1, j], F[2, j]))
            for i in range(3):
                F[3 * k + 3 + i, j] -= change[i]


@helper
def divide_slope(F: Array, held: Array) -> None:
    """Make F D^-1 of F (m, n)."""
    for i in range(len(F)):
        for k in range(len(held)):
            f = (F[i, 3 * k + 3], F[i, 3 * k + 4], F[i, 3 * k + 5])
            change = cross3(f, row(held, k))  # f' (held x) = (f x held)'
            for j in range(3):
                F[i, j] += change[j]


@kernel("(m,n),(h,3)->(m,n)")
def divided(F: Array, held: Array, out: Array) -> None:
    """Return F D^-1 (..., m, n), with the slope D = d xi / d x at zero."""
    for i in range(len(F)):
        for j in range(F.shape[1]):
            out[i, j] = F[i, j]
    divide_slope(out, held)


@kernel("(n,n),(h,3)->(n,n)")
def spread_noise(Q: Array, held: Array, out: Array) -> None:
    """Return D Q D' (..., n, n) for symmetric Q (..., n, n)."""
    n = len(Q)
    for i in range(n):
        for j in range(n):
            out[i, j] = Q[i, j]
    multiply_slope(out, held)
    for i in range(n):
        for j in range(i):
            out[i, j], out[j, i] = out[j, i], out[i, j]
    multiply_slope(out, held)
