"""GPS time, UTC and Unix time, with their leap seconds. Inside there is one scale, seconds of GPS time since 1980-01-06."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np

from sins_env import checks
from sins_env.arrays import Array
from sins_env.recordings.text.dates import FORMS, calendar_seconds

WEEK_S, DAY_S = 604_800.0, 86_400.0
EPOCH = datetime(1980, 1, 6)  #: origin of GPS time
UNIX_S = 315_964_800.0  #: Unix time of that origin
#: Days from which on UTC is one second more behind GPS time (IERS Bulletin C). None was announced after 2017.
LEAP_DAYS = (
    "1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01", "1992-07-01",
    "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01", "2009-01-01", "2012-07-01",
    "2015-07-01", "2017-01-01",
)  # fmt: skip
_LEAP_UTC = calendar_seconds([f"{day}T00:00:00" for day in LEAP_DAYS])
_LEAP_GPS = _LEAP_UTC + np.arange(1, len(LEAP_DAYS) + 1)


def from_utc(t: Array) -> Array:
    """Return GPS time of UTC, both in s since 1980-01-06; UTC is counted without its leap seconds."""
    return t + np.searchsorted(_LEAP_UTC, t, side="right")


def to_utc(t: Array) -> Array:
    """Return UTC, counted without its leap seconds, of GPS time, both in s since 1980-01-06."""
    return t - np.searchsorted(_LEAP_GPS, t, side="right")


def instant(text: str) -> float:
    """Return GPS time, s since 1980-01-06, of a date in ISO 8601, which is UTC.

    Raises:
        ValueError: no date.
    """
    calendar = calendar_seconds([text])
    if not np.isfinite(calendar[0]):
        raise checks.refused("time", text, FORMS)
    return float(from_utc(calendar)[0])


def date_of(t: float) -> str:
    """Write GPS time, s since 1980-01-06, as a date of UTC to the millisecond."""
    utc = EPOCH + timedelta(seconds=round(float(to_utc(np.array(t))), 3))
    return f"{utc.isoformat(timespec='milliseconds')}Z"
