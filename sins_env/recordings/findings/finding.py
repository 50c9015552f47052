"""What a check of a recording says: its name, the measured value beside its limit, the time span, and what explains it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from sins_env.recordings.recording import Recording, seconds

#: Names of the findings that refuse a recording, which ``accept`` takes.
REFUSING = (
    "null_fixes",
    "held_fixes",
    "positions_and_velocities",
    "hung_sensor",
    "earth_rate_at_rest",
    "clock_offset",
    "axes",
    "reference_attitude",
)


class Finding(NamedTuple):
    """One thing that is wrong or doubtful in a recording."""

    name: str  #: name of the check, which ``accept`` takes
    value: float  #: measured value
    limit: float  #: limit that the value has passed
    unit: str  #: unit of both; empty for numbers without one
    span_s: tuple[float, float]  #: first and last time that it concerns, s on the recording's clock
    text: str  #: what was found, and what would explain it
    wrong: bool = True  #: whether results would be wrong; otherwise it is a warning

    def __str__(self) -> str:
        """Return the finding in one line."""
        unit = f" {self.unit}" if self.unit else ""
        span = f"{seconds(self.span_s[0])} to {seconds(self.span_s[1])} s"
        return f"{self.name}: {self.text} ({self.value:.4g}{unit}, limit {self.limit:.4g}{unit}; {span})"


Check = Callable[[Recording], Iterator[Finding]]
