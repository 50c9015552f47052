"""Units of datasheets in SI."""

from __future__ import annotations

import math

G0 = 9.80665  #: m/s^2, the "g" of sensor specifications
DEG = math.pi / 180.0
ARCSEC = DEG / 3600.0
DEG_PER_H = DEG / 3600.0  #: deg/h in rad/s
DEG_PER_SQRT_H = DEG / 60.0  #: deg/sqrt(h) in rad/sqrt(s)
UG = 1e-6 * G0  #: micro-g in m/s^2, and micro-g per sqrt(Hz) in m/s per sqrt(s)
PPM = 1e-6
KMH = 1.0 / 3.6  #: km/h in m/s
KNOT = 1852.0 / 3600.0  #: kn in m/s

_HOUR = 3600.0

#: Units that may end the name of a setting: what is measured, and the unit in SI. The names of fields end with one of them.
UNITS: dict[str, tuple[str, float]] = {
    # rad/sqrt(s); the density rad/s/sqrt(Hz) of white noise is the same number
    "deg_sqrt_h": ("angle random walk", DEG_PER_SQRT_H),
    "deg_s_sqrt_hz": ("angle random walk", DEG),
    "mdeg_s_sqrt_hz": ("angle random walk", 1e-3 * DEG),
    "deg_h_sqrt_hz": ("angle random walk", DEG_PER_H),
    "rad_s_sqrt_hz": ("angle random walk", 1.0),
    "rad_sqrt_s": ("angle random walk", 1.0),
    # m/s/sqrt(s), likewise
    "ug_sqrt_hz": ("velocity random walk", UG),
    "mg_sqrt_hz": ("velocity random walk", 1e3 * UG),
    "mps_sqrt_h": ("velocity random walk", 1.0 / 60.0),
    "mps_sqrt_s": ("velocity random walk", 1.0),
    "mps2_sqrt_hz": ("velocity random walk", 1.0),
    # rad/s/sqrt(s), a bias that walks
    "deg_h_sqrt_h": ("rate random walk", DEG_PER_H / 60.0),
    "rad_s_sqrt_s": ("rate random walk", 1.0),
    "rad_s2_sqrt_hz": ("rate random walk", 1.0),
    # m/s^2/sqrt(s)
    "ug_sqrt_h": ("acceleration random walk", UG / 60.0),
    "mps2_sqrt_s": ("acceleration random walk", 1.0),
    "mps3_sqrt_hz": ("acceleration random walk", 1.0),
    "deg_h": ("rate", DEG_PER_H),
    "deg_s": ("rate", DEG),
    "mdeg_s": ("rate", 1e-3 * DEG),
    "rad_s": ("rate", 1.0),
    "ug": ("acceleration", UG),
    "mg": ("acceleration", 1e3 * UG),
    "mps2": ("acceleration", 1.0),
    "arcsec": ("angle", ARCSEC),
    "arcmin": ("angle", 60.0 * ARCSEC),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", DEG),
    "rad": ("angle", 1.0),
    "mps": ("speed", 1.0),
    "cm_s": ("speed", 1e-2),
    "mm_s": ("speed", 1e-3),
    "km_h": ("speed", KMH),
    "kn": ("speed", KNOT),
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "ppm": ("ratio", PPM),
    "percent": ("ratio", 1e-2),
    "s": ("time", 1.0),
    "min": ("time", 60.0),
    "h": ("time", _HOUR),
    "ut": ("magnetic field", 1e-6),
    "nt": ("magnetic field", 1e-9),
    "mgauss": ("magnetic field", 1e-7),
}
