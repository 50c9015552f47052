"""Time scales: GPS time, UTC and Unix time, with weeks, dates and leap seconds. Inside there is one scale, GPS time.

Absolute times are seconds of GPS time since 1980-01-06 00:00. GPS time has no leap seconds; UTC and Unix time do.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import numpy as np

from sins_env import checks
from sins_env.arrays import Array

SCALES = ("gps", "utc", "unix")  #: names of time scales that a mapping may tell
WEEK_S, DAY_S = 604_800.0, 86_400.0
EPOCH = datetime(1980, 1, 6)  #: origin of GPS time
UNIX_EPOCH_S = 315_964_800  #: Unix time of that origin
FIRST_WEEK, LAST_WEEK = 1, 5217  #: weeks that a column of weeks may hold, until 2079
#: Days from which on UTC is one second more behind GPS time (IERS Bulletin C). None was announced after 2017.
LEAP_DAYS = (
    "1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01", "1992-07-01",
    "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01", "2009-01-01", "2012-07-01",
    "2015-07-01", "2017-01-01",
)  # fmt: skip
_LEAP_UTC = np.array([(datetime.fromisoformat(day) - EPOCH).total_seconds() for day in LEAP_DAYS])
_LEAP_GPS = _LEAP_UTC + np.arange(1, len(LEAP_DAYS) + 1)
DATES = "dates such as 2026-06-01T10:00:00.010Z or 2026/06/01 10:00:00.010"


def from_utc(t: Array) -> Array:
    """Return GPS time of UTC, both in s since 1980-01-06, UTC counted without its leap seconds."""
    return t + np.searchsorted(_LEAP_UTC, t, side="right")


def to_utc(t: Array) -> Array:
    """Return UTC, counted without its leap seconds, of GPS time, both in s since 1980-01-06."""
    return t - np.searchsorted(_LEAP_GPS, t, side="right")


def from_unix(t: Array) -> Array:
    """Return GPS time, s since 1980-01-06, of Unix time, s."""
    return from_utc(t - UNIX_EPOCH_S)


def from_week(week: Array, second: Array) -> Array:
    """Return GPS time, s since 1980-01-06, of full weeks (no rollover) and seconds of the week.

    Raises:
        ValueError: weeks that are none; a ten-bit week is offered in full.
    """
    bad = np.flatnonzero((week != np.floor(week)) | (week < FIRST_WEEK) | (week > LAST_WEEK))
    if len(bad):
        raise checks.refused("GPS week", float(week[bad[0]]), f"whole numbers from {FIRST_WEEK} to {LAST_WEEK}")
    return week * WEEK_S + second


def from_numbers(t: Array, scale: str | None) -> Array:
    """Return seconds of a told scale as GPS time; without a scale they stay as they are.

    Raises:
        ValueError: an unknown scale.
    """
    if scale is None:
        return t
    checks.choice("time scale", scale, SCALES)
    return t if scale == "gps" else from_unix(t) if scale == "unix" else from_utc(t)


def from_dates(texts: Sequence[str], scale: str | None = None) -> Array:
    """Return GPS time, s since 1980-01-06, of dates (n,) in ISO 8601, or with slashes and a blank as receivers write them.

    A zone in the text, such as Z or +02:00, makes it UTC. Without one the date is in ``scale``, UTC by default.

    Raises:
        ValueError: no date; the text says which of them, counted from 0.
    """
    checks.choice("time scale of dates", scale or "utc", ("gps", "utc"))
    found = np.empty(len(texts))
    for i, text in enumerate(texts):
        found[i] = _date(text, scale, i)
    return found


def _date(text: str, scale: str | None, i: int) -> float:
    body = text.strip().strip('"').replace("/", "-")
    leap = 1 if ":60" in body[16:19] else 0  # the leap second itself, which Python's calendar does not have
    body = body.replace(":60", ":59", 1) if leap else body
    try:
        day = datetime.fromisoformat(body)
    except ValueError:
        raise ValueError(f"time {i} is {checks.shown(text)}; allowed: {DATES}") from None
    zone = day.utcoffset()
    since = day.replace(tzinfo=None) - EPOCH - (zone or timedelta(0))
    t = since.days * DAY_S + since.seconds + (since.microseconds * 1e-6)
    if zone is None and scale == "gps":
        return t + leap
    return float(from_utc(np.array(t))) + leap


def from_calendar(parts: Array, scale: str | None = None) -> Array:
    """Return GPS time, s since 1980-01-06, of numbers (n, 6): year, month, day, hour, minute, second.

    Raises:
        ValueError: numbers that are no date.
    """
    checks.choice("time scale of dates", scale or "utc", ("gps", "utc"))
    days = np.empty(len(parts))
    known: dict[tuple[int, ...], float] = {}
    for i, row in enumerate(parts[:, :3].astype(int).tolist()):
        key = tuple(row)
        if key not in known:
            try:
                known[key] = float((datetime(*key) - EPOCH).days)
            except ValueError:
                raise ValueError(f"time {i} is {row}; allowed: year, month, day, hour, minute, second") from None
        days[i] = known[key]
    t = days * DAY_S + parts[:, 3:] @ [3600.0, 60.0, 1.0]
    return t if scale == "gps" else from_utc(t)


def instant(text: str) -> float:
    """Return GPS time, s since 1980-01-06, of one date in ISO 8601, which is UTC without a zone.

    Raises:
        ValueError: no date.
    """
    return float(from_dates([text])[0])


def date_of(t: float) -> str:
    """Write GPS time, s since 1980-01-06, as a date of UTC to the millisecond."""
    utc = round(float(to_utc(np.array(t))), 3)
    day = datetime.fromtimestamp(0, UTC).replace(tzinfo=None) + timedelta(seconds=utc + UNIX_EPOCH_S)
    return f"{day.isoformat(timespec='milliseconds')}Z"
