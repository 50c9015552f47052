"""Dates in text: ISO 8601 and other calendar forms as seconds since the start of GPS time, 1980-01-06."""

from __future__ import annotations

import re
from datetime import datetime, timedelta

import numpy as np

from sins_env.arrays import Array

EPOCH = np.datetime64("1980-01-06T00:00:00", "ns")
FORMS = "a date with a time, such as 2026-06-01T10:00:00.010Z, 2026/06/01 10:00:00.01 or 01.06.2026 10:00:00"
_YEARS = ("1980", "2200")  #: range of years
_OFFSET = re.compile(r"([+-]\d\d):?(\d\d)$")
_GERMAN = re.compile(r"(\d\d?)\.(\d\d?)\.(\d{4})")
_COMPACT = re.compile(r"^(\d{4})(\d\d)(\d\d)[T ]?(\d\d)(\d\d)(\d\d)")


def is_date(text: str) -> bool:
    """Return whether a text is a date with a time."""
    return bool(np.isfinite(calendar_seconds([text])[0]))


def calendar_seconds(texts: list[str]) -> Array:
    """Return the calendar seconds since 1980-01-06T00:00:00 of dates, (n,); NaN for a text that is none.

    No leap second is counted: the dates keep the time scale in which they are written. An offset such as +02:00 is taken off.
    """
    try:
        return _plain_seconds([text.rstrip("Z").replace("/", "-") for text in texts])
    except ValueError:
        return np.array([_one(text.strip()) for text in texts], dtype=float)


def _plain_seconds(texts: list[str]) -> Array:
    """Read dates that differ from ISO 8601 in nothing but a space for the T.

    Raises:
        ValueError: another form.
    """
    if not (_YEARS[0] <= min(texts)[:4] and max(texts)[:4] < _YEARS[1] and all(":" in text for text in texts)):
        raise ValueError("no date of these years")
    if any(_OFFSET.search(text) for text in (texts[0], texts[-1], min(texts, key=len), max(texts, key=len))):
        raise ValueError("an offset from UTC")
    return np.asarray((np.array(texts, dtype="datetime64[ns]") - EPOCH).astype(np.int64) / 1e9)


def _one(text: str) -> float:
    text = text.rstrip("Z").replace("/", "-").replace(",", ".")
    shift = _OFFSET.search(text) if ":" in text or "T" in text else None
    if shift:
        text = text[: shift.start()]
    text = _GERMAN.sub(lambda m: f"{m[3]}-{m[2]:0>2}-{m[1]:0>2}", text)
    text = _COMPACT.sub(r"\1-\2-\3T\4:\5:\6", text)
    text = re.sub(r"^(\d{4})-(\d)-", r"\1-0\2-", text)
    text = re.sub(r"^(\d{4}-\d\d)-(\d)(?=\D)", r"\1-0\2", text)
    text = re.sub(r"(?<=\d)[T ](?=\d:)", "T0", text)
    try:
        seconds = float(_plain_seconds([text])[0])
    except ValueError:
        return float("nan")
    return seconds if shift is None else seconds - int(shift[1]) * 3600 - int(f"{shift[1][0]}{shift[2]}") * 60


def seconds_of_parts(parts: Array) -> Array:
    """Return the calendar seconds since 1980-01-06T00:00:00 of year, month, day, hour, minute and second, (n, 6)."""
    start = datetime(1980, 1, 6)
    whole = np.rint(parts[:, :3]).astype(np.int64)
    days = np.full(len(parts), np.nan)
    for date in np.unique(whole, axis=0):
        year, month, of_month = (int(x) for x in date)
        try:
            day = (datetime(year, month, of_month) - start) / timedelta(days=1)
        except (ValueError, OverflowError):
            continue
        days[(whole == date).all(axis=1)] = day
    return days * 86400.0 + parts[:, 3:] @ np.array([3600.0, 60.0, 1.0])
