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
