"""Segments of a flight: speed, pitch and roll change at constant rates, and the heading rate changes linearly.

A segment may be written in three ways:

- a dict of the fields of :class:`Segment`;
- a row of numbers in the order of these fields, with the heading rate at the start and then at the end;
- a manoeuvre such as ``["accelerate", 10, 0.2]``, which is ten seconds at 0.2 m/s^2.

See docs/mathematics/simulation.md#flight-plan.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sins_env import checks
from sins_env.checks import build

#: Manoeuvres by name: the field that the size sets, and the sign that the name gives to it. With 0 the size has its own.
MANOEUVRES = {
    "cruise": None,
    "accelerate": ("accel_mps2", 1),
    "decelerate": ("accel_mps2", -1),
    "climb": ("pitch_rate_deg_s", 1),
    "descend": ("pitch_rate_deg_s", -1),
    "roll": ("roll_rate_deg_s", 0),
    "turn": ("heading_rate_deg_s", 0),
}


LEAST_S, MOST_S = 1e-4, 604_800.0  #: limits of a segment and of a whole flight, s; a week
MOST_RATE = 1e4  #: largest acceleration, m/s^2, and rate of turn, deg/s


@dataclass(frozen=True)
class Segment:
    """A segment of a flight.

    Raises:
        ValueError: a duration that is not positive, anything that is not a finite number.
    """

    duration_s: float
    accel_mps2: float = 0.0  #: acceleration along the path
    pitch_rate_deg_s: float = 0.0  #: positive raises the nose
    roll_rate_deg_s: float = 0.0  #: positive lowers the right side
    heading_rate_deg_s: float | tuple[float, ...] = 0.0  #: positive turns right; one number, or (at start, at end)

    def __post_init__(self) -> None:
        allowed = f"a positive number of seconds, {LEAST_S:g} to {MOST_S:g}"
        checks.keep(self, "duration_s", checks.number, allowed, least=LEAST_S, most=MOST_S)
        limits = {"least": -MOST_RATE, "most": MOST_RATE}
        for name in ("accel_mps2", "pitch_rate_deg_s", "roll_rate_deg_s"):
            checks.keep(self, name, checks.number, f"a finite number, -{MOST_RATE:g} to {MOST_RATE:g}", **limits)
        allowed = f"a finite number, or (start, end), -{MOST_RATE:g} to {MOST_RATE:g}"
        if checks.items(self.heading_rate_deg_s) is None:
            checks.keep(self, "heading_rate_deg_s", checks.number, allowed, **limits)
        else:
            checks.keep(self, "heading_rate_deg_s", checks.numbers, 2, allowed, **limits)

    @classmethod
    def of(cls, given: Any) -> Segment:
        """Make a segment from any of the forms in the module's docstring.

        Raises:
            ValueError: anything else; for an unknown name the error offers the nearest one.
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
        """Name of the manoeuvre; several at once are joined by ``+``."""
        fields = {"accel_mps2": self.accel_mps2, "pitch_rate_deg_s": self.pitch_rate_deg_s}
        fields |= {
            "roll_rate_deg_s": self.roll_rate_deg_s,
            "heading_rate_deg_s": sum(map(abs, self.heading_rates_deg_s)),
        }
        found = [n for n, what in MANOEUVRES.items() if what and fields[what[0]] * (what[1] or fields[what[0]]) > 0]
        return " + ".join(found) or "cruise"

    @property
    def heading_rates_deg_s(self) -> tuple[float, float]:
        """Heading rates at the start and at the end, deg/s."""
        given = self.heading_rate_deg_s
        return (given[0], given[1]) if isinstance(given, tuple) else (given, given)


def _manoeuvre(row: list[Any]) -> Segment:
    """Make a segment from [name, duration, size]; a turn may have two sizes, a cruise has none."""
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
