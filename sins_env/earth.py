"""The Earth: radii of curvature, normal gravity, rotation and transport rate.

Every function is batch first and takes an :class:`Earth`. Truth and estimator must use the same one.
See docs/mathematics/frames.md#earth-model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import Vector, put_vector, vector, wrap
from sins_env.kernels.trigonometry import sincos

__all__ = [
    "EARTHS",
    "Earth",
    "check_latitude",
    "displace",
    "ecef_to_enu",
    "get",
    "gravity",
    "gravity_slope",
    "offset",
    "radii",
    "rate_n",
    "to_ecef",
    "transport_matrix",
]

Scalar = float | Array

MAX_LATITUDE = math.radians(89.9)  #: the local-level frame is singular at the poles
FREE_AIR = 3.086e-6  #: 1/s^2, decrease of gravity with height
#: Square of the eccentricity in the gravity formula. It is that of WGS-84 with either ellipsoid, for its constants belong
#: together.
GRAVITY_E2 = 0.00669437999014


@dataclass(frozen=True)
class Earth:
    """An ellipsoid with its rotation and the constants of the WGS-84 normal gravity formula."""

    a: float  #: m, semi-major axis
    f: float  #: flattening
    rate: float = 7.292115e-5  #: rotation rate, rad/s
    gravity_equator: float = 9.7803253359  #: normal gravity at the equator, m/s^2
    somigliana: float = 0.00193185265241  #: constant k of Somigliana's formula

    @property
    def e2(self) -> float:
        """Square of the eccentricity."""
        return self.f * (2.0 - self.f)


#: Earth models by name.
EARTHS = {"wgs84": Earth(6378137.0, 1 / 298.257223563), "thesis": Earth(6378096.0, 1 / 295.0)}  # 000 section 2.2.2


def get(name: str) -> Earth:
    """Return an earth model by its name, ``wgs84`` or ``thesis``.

    Raises:
        ValueError: an unknown name.
    """
    if name not in EARTHS:
        raise unknown("earth model", name, EARTHS)
    return EARTHS[name]


def check_latitude(latitude: float) -> float:
    """Return the latitude, rad, if the local-level frame exists there.

    Raises:
        ValueError: beyond +-89.9 deg, or not finite.
    """
    if not abs(latitude) <= MAX_LATITUDE:
        raise ValueError(f"latitude {math.degrees(latitude):.6g} deg; allowed: -89.9 to 89.9 deg")
    return latitude


@helper
def radii_at(a: float, e2: float, latitude: float) -> tuple[float, float]:
    """Return :func:`radii` of one place and an ellipsoid with semi-major axis ``a`` and squared eccentricity ``e2``."""
    s, _ = sincos(latitude)
    w2 = 1.0 - e2 * (s * s)
    w = math.sqrt(w2)
    return a * (1.0 - e2) / (w2 * w), a / w


@kernel("(),(),()->(),()")
def _radii(a: float, e2: float, latitude: float, meridian: Array, normal: Array) -> None:
    meridian[0], normal[0] = radii_at(a, e2, latitude)


def radii(earth: Earth, latitude: Scalar) -> tuple[Any, Any]:
    """Return the meridian radius R_M, for V_N, and the prime-vertical radius R_N, for V_E, in m.

    They are numbers for a number, and else arrays. See docs/mathematics/frames.md#earth-model.
    """
    if isinstance(latitude, float):
        return radii_at(earth.a, earth.e2, latitude)
    return _radii(earth.a, earth.e2, latitude)


def gravity(earth: Earth, latitude: Scalar, height: Scalar = 0.0) -> Array:
    """Return normal gravity, m/s^2: Somigliana's formula and the free-air gradient. 000 (2.2.25).

    The gradient stands outside the fraction, erratum 2 of docs/mathematics/errata.md#chapter-2.
    """
    s2 = np.sin(latitude) ** 2
    surface = earth.gravity_equator * (1.0 + earth.somigliana * s2) / np.sqrt(1.0 - GRAVITY_E2 * s2)
    return surface - FREE_AIR * np.asarray(height)


def gravity_slope(earth: Earth, latitude: Scalar) -> Array:
    """Return the derivative of normal gravity along the latitude, m/s^2 per rad."""
    s, c, k = np.sin(latitude), np.cos(latitude), earth.somigliana
    w2 = 1.0 - GRAVITY_E2 * s * s
    return np.asarray(earth.gravity_equator * s * c * (2.0 * k + GRAVITY_E2 * (1.0 + k * s * s) / w2) / np.sqrt(w2))


def rate_n(earth: Earth, latitude: Scalar) -> Array:
    """Return the Earth's rate omega_ie in n, rad/s, (..., 3). 000 (2.2.26)."""
    latitude = np.asarray(latitude, dtype=float)
    out = np.zeros((*latitude.shape, 3))
    out[..., 1] = earth.rate * np.cos(latitude)
    out[..., 2] = earth.rate * np.sin(latitude)
    return out


def transport_matrix(earth: Earth, latitude: Scalar, height: Scalar = 0.0) -> Array:
    """Return the matrix T (..., 3, 3) of the transport rate: omega_en = T v_n. 000 (2.2.27)."""
    R_M, R_N = radii(earth, latitude)
    height = np.asarray(height, dtype=float)
    out = np.zeros((*np.broadcast_shapes(np.shape(R_N), height.shape), 3, 3))
    out[..., 0, 1] = -1.0 / (R_M + height)
    out[..., 1, 0] = 1.0 / (R_N + height)
    out[..., 2, 0] = np.tan(latitude) / (R_N + height)
    return out


def ecef_to_enu(latitude: Scalar, longitude: Scalar) -> Array:
    """Return C_e^n (..., 3, 3). 000 (2.4.2) and (2.4.3), erratum 14.

    See docs/mathematics/frames.md#earth-to-local-level.
    """
    sL, cL = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    out = np.zeros((*np.broadcast_shapes(np.shape(sL), np.shape(sl)), 3, 3))
    out[..., 0, 0], out[..., 0, 1] = -sl, cl
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = -sL * cl, -sL * sl, cL
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = cL * cl, cL * sl, sL
    return out


def to_ecef(earth: Earth, pos: Array) -> Array:
    """Return the place (..., 3) in m, in axes fixed to the earth, of latitude rad, longitude rad and height m (..., 3)."""
    latitude, longitude, height = pos[..., 0], pos[..., 1], pos[..., 2]
    _, R_N = radii(earth, latitude)
    across = (R_N + height) * np.cos(latitude)
    along = (R_N * (1.0 - earth.e2) + height) * np.sin(latitude)
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), along], axis=-1)


@helper
def displaced(pos: Vector, at: Vector, metres: Vector, R_M: float, R_N: float) -> Vector:
    """Return the place ``metres`` E, N, U from ``pos``, with the radii R_M and R_N at the place ``at``."""
    _, c = sincos(at[0])
    return pos[0] + metres[1] / (R_M + at[2]), pos[1] + metres[0] / ((R_N + at[2]) * c), pos[2] + metres[2]


@kernel("(),(),(3),(3),(3)->(3)")
def _displaced(a: float, e2: float, pos: Array, at: Array, metres: Array, out: Array) -> None:
    R_M, R_N = radii_at(a, e2, at[0])
    put_vector(displaced(vector(pos), vector(at), vector(metres), R_M, R_N), out)


def displace(earth: Earth, pos: Array, offset: Array, at: Array | None = None) -> Array:
    """Return latitude, longitude and height (..., 3) of the point that lies ``offset`` metres E, N, U from ``pos``.

    The radii are those at ``at``, a place on the way, by default at ``pos``. The result is of first order: good for metres,
    not for kilometres.
    """
    place: Array = _displaced(earth.a, earth.e2, pos, pos if at is None else at, offset)
    return place


@helper
def metres_to(pos: Vector, place: Vector, R_M: float, R_N: float) -> Vector:
    """Return the metres E, N, U from ``pos`` to ``place``, the short way round, with the radii at ``pos``."""
    _, c = sincos(pos[0])
    return wrap(place[1] - pos[1]) * (R_N + pos[2]) * c, (place[0] - pos[0]) * (R_M + pos[2]), place[2] - pos[2]


@kernel("(),(),(3),(3)->(3)")
def _metres_to(a: float, e2: float, pos: Array, place: Array, out: Array) -> None:
    R_M, R_N = radii_at(a, e2, pos[0])
    put_vector(metres_to(vector(pos), vector(place), R_M, R_N), out)


def offset(earth: Earth, pos: Array, place: Array) -> Array:
    """Return the metres E, N, U (..., 3) from ``pos`` to ``place``, the short way round; undoes :func:`displace`."""
    metres: Array = _metres_to(earth.a, earth.e2, pos, place)
    return metres
