"""Sine and cosine that the compiler turns into vector code, which calls of the C library would prevent."""

from __future__ import annotations

import math

from sins_env.kernels.compiling import helper

NEAR = (0.25 * math.pi) ** 2  #: largest square of an angle that the series are made for
_ROUND = 6755399441055744.0  # 1.5 * 2^52: adding and subtracting it rounds to the nearest whole number
_TWO_OVER_PI = 2.0 / math.pi
# pi / 2 in three parts; the first two have 33 bits, so that their products with a small whole number are exact
_PI_A, _PI_B, _PI_C = 1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21


@helper
def sine_excess(z: float) -> float:
    """Return sin(x) / x - 1 of z = x^2 < ``NEAR``, by the polynomial of fdlibm (k_sin.c)."""
    p = 1.58969099521155010221e-10
    p = -2.50507602534068634195e-08 + z * p
    p = 2.75573137070700676789e-06 + z * p
    p = -1.98412698298579493134e-04 + z * p
    p = 8.33333333332248946124e-03 + z * p
    p = -1.66666666666666324348e-01 + z * p
    return z * p


@helper
def cosine_series(z: float) -> float:
    """Return cos(x) of z = x^2 < ``NEAR``, by the polynomial of fdlibm (k_cos.c)."""
    p = -1.13596475577881948265e-11
    p = 2.08757232129817482790e-09 + z * p
    p = -2.75573143513906633035e-07 + z * p
    p = 2.48015872894767294178e-05 + z * p
    p = -1.38888888888741095749e-03 + z * p
    p = 4.16666666666666019037e-02 + z * p
    half = 0.5 * z
    w = 1.0 - half
    return w + (((1.0 - w) - half) + z * z * p)


@helper
def sincos(x: float) -> tuple[float, float]:
    """Return sine and cosine of an angle, rad, to one unit in the last place; NaN gives NaN.

    Beyond 1e5 rad the error is about that of the angle itself, 1e-16 of it. An angle of 1e16 rad has no digits left and gives
    NaN.
    """
    n = (x * _TWO_OVER_PI + _ROUND) - _ROUND
    r = ((x - n * _PI_A) - n * _PI_B) - n * _PI_C
    # only equality is asked for, here and below, because a comparison by size raises a flag for NaN
    r = r if (n + 0.5) - n == 0.5 else math.nan
    z = r * r
    sine, cosine = r + r * sine_excess(z), cosine_series(z)
    # n modulo 4, from -2 to 2, is the quadrant
    m = n - 4.0 * ((0.25 * n + _ROUND) - _ROUND)
    square = m * m
    a = cosine if square == 1.0 else sine
    b = sine if square == 1.0 else cosine
    return (-a if square == 4.0 or m == -1.0 else a), (-b if square == 4.0 or m == 1.0 else b)
