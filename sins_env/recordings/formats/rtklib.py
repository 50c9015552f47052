"""RTKLIB solution files (``.pos``): fixes, which a recording's mapping names as ``gnss``; they hold no IMU data.

The form is that of RTKLIB's manual, section B.1. Lines that begin with % are comments, and the last of them has the names:

    time scale (GPST or UTC), in two columns: date and time of day, or GPS week and seconds of week
    latitude(deg), longitude(deg), height(m); Q; ns; sdn, sde, sdu, sdne, sdeu, sdun m; age s; ratio
    vn, ve, vu m/s and their deviations behind, if they were asked for
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sins_env.arrays import Array
from sins_env.recordings.assembling import geodetic
from sins_env.recordings.clock import check_increasing
from sins_env.recordings.file_format import Format
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Gnss, Recording
from sins_env.recordings.text import Style, read_head, read_table
from sins_env.recordings.text.head import first_lines
from sins_env.recordings.times import WEEK_S, Times, on_scale_of

_STYLE = Style(comments=("%",))
_SCALES = {"GPST": "GPS", "UTC": "UTC"}
_PLACE = ("latitude(deg)", "longitude(deg)", "height(m)")
#: Groups of columns in the order North, East, Up, with their names.
_GROUPS = {
    "pos_std": ("sdn(m)", "sde(m)", "sdu(m)"),
    "vel": ("vn(m/s)", "ve(m/s)", "vu(m/s)"),
    "vel_std": ("sdvn", "sdve", "sdvu"),
}


def names(path: Path) -> list[str]:
    """Return the names of the columns; empty for a file of another form."""
    marked = [line[1:].split() for line in first_lines(path)[:200] if line.startswith("%")]
    return next((found for found in reversed(marked) if len(found) > 3 and found[0] in (*_SCALES, "JST")), [])


def holds_fixes(path: Path) -> bool:
    """Return whether a text file is a solution of RTKLIB."""
    return bool(names(path))


def load(path: Path, mapping: Mapping) -> Recording:
    """Refuse a file of fixes alone.

    Raises:
        ValueError: always.
    """
    raise ValueError(
        f'{path}: fixes of RTKLIB and no IMU data; allowed: a recording of IMU data whose mapping has "gnss": "{path.name}"'
    )


def fixes(path: Path, imu: Times) -> Gnss:
    """Read the fixes, on the time scale of the IMU.

    Raises:
        ValueError: a table of another form, or another time scale.
    """
    there = names(path)
    if there[0] not in _SCALES:
        raise ValueError(f"{path}: times are in {there[0]}; allowed: {', '.join(_SCALES)}")
    missing = [name for name in _PLACE if name not in there]
    if missing:
        raise ValueError(
            f"{path}: no column {missing[0]!r}; allowed: solutions as latitude, longitude in deg and height"
        )
    head = read_head(path, _STYLE)
    dated = bool(head.fields) and any(mark in head.fields[0] for mark in "/-")
    columns = {name: place + 1 for place, name in enumerate(there)}  # the times have two columns
    groups = {key: _places(columns, group) for key, group in _GROUPS.items()}
    place = [columns[name] for name in _PLACE]
    wanted = sorted({*place, *(i for group in groups.values() for i in group or ()), *(() if dated else (0, 1))})
    table = read_table(path, None, head, wanted, dates=[(0, 1)] if dated else ())
    at = {column: i for i, column in enumerate(wanted)}
    rows = table.rows
    t = rows[:, -1] if dated else rows[:, at[0]] * WEEK_S + rows[:, at[1]]
    check_increasing(str(path), "time", table.place, t)

    def enu(key: str) -> Array | None:
        group = groups[key]
        return None if group is None else rows[:, [at[group[i]] for i in (1, 0, 2)]]

    pos = geodetic(path, "position", table.place, rows[:, [at[i] for i in place]])
    stds = [None if (std := enu(key)) is None else np.abs(std) for key in ("pos_std", "vel_std")]
    t = on_scale_of(Times(t, _SCALES[there[0]]), imu, path, "fixes")
    return Gnss(t, enu("vel"), pos, *stds)


def _places(columns: dict[str, int], group: tuple[str, ...]) -> list[int] | None:
    """Return the places of three columns; None if one is not there."""
    return [columns[name] for name in group] if all(name in columns for name in group) else None


FORMAT = Format(
    "rtklib", ".pos", load, lacks=("reference", "lever arm", "displacements", "aids"), recognises=holds_fixes
)
