"""Times as files write them, in the one form in which they are compared: seconds, and the scale that they count."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.recordings.recording import seconds

WEEK_S = 604_800.0  #: seconds of a GPS week
MOST_WEEK = 9_999  #: largest number of a GPS week
UNIX_S = 315_964_800.0  #: Unix time at the start of GPS time, 1980-01-06T00:00:00 UTC
SCALES = ("GPS", "UTC", "Unix")  #: scales that a mapping may name


class Times(NamedTuple):
    """Times of a file.

    With a scale they count the calendar seconds since 1980-01-06T00:00:00 in it, without leap seconds.
    """

    t: Array  #: (n,) times, s
    scale: str | None = (
        None  #: "GPS" or "UTC"; None for a clock of its own, such as seconds since the start or of a week
    )


def told(t: Array, scale: str | None) -> Times:
    """Return times in the scale that a mapping names.

    Raises:
        ValueError: a scale of no such name.
    """
    if scale is not None and scale not in SCALES:
        raise unknown("scale of time", scale, SCALES)
    return Times(t - UNIX_S, "UTC") if scale == "Unix" else Times(t, scale)


def on_scale_of(times: Times, imu: Times, path: Path, whose: str) -> Array:
    """Return times on the scale of the IMU, (n,), s.

    GPS times go with an IMU that counts the seconds of the week, and the other way round.

    Raises:
        ValueError: scales between which nothing is known.
    """
    if times.scale == imu.scale:
        return times.t
    if times.scale == "GPS" and imu.scale is None and _of_week(imu.t):
        return times.t - WEEK_S * np.floor(times.t[0] / WEEK_S)
    if times.scale is None and imu.scale == "GPS" and _of_week(times.t):
        return times.t + WEEK_S * np.floor(imu.t[0] / WEEK_S)
    text = f"{whose} are in {_named(times)}, the IMU in {_named(imu)}"
    raise ValueError(f'{path}: {text}; allowed: one scale, or the one that they share as "scale" of both times')


def _of_week(t: Array) -> bool:
    return bool(len(t) and t[0] >= 0 and t[-1] <= 2 * WEEK_S)


def _named(times: Times) -> str:
    return times.scale or f"a clock of its own from {seconds(float(times.t[0]))} s"
