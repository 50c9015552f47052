"""What the numbers of columns say: the unit of time, increments or rates, units of force and of angular rate, axes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.recordings import column_units
from sins_env.units import DEG

GRAVITY = 9.81  #: m/s^2
EARTH_RATE = 7.292115e-5  #: rad/s
NEAR_GRAVITY = 0.06  #: largest relative difference of the mean specific force from gravity
NEAR_EARTH = (0.75, 1.3)  #: range of the rate at rest over the earth's
EXPLAINED = 0.6  #: least share of the turning of gravity that a unit of angular rate explains
LEAST_TURN = 2.0 * DEG  #: least turning of gravity, RMS over seconds, from which a unit is measured
UP_SHARE = 0.9  #: least share of gravity along one axis
MOST_STEP = 0.25  #: longest step between samples, s; the units of time are a factor of 1000 apart
ALONG = 0.7  #: least correlation of the forward axis with the change of speed
LEAST_CHANGE = 0.3  #: least change of speed, RMS, from which the forward axis is measured, m/s^2


class Unit(NamedTuple):
    """A unit that fits, and the measure that says so."""

    name: str
    why: str


def time_unit(step: float) -> str:
    """Return the unit of time that makes a step between samples at most a quarter of a second, and not a 4000th of one."""
    return next((name for name, value in column_units.TIME.items() if step * value <= MOST_STEP), "ns")


def seconds_means(values: Array, rate_hz: float) -> Array:
    """Return the means over seconds, (n, 3); over a hundred samples if no rate is known (NaN)."""
    return column_units.block_means(values, rate_hz if np.isfinite(rate_hz) else 100.0)


def force_units(force: Array, rate_hz: float) -> list[Unit]:
    """Return the units in which the size of the specific force is gravity's.

    Increments are those of a sample; they are not tried if no rate is known (NaN).
    """
    size = float(np.median(np.linalg.norm(seconds_means(force, rate_hz), axis=1)))
    found = []
    for name, unit in column_units.ACCEL.items():
        f = size * unit.si * (1.0 if unit.rate else rate_hz)
        if abs(f / GRAVITY - 1) < NEAR_GRAVITY:
            found.append(Unit(name, f"|f| is {f:.3f} m/s2"))
    return found


def rate_units(turn: Array, force: Array, rate_hz: float, increments: bool) -> list[Unit]:
    """Return the units in which the gyros turn as the earth does at rest, or as gravity does in the axes of the body."""
    found = []
    means, up = seconds_means(turn, rate_hz), seconds_means(force, rate_hz)
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    size = float(np.linalg.norm(np.median(means, axis=0)))
    spread = float(np.linalg.norm(1.4826 * np.median(np.abs(means - np.median(means, axis=0)), axis=0)))
    fit, share = _turning(means, up)
    for name, unit in column_units.GYRO.items():
        if unit.rate == increments:
            continue
        si = unit.si * (1.0 if unit.rate else rate_hz)
        low, high = NEAR_EARTH
        if low < size * si / EARTH_RATE < high and spread * si < EARTH_RATE:
            found.append(Unit(name, f"at rest |w| is {size * si * 206264.8:.2f} deg/h, the earth's is 15.04"))
        elif share > EXPLAINED and 0.8 < fit / si < 1.25:
            found.append(Unit(name, f"it explains {100 * share:.0f} % of how gravity turns in the axes of the body"))
    return found


def _turning(means: Array, up: Array) -> tuple[float, float]:
    """Return the factor from the values to rad/s that explains most of how gravity turns from second to second."""
    moved = np.diff(up, axis=0)
    if len(moved) < 10 or np.sqrt(np.mean(np.sum(moved * moved, axis=1))) < LEAST_TURN:
        return 0.0, 0.0
    told = -np.cross(0.5 * (means[1:] + means[:-1]), 0.5 * (up[1:] + up[:-1]))
    power = float(np.sum(told * told))
    if power == 0.0:
        return 0.0, 0.0
    fit = float(np.sum(told * moved)) / power
    return fit, 1.0 - float(np.sum((moved - fit * told) ** 2)) / float(np.sum(moved * moved))


def up_axis(force: Array, rate_hz: float) -> tuple[str, float]:
    """Return the axis that points up, such as "+z", and the share of gravity along it."""
    mean = np.median(seconds_means(force, rate_hz), axis=0)
    axis = int(np.argmax(np.abs(mean)))
    return f"{'+-'[int(mean[axis] < 0)]}{'xyz'[axis]}", float(abs(mean[axis]) / np.linalg.norm(mean))


def forward_axis(t: Array, force: Array, fix_t: Array, speed: Array, up: str) -> tuple[str, float] | None:
    """Return the axis whose specific force follows the change of speed, and their correlation; None if it changes too little."""
    within = (t[0] <= fix_t) & (fix_t <= t[-1])
    fix_t, speed = fix_t[within], speed[within]
    if len(fix_t) < 10:
        return None
    change = np.diff(speed) / np.diff(fix_t)
    if np.sqrt(np.mean(change**2)) < LEAST_CHANGE:
        return None
    sums = np.vstack([np.zeros(3), np.cumsum(force[1:] * np.diff(t)[:, None], axis=0)])
    at = np.column_stack([np.interp(fix_t, t, column) for column in sums.T])
    means = np.diff(at, axis=0) / np.diff(fix_t)[:, None]
    best = max(
        ((abs(c), f"{'+-'[int(c < 0)]}{axis}") for axis, column in zip("xyz", means.T, strict=True) if axis != up[1]
         for c in [float(np.corrcoef(column, change)[0, 1]) if np.ptp(column) > 0 else 0.0]),
    )  # fmt: skip
    return (best[1], best[0]) if best[0] > ALONG else None


def letters(up: str, forward: str) -> str:
    """Return the axes, such as "FRD", of which one points up and one forward."""
    vector = {"x": np.array([1, 0, 0]), "y": np.array([0, 1, 0]), "z": np.array([0, 0, 1])}
    u, f = (vector[axis[1]] * (-1 if axis[0] == "-" else 1) for axis in (up, forward))
    right = np.cross(f, u)
    out = ""
    for i in range(3):
        for v, (plus, minus) in ((right, "RL"), (f, "FB"), (u, "UD")):
            if v[i]:
                out += plus if v[i] > 0 else minus
    return out
