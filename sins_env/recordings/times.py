"""Times as files write them, in the one form in which they are compared: seconds, and the scale that they count."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.recordings.recording import seconds
from sins_env.recordings.stamps.scales import DAY_S, UNIX_S, WEEK_S, from_utc

MOST_WEEK = 9_999  #: largest number of a GPS week
SCALES = ("GPS", "UTC", "Unix")  #: scales that a mapping may name


class Times(NamedTuple):
    """Times of a file. With a scale they are seconds of GPS time since 1980-01-06T00:00:00, whatever scale it was written in."""

    t: Array  #: (n,) times, s
    scale: str | None = None  #: "GPS"; None for a clock of its own, such as seconds since the start or of a week


def told(t: Array, scale: str | None) -> Times:
    """Return times in the scale that a mapping names; UTC and Unix time become GPS time, with their leap seconds.

    UTC is counted as its calendar does, in s since 1980-01-06T00:00:00, and Unix time since 1970.

    Raises:
        ValueError: a scale of no such name.
    """
    if scale is None:
        return Times(t)
    if scale not in SCALES:
        raise unknown("scale of time", scale, SCALES)
    return Times(t if scale == "GPS" else from_utc(t - UNIX_S if scale == "Unix" else t), "GPS")


def on_scale_of(times: Times, imu: Times, path: Path, whose: str) -> Array:
    """Return times on the scale of the IMU, (n,), s.

    GPS times go with an IMU that counts the seconds of the week, and the other way round. If both
    count the seconds of a week or a day, one may have begun again before the other.

    Raises:
        ValueError: scales between which nothing is known.
    """
    if times.scale == imu.scale:
        shifts = (0.0, -WEEK_S, WEEK_S, -DAY_S, DAY_S) if imu.scale is None and _of_week(imu.t) else (0.0,)
        meets = (s for s in shifts if times.t[-1] + s > imu.t[0] and times.t[0] + s <= imu.t[-1])
        return times.t + next(meets, 0.0)
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
