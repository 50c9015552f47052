"""Errors that are asked about, and wanted accuracies with units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from sins_env import checks
from sins_env.arrays import Array
from sins_env.states import Layout
from sins_env.units import ARCSEC, DEG

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*?)?\s*")


class Quantity(NamedTuple):
    """Components of one block of states, as the length of all or the root mean square of one."""

    name: str
    block: str
    parts: tuple[int, ...]
    unit: float  #: size of the unit in which it is shown, SI
    unit_name: str
    what: str  #: description for people
    mean: bool = False  #: whether it is the root mean square of a component; if not, the length of all

    def places(self, states: Layout) -> list[int]:
        """Return the indices of the components among the states; none if these do not have all of them."""
        if self.block not in states:
            return []
        place = states[self.block]
        found = [place.start + part for part in self.parts]
        return found if max(found) < place.stop else []

    def size(self, variances: Array, states: Layout) -> Array:
        """Return 1 sigma (...) from the variances (..., n) of the states."""
        picked = variances[..., self.places(states)]
        return np.sqrt(
            np.maximum(picked.mean(axis=-1) if self.mean else picked.sum(axis=-1), 0.0)
        )  # rounding goes below


QUANTITIES = {
    one.name: one
    for one in (
        Quantity("azimuth", "phi", (2,), DEG, "deg", "azimuth"),
        Quantity("level", "phi", (0, 1), ARCSEC, "arcsec", "level, a component", mean=True),
        Quantity("velocity", "dv", (0, 1), 1.0, "m/s", "horizontal velocity"),
        Quantity("position", "dp", (0, 1), 1.0, "m", "horizontal position"),
        Quantity("height", "dp", (2,), 1.0, "m", "height"),
    )
}

_MINUTE = 60 * ARCSEC
#: Units by name: the quantity that is meant if none is named, and the size in SI.
UNITS: dict[str, tuple[str, float]] = {
    **{name: ("azimuth", DEG) for name in ("deg", "°")},
    **{name: ("azimuth", _MINUTE) for name in ("arcmin", "'")},
    **{name: ("azimuth", ARCSEC) for name in ("arcsec", '"')},
    **{"rad": ("azimuth", 1.0), "mrad": ("azimuth", 1e-3)},
    **{"m/s": ("velocity", 1.0), "cm/s": ("velocity", 1e-2), "mm/s": ("velocity", 1e-3), "km/h": ("velocity", 1 / 3.6)},
    **{"m": ("position", 1.0), "cm": ("position", 1e-2), "mm": ("position", 1e-3), "km": ("position", 1e3)},
}
_BLOCKS = {name: QUANTITIES[quantity].block for name, (quantity, _) in UNITS.items()}
_ALLOWED = f"a positive number with a unit ({', '.join(UNITS)}), such as 0.1deg or level=20arcsec"


class Wanted(NamedTuple):
    """An accuracy that is wanted, 1 sigma."""

    text: str  #: what was given
    quantity: str
    size: float  #: SI


def wanted(given: str | Iterable[str] | Mapping[str, str]) -> tuple[Wanted, ...]:
    """Return wanted accuracies, each given as "0.1deg" or "level=20arcsec", or by the name of the quantity.

    An angle alone is one of azimuth, a length alone one of horizontal position.

    Raises:
        ValueError: no number with a unit, an unknown quantity, or a unit that is not one of the quantity.
    """
    if isinstance(given, str):
        given = [given]
    elif isinstance(given, Mapping):
        given = [f"{name}={value}" for name, value in given.items()]
    return tuple(_wanted(one) for one in given)


def _wanted(given: str) -> Wanted:
    name, equals, text = given.rpartition("=") if isinstance(given, str) else ("", "", "")
    found = _NUMBER.fullmatch(text)
    if not found or not found[2]:
        raise checks.refused("until", given, _ALLOWED)
    if found[2] not in UNITS:
        raise checks.unknown("unit", found[2], UNITS)
    meant, unit = UNITS[found[2]]
    quantity = checks.choice("quantity", name.strip(), QUANTITIES) if equals else meant
    if QUANTITIES[quantity].block != _BLOCKS[found[2]]:
        fitting = [unit for unit, block in _BLOCKS.items() if block == QUANTITIES[quantity].block]
        raise checks.refused("until", given, f"a unit of {quantity}: {', '.join(fitting)}")
    size = checks.number("until", float(found[1]), _ALLOWED, above=0.0)
    return Wanted(text.strip(), quantity, size * unit)
