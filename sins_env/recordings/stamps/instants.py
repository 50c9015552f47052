"""Moments that a user names, on the clock of a recording."""

from __future__ import annotations

from sins_env import checks
from sins_env.recordings.recording import Recording
from sins_env.recordings.stamps.scales import date_of, instant

ALLOWED = "seconds on the recording's clock, +SECONDS from its start, or a date of UTC such as 2026-06-01T10:00:00Z"


def on_clock(recording: Recording, given: float | str) -> float:
    """Return a moment on the clock of the recording, s.

    A number, also in text, is on the clock already. ``+60`` counts from the start of the recording. A date is UTC.

    Raises:
        ValueError: a text of another form, or a date for a recording whose clock is not GPS time.
    """
    if not isinstance(given, str):
        return float(given)
    text = given.strip()
    try:
        value = float(text)
    except ValueError:
        if recording.scale != "GPS":
            instant(text)  # what is no date is told first
            allowed = 'seconds, +SECONDS, or times in the mapping with a "scale" (GPS, UTC, Unix), a "week" or dates'
            raise ValueError(
                f"start = {checks.shown(given)}, and the clock of {recording.name} has no date; allowed: {allowed}"
            ) from None
        return instant(text)
    return recording.t0 + value if text.startswith("+") else value


def told_time(recording: Recording) -> str:
    """Write the scale of the times of a recording, with the date of its start if it is known."""
    if recording.scale != "GPS":
        return "a clock of its own"
    return f"GPS time since 1980-01-06, from {date_of(recording.t0)} UTC"
