"""Readings of aiding sensors in tables that a mapping names: odometer, Doppler log, heading, magnetometer, height, depth.

They become what an observation of the sensor holds, in SI and Right-Forward-Up or East-North-Up. See docs/recordings.md#aids.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sins_env import checks
from sins_env.arrays import Array
from sins_env.recordings.axes import to_rfu, turned
from sins_env.recordings.column_units import ANGLE
from sins_env.recordings.columns import PARTS_OF_DATE, Part, make_part
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Readings
from sins_env.recordings.times import Times, on_scale_of
from sins_env.units import KMH, KNOT

LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3, "ft": 0.3048}
SPEED = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": KMH, "kn": KNOT}
FIELD = {"T": 1.0, "mT": 1e-3, "uT": 1e-6, "nT": 1e-9, "gauss": 1e-4, "mgauss": 1e-7}
PRESSURE = {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1000.0}


@dataclass(frozen=True)
class Way:
    """One way in which a file may hold a sensor: the columns that it needs, and the readings made of them."""

    columns: dict[str, tuple[int, bool]]  #: number of columns of each field, and whether it is needed
    readings: Callable[
        [Part, Array, Array], Readings
    ]  #: made of the columns, the times, and the turn into Right-Forward-Up


def _travelled(part: Part, t: Array, turn: Array) -> Readings:
    return Readings(t, part["distance"] * part.unit("distance", LENGTH))


def _rolled(part: Part, t: Array, turn: Array) -> Readings:
    steps = part["increment"] * part.unit("increment", LENGTH)
    return Readings(t, np.cumsum(steps, axis=0))


def _driven(part: Part, t: Array, turn: Array) -> Readings:
    speed = part["speed"] * part.unit("speed", SPEED)
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(t)[:, None]
    return Readings(t, np.concatenate([np.zeros((1, 1)), np.cumsum(steps, axis=0)]))


def _body(name: str, units: dict[str, float]) -> Callable[[Part, Array, Array], Readings]:
    return lambda part, t, turn: Readings(t, turned(part[name], turn) * part.unit(name, units))


def _directed(part: Part, t: Array, turn: Array) -> Readings:
    """Return unit vectors; without a pitch, their horizontal parts only, as if it were level."""
    heading = (part["heading"] * part.unit("heading", ANGLE))[:, 0]
    level = np.column_stack([np.sin(heading), np.cos(heading)])
    if "pitch" not in part.spec:
        return Readings(t, level, True)
    pitch = (part["pitch"] * part.unit("pitch", ANGLE))[:, :1]
    return Readings(t, np.concatenate([np.cos(pitch) * level, np.sin(pitch)], axis=1), True)


def _baseline(part: Part, t: Array, turn: Array) -> Readings:
    vector = part.enu("baseline")
    assert vector is not None
    return Readings(t, vector * part.unit("baseline", LENGTH, "m"))


def _along(name: str) -> Callable[[Part, Array, Array], Readings]:
    return lambda part, t, turn: Readings(t, part[name] * part.unit(name, LENGTH))


def _barometric(part: Part, t: Array, turn: Array) -> Readings:
    """Return the height of the standard atmosphere, below 11 km."""
    ratio = part["pressure"] * part.unit("pressure", PRESSURE) / 101_325.0
    return Readings(t, 44_330.77 * (1.0 - np.maximum(ratio, 0.2) ** 0.190263))


#: Ways of each sensor, by its name in the setting ``aids``.
WAYS: dict[str, tuple[Way, ...]] = {
    "odometer": (
        Way({"distance": (1, True)}, _travelled),
        Way({"increment": (1, True)}, _rolled),
        Way({"speed": (1, True)}, _driven),
    ),
    "dvl": (Way({"velocity": (3, True)}, _body("velocity", SPEED)),),
    "heading": (Way({"heading": (1, True), "pitch": (1, False)}, _directed), Way({"baseline": (3, True)}, _baseline)),
    "magnetometer": (Way({"field": (3, True)}, _body("field", FIELD)),),
    "height": (Way({"height": (1, True)}, _along("height")), Way({"pressure": (1, True)}, _barometric)),
    "depth": (Way({"depth": (1, True)}, _along("depth")),),
}
#: Allowed numbers of components of the readings of each sensor.
SIZES = {"odometer": (1,), "dvl": (3,), "heading": (2, 3), "magnetometer": (3,), "height": (1,), "depth": (1,)}
_TIME = (1, 2, PARTS_OF_DATE)  #: allowed numbers of columns of times


def readings_of(path: Path, mapping: Mapping, imu: Times) -> dict[str, Readings]:
    """Return the readings of the sensors that ``aids`` of a mapping names, on the scale of the IMU.

    Raises:
        ValueError: an unknown sensor, columns or a unit that it does not have, or rows of the wrong form.
        FileNotFoundError: no such file beside it.
    """
    found = {}
    for name, given in (mapping.aids or {}).items():
        checks.choice("aid", name, WAYS)
        whose = f"aids.{name}"
        if not isinstance(given, dict):
            raise checks.refused(f"{whose} of the mapping of {path.name}", given, "an object with time and columns")
        axes = given.get("axes", mapping.axes or "RFU")
        ways = [way for way in WAYS[name] if any(field in given for field in way.columns)]
        fields = [field for way in WAYS[name] for field in way.columns]
        if len(ways) != 1:
            raise ValueError(f"{path}: {whose} has {list(given)}; allowed: time and one of {', '.join(fields)}")
        counts: dict[str, tuple[tuple[int, ...], bool]] = {"time": (_TIME, True)}
        counts |= {field: ((many,), needed) for field, (many, needed) in ways[0].columns.items()}
        columns = {key: value for key, value in given.items() if key != "axes"}
        part = make_part(path, mapping, whose, columns, ("file", *counts), counts, optional=True)
        t = on_scale_of(part.increasing(), imu, part.path, f"the readings of {name}")
        found[name] = ways[0].readings(part, t, to_rfu(axes))
    return found
