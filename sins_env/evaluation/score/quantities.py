"""What errors are told in: components together, with a unit. Alignment has its axes, navigation velocity and position, too."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.evaluation.play.criteria import COMPONENTS
from sins_env.evaluation.play.records import Records
from sins_env.units import ARCSEC, DEG


class Quantity(NamedTuple):
    """The length of some components of an error."""

    name: str
    parts: tuple[int, ...]  #: of COMPONENTS
    unit: float
    unit_name: str

    @property
    def bounded(self) -> tuple[int, ...]:
        """Components of the bound that it is held against; none for pitch and roll. To first order heading is azimuth."""
        if self.parts == (_HEADING,):
            return (2,)
        return self.parts if max(self.parts) < _HEADING else ()


_HEADING = COMPONENTS.index("heading")
#: Of alignment.
AXIAL = {
    "azimuth": Quantity("azimuth", (2,), DEG, "deg"),
    "level": Quantity("level", (0, 1), ARCSEC, "arcsec"),
    "east": Quantity("east", (0,), ARCSEC, "arcsec"),
    "north": Quantity("north", (1,), ARCSEC, "arcsec"),
}
#: Of navigation; horizontal and vertical by themselves, and together.
QUANTITIES = {
    "azimuth": Quantity("heading", (_HEADING,), DEG, "deg"),
    "pitch": Quantity("pitch", (_HEADING + 1,), DEG, "deg"),
    "roll": Quantity("roll", (_HEADING + 2,), DEG, "deg"),
    "level": Quantity("level", (0, 1), ARCSEC, "arcsec"),
    "position": Quantity("position", (6, 7, 8), 1.0, "m"),
    "position_h": Quantity("position, horizontal", (6, 7), 1.0, "m"),
    "position_v": Quantity("position, vertical", (8,), 1.0, "m"),
    "velocity": Quantity("velocity", (3, 4, 5), 1.0, "m/s"),
    "velocity_h": Quantity("velocity, horizontal", (3, 4), 1.0, "m/s"),
    "velocity_v": Quantity("velocity, vertical", (5,), 1.0, "m/s"),
}


def allowed(navigates: bool) -> Mapping[str, Quantity]:
    return QUANTITIES if navigates else AXIAL


def find(name: str, navigates: bool) -> Quantity:
    """The quantity of that name.

    Raises:
        ValueError: there is none; the nearest is offered.
    """
    there = allowed(navigates)
    if name not in there:
        raise unknown("score", name, there)
    return there[name]


def length(errors: Array, quantity: Quantity) -> Array:
    """Of the components (..., c): (...)."""
    found: Array = np.sqrt(np.square(errors[..., quantity.parts]).sum(axis=-1))
    return found


def run_errors(records: Records, name: str) -> tuple[Array, Array]:
    """RMS over time of each run, and the error at T: (R,) each, not negative.

    Over the steady state in alignment, over the scored span in navigation.
    """
    c = records.criteria
    quantity = find(name, c.navigates)
    over_time, final = (records.span_rms, records.span_final) if c.navigates else (records.steady_rms, records.final)
    return length(over_time, quantity), length(final, quantity)
