"""Segments of a flight: speed, pitch and roll change at constant rates, the heading at a linear one.

A segment is written as a dict of the fields of :class:`Segment`, as a row of numbers in their order (heading rate at
the start, then at the end), or as a manoeuvre: ``["accelerate", 10, 0.2]`` is ten seconds at 0.2 m/s^2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sins_env import checks
from sins_env.checks import build

#: A manoeuvre is one field of a segment, with the sign that its size gets; a size of either sign where that is 0.
MANOEUVRES = {
    "cruise": None,
    "accelerate": ("accel_mps2", 1),
    "decelerate": ("accel_mps2", -1),
    "climb": ("pitch_rate_deg_s", 1),
    "descend": ("pitch_rate_deg_s", -1),
    "roll": ("roll_rate_deg_s", 0),
    "turn": ("heading_rate_deg_s", 0),
}


@dataclass(frozen=True)
class Segment:
    """``heading_rate_deg_s``: clockwise, one number, or those at the start and at the end.

    Raises:
        ValueError: a duration that is not positive, anything that is not a finite number.
    """

    duration_s: float
    accel_mps2: float = 0.0  #: along the path
    pitch_rate_deg_s: float = 0.0
    roll_rate_deg_s: float = 0.0
    heading_rate_deg_s: float | tuple[float, ...] = 0.0

    def __post_init__(self) -> None:
        checks.keep(self, "duration_s", checks.number, "a positive number of seconds", above=0.0)
        for name in ("accel_mps2", "pitch_rate_deg_s", "roll_rate_deg_s"):
            checks.keep(self, name, checks.number)
        if checks.items(self.heading_rate_deg_s) is None:
            checks.keep(self, "heading_rate_deg_s", checks.number, "a finite number, or (start, end)")
        else:
            checks.keep(self, "heading_rate_deg_s", checks.numbers, 2, "a finite number, or (start, end)")

    @classmethod
    def of(cls, given: Any) -> Segment:
        """A segment however it is written.

        Raises:
            ValueError: what is no segment, with the nearest name.
        """
        if isinstance(given, Segment):
            return given
        if isinstance(given, Mapping):
            if "duration_s" not in given:
                raise checks.refused("duration_s", None, "a positive number of seconds")
            return build(cls, given, "a segment")
        row = checks.items(given)
        if row and isinstance(row[0], str):
            return _manoeuvre(row)
        if not row or len(row) > 6:
            raise ValueError("allowed: a dict of fields, one to six numbers, or [manoeuvre, duration, size]")
        return cls(*row[:4], *([row[4] if len(row) == 5 else row[4:]] if len(row) > 4 else []))

    @property
    def manoeuvre(self) -> str:
        """Its name, those of several at once joined."""
        fields = {"accel_mps2": self.accel_mps2, "pitch_rate_deg_s": self.pitch_rate_deg_s}
        fields |= {
            "roll_rate_deg_s": self.roll_rate_deg_s,
            "heading_rate_deg_s": sum(map(abs, self.heading_rates_deg_s)),
        }
        found = [n for n, what in MANOEUVRES.items() if what and fields[what[0]] * (what[1] or fields[what[0]]) > 0]
        return " + ".join(found) or "cruise"

    @property
    def heading_rates_deg_s(self) -> tuple[float, float]:
        """At the start and at the end."""
        given = self.heading_rate_deg_s
        return (given[0], given[1]) if isinstance(given, tuple) else (given, given)


def _manoeuvre(row: list[Any]) -> Segment:
    """[name, duration, size]; a turn may have two sizes, a cruise has none."""
    name, *numbers = row
    what = MANOEUVRES[checks.choice("manoeuvre", name, MANOEUVRES)]
    sizes = (0,) if what is None else (1, 2) if name == "turn" else (1,)
    if len(numbers) - 1 not in sizes:
        form = {0: "[cruise, duration]", 1: f"[{name}, duration, size]", 2: "[turn, duration, rate, or two rates]"}
        raise ValueError(f"{len(numbers)} numbers; allowed: {form[sizes[-1]]}")
    if what is None:
        return Segment(numbers[0])
    field, sign = what
    size: Any = numbers[1] if len(numbers) == 2 else numbers[1:]
    if sign:
        size = sign * checks.number("size", size, "a positive number, the name says which way", above=0.0)
    return build(Segment, {"duration_s": numbers[0], field: size}, "a segment")
