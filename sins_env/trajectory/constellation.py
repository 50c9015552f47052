"""A simple constellation of navigation satellites: circular orbits, as places and velocities in axes fixed to the earth.

Twenty-four satellites fly in six planes at the inclination and the radius of GPS, evenly spread, with a step of 15 deg from one
plane to the next. See docs/mathematics/aiding.md#ranges.
"""

from __future__ import annotations

import math

import numpy as np

from sins_env import earth
from sins_env.arrays import Array
from sins_env.units import DEG

PLANES, IN_PLANE = 6, 4
RADIUS_M = 26_560e3  #: radius of the orbits
INCLINATION = 55.0 * DEG
GM = 3.986004418e14  #: m^3/s^2, gravitational constant of the earth


def satellites(model: earth.Earth, t: Array) -> Array:
    """Return place in m and velocity in m/s of all satellites at the times t (...), s, in ECEF: (..., 24, 6)."""
    motion = math.sqrt(GM / RADIUS_M**3)
    number = np.arange(PLANES * IN_PLANE)
    plane = number // IN_PLANE
    t = np.asarray(t, dtype=float)[..., None]
    angle = motion * t + 2 * np.pi * (number % IN_PLANE) / IN_PLANE + 15.0 * DEG * plane
    node = 2 * np.pi * plane / PLANES - model.rate * t  # the earth turns below the planes
    c, s = np.cos(angle), np.sin(angle)
    to_ecef = np.array([[1.0, 0.0], [0.0, math.cos(INCLINATION)], [0.0, math.sin(INCLINATION)]])
    place = RADIUS_M * np.stack([c, s], axis=-1) @ to_ecef.T  # in axes of the node
    speed = RADIUS_M * motion * np.stack([-s, c], axis=-1) @ to_ecef.T
    c, s = np.cos(node), np.sin(node)

    def turned(a: Array) -> Array:
        return np.stack([c * a[..., 0] - s * a[..., 1], s * a[..., 0] + c * a[..., 1], a[..., 2]], axis=-1)

    place, speed = turned(place), turned(speed)
    speed[..., 0] += model.rate * place[..., 1]
    speed[..., 1] -= model.rate * place[..., 0]
    return np.concatenate([place, speed], axis=-1)


def up(model: earth.Earth, pos: Array, place: Array) -> Array:
    """Return the sine of the elevation (..., S) of satellites at ``place`` (..., S, 3) seen from ``pos`` (..., 3)."""
    away = place - earth.to_ecef(model, pos)[..., None, :]
    rows = earth.ecef_to_enu(pos[..., 0], pos[..., 1])[..., 2, :]
    return np.asarray((away @ rows[..., None])[..., 0] / np.linalg.norm(away, axis=-1))
