"""Earth: radii of curvature, normal gravity, rotation and transport rate. docs/mathematics/frames.md#earth-model.

Every function is batch first and takes an :class:`Earth`; truth and estimator must use the same one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import unknown

Scalar = float | Array

MAX_LATITUDE = math.radians(89.9)  #: the local-level frame is singular at the poles
FREE_AIR = 3.086e-6  #: 1/s^2, decrease of gravity with height
GRAVITY_E2 = 0.00669437999014  #: WGS-84's, whatever the ellipsoid: the constants of the gravity formula belong together


@dataclass(frozen=True)
class Earth:
    """An ellipsoid. ``gravity_equator`` and ``somigliana`` belong to the WGS-84 normal gravity formula."""

    a: float  #: m, semi-major axis
    f: float  #: flattening
    rate: float = 7.292115e-5  #: rad/s
    gravity_equator: float = 9.7803253359  #: m/s^2
    somigliana: float = 0.00193185265241

    @property
    def e2(self) -> float:
        return self.f * (2.0 - self.f)


EARTHS = {"wgs84": Earth(6378137.0, 1 / 298.257223563), "thesis": Earth(6378096.0, 1 / 295.0)}  # 000 section 2.2.2


def get(name: str) -> Earth:
    """The constants by name, ``wgs84`` or ``thesis``.

    Raises:
        ValueError: an unknown name.
    """
    if name not in EARTHS:
        raise unknown("earth model", name, EARTHS)
    return EARTHS[name]


def check_latitude(latitude: float) -> float:
    """The latitude in rad, if the local-level frame exists there.

    Raises:
        ValueError: beyond +-89.9 deg, or not finite.
    """
    if not abs(latitude) <= MAX_LATITUDE:
        raise ValueError(f"latitude {math.degrees(latitude):.6g} deg; allowed: -89.9 to 89.9 deg")
    return latitude


def radii(earth: Earth, latitude: Scalar) -> tuple[Array, Array]:
    """Meridian radius R_M (goes with V_N) and prime-vertical radius R_N (goes with V_E), m.
    docs/mathematics/frames.md#earth-model."""
    w2 = 1.0 - earth.e2 * np.sin(latitude) ** 2
    w = np.sqrt(w2)
    return earth.a * (1.0 - earth.e2) / (w2 * w), earth.a / w


def gravity(earth: Earth, latitude: Scalar, height: Scalar = 0.0) -> Array:
    """Normal gravity, m/s^2: Somigliana, with the free-air gradient outside the bracket (erratum 2). (2.2.25)."""
    s2 = np.sin(latitude) ** 2
    surface = earth.gravity_equator * (1.0 + earth.somigliana * s2) / np.sqrt(1.0 - GRAVITY_E2 * s2)
    return surface - FREE_AIR * np.asarray(height)


def gravity_slope(earth: Earth, latitude: Scalar) -> Array:
    """Derivative of normal gravity along the latitude, m/s^2 per rad."""
    s, c, k = np.sin(latitude), np.cos(latitude), earth.somigliana
    w2 = 1.0 - GRAVITY_E2 * s * s
    return np.asarray(earth.gravity_equator * s * c * (2.0 * k + GRAVITY_E2 * (1.0 + k * s * s) / w2) / np.sqrt(w2))


def rate_n(earth: Earth, latitude: Scalar) -> Array:
    """omega_ie in n: (..., 3) rad/s. (2.2.26)."""
    latitude = np.asarray(latitude, dtype=float)
    out = np.zeros((*latitude.shape, 3))
    out[..., 1] = earth.rate * np.cos(latitude)
    out[..., 2] = earth.rate * np.sin(latitude)
    return out


def transport_matrix(earth: Earth, latitude: Scalar, height: Scalar = 0.0) -> Array:
    """The matrix T (..., 3, 3) with omega_en = T v_n. (2.2.27)."""
    R_M, R_N = radii(earth, latitude)
    height = np.asarray(height, dtype=float)
    out = np.zeros((*np.broadcast_shapes(np.shape(R_N), height.shape), 3, 3))
    out[..., 0, 1] = -1.0 / (R_M + height)
    out[..., 1, 0] = 1.0 / (R_N + height)
    out[..., 2, 0] = np.tan(latitude) / (R_N + height)
    return out


def ecef_to_enu(latitude: Scalar, longitude: Scalar) -> Array:
    """C_e^n (..., 3, 3). docs/mathematics/frames.md#earth-to-local-level (erratum 14)."""
    sL, cL = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    out = np.zeros((*np.broadcast_shapes(np.shape(sL), np.shape(sl)), 3, 3))
    out[..., 0, 0], out[..., 0, 1] = -sl, cl
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = -sL * cl, -sL * sl, cL
    out[..., 2, 0], out[..., 2, 1], out[..., 2, 2] = cL * cl, cL * sl, sL
    return out


def displace(earth: Earth, pos: Array, offset: Array, at: Array | None = None) -> Array:
    """Latitude, longitude, height (..., 3) of a point ``offset`` metres E, N, U away; the radii are those ``at`` a place
    on the way, by default at ``pos`` (first order: for metres, not kilometres)."""
    where = pos if at is None else at
    R_M, R_N = radii(earth, where[..., 0])
    out = np.empty(np.broadcast_shapes(pos.shape, offset.shape))
    out[..., 0] = pos[..., 0] + offset[..., 1] / (R_M + where[..., 2])
    out[..., 1] = pos[..., 1] + offset[..., 0] / ((R_N + where[..., 2]) * np.cos(where[..., 0]))
    out[..., 2] = pos[..., 2] + offset[..., 2]
    return out


def offset(earth: Earth, pos: Array, place: Array) -> Array:
    """Metres E, N, U (..., 3) from ``pos`` to ``place``, the short way round; undoes :func:`displace`."""
    R_M, R_N = radii(earth, pos[..., 0])
    out = place - pos
    east = (out[..., 1] + np.pi) % (2 * np.pi) - np.pi
    out[..., 1] = out[..., 0] * (R_M + pos[..., 2])
    out[..., 0] = east * (R_N + pos[..., 2]) * np.cos(pos[..., 0])
    return out
