"""Units of recorded files, and a check that the values can come from an IMU on the Earth."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.units import ARCSEC, DEG, DEG_PER_H, G0


class Unit(NamedTuple):
    """A unit of increments or rates."""

    si: float  #: its value in SI
    rate: bool = False  #: whether it is per second, so that values must be integrated over the sample


GYRO = {
    "rad": Unit(1.0),
    "deg": Unit(DEG),
    "arcsec": Unit(ARCSEC),
    "rad/s": Unit(1.0, True),
    "deg/s": Unit(DEG, True),
    "deg/h": Unit(DEG_PER_H, True),
}
ACCEL = {
    "m/s": Unit(1.0),
    "m/s2": Unit(1.0, True),
    "g": Unit(G0, True),
    "mg": Unit(1e-3 * G0, True),
}
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLE = {"deg": DEG, "rad": 1.0}

#: Words that files write for units, without spaces, brackets and signs of multiplication, in lower case.
_WRITTEN = {
    "rad/s": ("rads^-1", "rads-1", "rad/sec", "rps", "radians/s", "rad.s-1"),
    "deg/s": ("degs^-1", "degs-1", "deg/sec", "dps", "°/s", "degrees/s", "degree/s", "deg.s-1"),
    "deg/h": ("deg/hr", "°/h", "deg/hour"),
    "rad": ("radians", "radian"),
    "deg": ("degrees", "degree", "°"),
    "m/s2": ("m/s^2", "ms^-2", "ms-2", "m/s/s", "m/s²", "m/sec^2", "m/s**2", "m.s-2"),
    "m/s": ("ms^-1", "ms-1", "m/sec", "m.s-1"),
    "mg": ("milli-g", "millig"),
    "s": ("sec", "second", "seconds"),
    "ms": ("msec", "millisecond", "milliseconds"),
    "us": ("µs", "usec", "microsecond", "microseconds"),
    "ns": ("nsec", "nanosecond", "nanoseconds"),
}
_BRACKETS = re.compile(r"[\[({]([^\])}]+)[\])}]\s*$")
_WORDS = {word: unit for unit, words in _WRITTEN.items() for word in words}

FORCE_RANGE = (5.0, 20.0)  #: range of the median over seconds of specific force, m/s^2
FREE_MOST = 3.0  #: m/s^2, specific force below which gravity was taken out
MOST_RATE = 2.0 * math.pi  #: limit of the median over seconds of angular rate, rad/s
MOST_ANGLE = math.pi  #: limit of the angle in one sample, rad


def written(text: str) -> str | None:
    """Return the unit that a text is, or that it has in brackets, such as "rad/s" for "w_x [rad s^-1]"; None without one."""
    inner = _BRACKETS.search(text)
    word = "".join((inner[1] if inner else text).split()).replace("*", "").lower()
    if word in _WORDS:
        return _WORDS[word]
    return word if word in GYRO or word in ACCEL or word in TIME else None


def check_plausible(path: Path | str, rate_hz: float, dtheta: Array, dvel: Array) -> None:
    """Refuse increments (N, 3), rad and m/s, that no IMU on the Earth measures; missing samples are NaN.

    Specific force is near 9.8 m/s^2 but for seconds at a time, so that a wrong unit of the accelerometers always shows.
    A wrong unit of the gyros shows if angles come out too large, but not if they come out too small.

    Raises:
        ValueError: impossible increments; the error says which mistake would explain them.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        _check(path, rate_hz, dtheta, dvel)


def _check(path: Path | str, rate_hz: float, dtheta: Array, dvel: Array) -> None:
    per_second = block_means(dvel, rate_hz) * rate_hz
    force = float(np.median(np.linalg.norm(per_second, axis=1)))
    if not FORCE_RANGE[0] <= force <= FORCE_RANGE[1]:
        raise ValueError(
            f"{path}: specific force is {force:.4g} m/s^2 (median over seconds); allowed: "
            f"{FORCE_RANGE[0]:g} to {FORCE_RANGE[1]:g}.{_guess(force / 9.8, rate_hz)}"
        )
    size = np.sqrt(np.nanmax(np.einsum("ij,ij->i", dtheta, dtheta)))
    rate = float(np.median(np.linalg.norm(block_means(dtheta, rate_hz), axis=1))) * rate_hz
    if size > MOST_ANGLE or rate > MOST_RATE:
        at = int(np.nanargmax(np.sum(dtheta * dtheta, axis=1)))
        raise ValueError(
            f"{path}: turns by up to {size:.4g} rad in one sample (sample {at}) and by {rate:.4g} rad/s (median); "
            f"allowed: {MOST_ANGLE:.3g} rad and {MOST_RATE:.3g} rad/s. Degrees given as radians, or rates as increments?"
        )


def block_means(increments: Array, rate_hz: float, block_s: float = 1.0) -> Array:
    """Return means per sample over blocks of about ``block_s`` s, (B, n); blocks with missing samples are left out.

    A remainder at the end is left out, too. A recording shorter than a block is one block. If every block has a gap, the
    samples that are there make one block.
    """
    size = min(max(round(block_s * rate_hz), 1), len(increments))
    blocks = increments[: len(increments) // size * size].reshape(-1, size, increments.shape[1]).mean(axis=1)
    whole = blocks[np.isfinite(blocks[:, 0])]
    return whole if len(whole) else np.nanmean(increments, axis=0, keepdims=True)


def _guess(ratio: float, rate_hz: float) -> str:
    """Return the mistake that would explain a specific force of ``ratio`` times gravity."""
    mistakes = {
        "g given as m/s^2": 1 / G0,
        "m/s^2 given as g": G0,
        "mg given as m/s^2": 1000 / G0,
        "g given as mg": 1e-3,
        "mg given as g": 1e3,
        "increments (m/s) given as rates (m/s^2)": 1 / rate_hz,
        "rates (m/s^2) given as increments (m/s)": rate_hz,
        "rates in g given as increments in m/s": rate_hz / G0,
    }
    if not math.isfinite(ratio):
        return " Wrong columns?"
    if ratio <= 0:
        return " Nothing but zeros?"
    near = min(mistakes, key=lambda name: abs(math.log(ratio / mistakes[name])))
    if abs(math.log(ratio / mistakes[near])) < 0.2:
        return f" Looks like {near}"
    free = ", acceleration without gravity (free or linear acceleration)" if ratio * G0 < FREE_MOST else ""
    return f" Wrong unit{free}, or wrong columns?"
