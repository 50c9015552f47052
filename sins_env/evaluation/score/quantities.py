"""Quantities in which errors are shown: the length of some components, with a unit. Alignment has some, navigation others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.evaluation.play.criteria import AZIMUTH, SCORED
from sins_env.evaluation.play.records import Records
from sins_env.units import ARCSEC, DEG


def _places(block: str) -> tuple[int, ...]:
    return tuple(range(SCORED.size)[SCORED[block]])


class Quantity(NamedTuple):
    """Length of some components of an error."""

    name: str
    parts: tuple[int, ...]  #: indices of components in the layout SCORED
    unit: float  #: size of the unit in SI
    unit_name: str

    @property
    def bounded(self) -> tuple[int, ...]:
        """Components of the bound to compare it with; none for pitch and roll. To first order heading is azimuth."""
        if self.parts == (_HEADING,):
            return (AZIMUTH,)
        return self.parts if max(self.parts) < _HEADING else ()


_EAST, _NORTH, _ = _places("phi")
_HEADING, _PITCH, _ROLL = _places("euler")
_VEL, _POS = _places("dv"), _places("dp")
#: Quantities of alignment.
AXIAL = {
    "azimuth": Quantity("azimuth", (AZIMUTH,), DEG, "deg"),
    "level": Quantity("level", (_EAST, _NORTH), ARCSEC, "arcsec"),
    "east": Quantity("east", (_EAST,), ARCSEC, "arcsec"),
    "north": Quantity("north", (_NORTH,), ARCSEC, "arcsec"),
}
#: Quantities of navigation, with horizontal and vertical parts.
QUANTITIES = {
    "azimuth": Quantity("heading", (_HEADING,), DEG, "deg"),
    "pitch": Quantity("pitch", (_PITCH,), DEG, "deg"),
    "roll": Quantity("roll", (_ROLL,), DEG, "deg"),
    "level": Quantity("level", (_EAST, _NORTH), ARCSEC, "arcsec"),
    "position": Quantity("position", _POS, 1.0, "m"),
    "position_h": Quantity("position, horizontal", _POS[:2], 1.0, "m"),
    "position_v": Quantity("position, vertical", _POS[2:], 1.0, "m"),
    "velocity": Quantity("velocity", _VEL, 1.0, "m/s"),
    "velocity_h": Quantity("velocity, horizontal", _VEL[:2], 1.0, "m/s"),
    "velocity_v": Quantity("velocity, vertical", _VEL[2:], 1.0, "m/s"),
}


def allowed(navigates: bool) -> Mapping[str, Quantity]:
    """Return the quantities of a task by name."""
    return QUANTITIES if navigates else AXIAL


def quantity(name: str, navigates: bool) -> Quantity:
    """Return the quantity of that name.

    Raises:
        ValueError: there is none; the error offers the nearest name.
    """
    there = allowed(navigates)
    if name not in there:
        raise unknown("score", name, there)
    return there[name]


def length(errors: Array, quantity: Quantity) -> Array:
    """Return the length (...) of those components of the errors (..., c) that make up the quantity."""
    found: Array = np.sqrt(np.square(errors[..., quantity.parts]).sum(axis=-1))
    return found


def run_errors(records: Records, name: str) -> tuple[Array, Array]:
    """Return the RMS over time of each run, and its error at T: (R,) each, SI, not negative.

    The time is the steady state in alignment and the scored span in navigation.

    Raises:
        ValueError: no quantity of that name.
    """
    c = records.criteria
    one = quantity(name, c.navigates)
    over_time, final = (records.span_rms, records.span_final) if c.navigates else (records.steady_rms, records.final)
    return length(over_time, one), length(final, one)
