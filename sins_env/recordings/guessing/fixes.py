"""The guess of the fixes: in the table, or in a file of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.recordings import column_units
from sins_env.recordings.columns import unwrapped
from sins_env.recordings.formats import rtklib
from sins_env.recordings.guessing import names
from sins_env.recordings.guessing.table import Columns, Guess, Known, columns_of, listed
from sins_env.recordings.text.dates import is_date


def fixes_of(found: Guess, table: Columns, time: Any, known: Known) -> tuple[Array, Array] | None:
    """Guess the fixes in the table, or in a file of their own; return their times and speeds, if they have velocities."""
    source = table
    if known.gnss is not None:
        path = table.path.parent / known.gnss
        if rtklib.holds_fixes(path):
            found.add("gnss", known.gnss, known.gnss, "a solution of RTKLIB")
            return None
        source = columns_of(path)
        time = names.single(source.named, "time")
    place = [names.single(source.named, role) for role in ("latitude", "longitude", "height")]
    if None in place or time is None or not np.isfinite(source.three(place)).any():
        if known.gnss is not None:
            raise ValueError(
                f"{source.path}: no columns named as time, latitude, longitude and height; columns there: {listed(source.labels)}"
            )
        return None
    spec: dict[str, Any] = {"time": found.mapping["time"] if source is table else {"column": time}}
    if source is not table:
        spec = {"file": known.gnss, **spec}
    there = np.isfinite(source.three(place)).all(axis=1)
    if source is not table:
        spec["time"] |= _fix_time(source, time, found)
    llh = source.three(place)[there]
    spec["position"] = {"columns": place, **_place_unit(source.path, llh)}
    ned = [names.single(source.named, role) for role in ("north", "east", "down")]
    enu = [names.single(source.named, role) for role in ("east", "north", "up")]
    columns, frame = (ned, "NED") if None not in ned else (enu, "ENU")
    speeds = None
    if None not in columns:
        scale = {"scale": 1e-3} if "scale" in spec["position"] else {}
        spec["velocity"] = {"columns": columns, "frame": frame, **scale}
        vel = source.three(columns)[there]
        speeds = (seconds(spec["time"], source)[there], np.linalg.norm(vel[:, :2], axis=1) * (1e-3 if scale else 1.0))
    std = [names.single(source.named, role) for role in ("std_east", "std_north", "std_up")]
    if None not in std:
        spec["position_std"] = {"columns": std, "frame": "ENU"}
    held = int((np.abs(np.diff(llh, axis=0)).sum(axis=1) == 0).sum()) if len(llh) > 1 else 0
    if source is table and there.all() and held > 0.5 * len(llh):
        found.add("drop_held_fixes", True, "true", "every row has a fix, and most of them repeat the one before")
    shown = f"{listed(place)}{'; ' + listed(columns) if speeds is not None or None not in columns else ''}"
    found.add("gnss", spec, shown, f"{int(there.sum())} rows with a fix, in {spec['position'].get('unit', 'deg')}")
    return speeds


def seconds(spec: dict[str, Any], table: Columns) -> Array:
    """Return the times of the rows, s, by the key ``time`` of a mapping."""
    unit = spec.get("unit", "s")
    values = table[spec["column"]]
    values = unwrapped(values, spec["wraps"]) if "wraps" in spec else values
    return values * (column_units.TIME[unit] if isinstance(unit, str) else unit)


def _fix_time(source: Columns, label: Any, found: Guess) -> dict[str, Any]:
    """Return the unit of the times of fixes in a file of their own: that of the header, or of the recording's times."""
    i = source.labels.index(label)
    if is_date(source.head.fields[i]):
        return {}
    written = source.written(label)
    week = names.single(source.named, "week")
    more = {"week": week} if week else {}
    if written in column_units.TIME:
        return {"unit": written, **more}
    if names.plain(str(label)) == "itow":
        return {"unit": "ms", **more}
    return {"unit": found.mapping.get("time", {}).get("unit", "s"), **more}


def _place_unit(path: Path, llh: Array) -> dict[str, Any]:
    lat, lon = np.abs(llh[:, :2]).max(axis=0)
    if lat > 90.0:
        if lat > 1e6 and (llh[:, :2] == np.rint(llh[:, :2])).all():
            return {"unit": "deg", "scale": [1e-7, 1e-7, 1e-3]}
        raise ValueError(
            f"{path}: latitudes up to {lat:g}: no degrees, radians or 1e-7 deg; allowed: one of them (minutes as in NMEA, "
            "ddmm.mmm, are not read)"
        )
    return {"unit": "rad" if lat < 1.58 and lon < 3.15 else "deg"}
