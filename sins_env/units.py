"""SI values of the units in which datasheets state sensors."""

from __future__ import annotations

import math

G0 = 9.80665  #: m/s^2, the "g" of sensor specifications
DEG = math.pi / 180.0
ARCSEC = DEG / 3600.0
DEG_PER_H = DEG / 3600.0  #: rad/s
DEG_PER_SQRT_H = DEG / 60.0  #: rad/sqrt(s)
UG = 1e-6 * G0  #: m/s^2, and m/s/sqrt(s) for micro-g per sqrt(Hz)
PPM = 1e-6
