"""The guess of a mapping: names first, then numbers, and an open question where neither tells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.recordings.file_format import unpacked_name
from sins_env.recordings.formats import FORMATS
from sins_env.recordings.guessing.fixes import fixes_of
from sins_env.recordings.guessing.inertial import axes, sensors, units
from sins_env.recordings.guessing.table import Columns, Guess, Known, Line, columns_of, file_key
from sins_env.recordings.guessing.times import time_of
from sins_env.recordings.text.style import SPACE

SELF_TOLD = ("npz", "psins-imu", "psins-mat", "novatel", "navego", "kitti")  #: formats whose files say what they hold
NOTHING = Known()


def guess(path: Path, known: Known = NOTHING) -> Guess:
    """Guess the mapping of a text table.

    Raises:
        ValueError: a file that needs no mapping, or no table with gyros and accelerometers.
        OSError: no such file, or one that cannot be read.
    """
    ending = unpacked_name(path).suffix.lower()
    for name in SELF_TOLD:
        one = FORMATS[name]
        if ending == one.ending or (ending in one.more_endings and one.recognises(path)):
            raise ValueError(f"{path}: {name}, which says itself what it holds; allowed: a text table")
    table = columns_of(path)
    found = Guess({"format": "csv", "file": path.name})
    _style(found, table)
    time, t = time_of(found, table, known)
    _inertial(found, table, time, t, known)
    return found


def _style(found: Guess, table: Columns) -> None:
    style = table.head.style
    shown = {SPACE: "white space", "\t": "tab"}.get(style.delimiter or "", str(style.delimiter))
    found.add("delimiter", style.delimiter, shown, f"{table.head.width} columns in each of the first rows")
    if style.decimal == ",":
        found.add("decimal", ",", "a comma", f"numbers such as {table.head.fields[0]!r}")
    if table.head.names:
        found.lines.append(
            Line("header", f"line {table.head.line - 1 - bool(table.head.units)}", "names of the columns")
        )


def _inertial(found: Guess, table: Columns, time: Any, t: Array, known: Known) -> None:
    """Guess the columns and units of gyros and accelerometers, the axes, the fixes and the site."""
    steps = np.diff(t)
    rate = float(1.0 / np.median(steps)) if len(t) > 1 and np.median(steps) > 0 else float("nan")
    (accels, accel), (gyros, gyro) = sensors(table, time, rate)
    force, turn = accels.three(accel), gyros.three(gyro)
    there: Mask = np.asarray(np.isfinite(np.hstack([force, turn])).all(axis=1))
    if not there.all():
        raise ValueError(
            f"{table.path}: {int((~there).sum())} of {len(there)} rows have blank IMU columns; allowed: a table with all of them "
            "in every row"
        )
    increments = units(found, gyros, gyro, accels, accel, rate)
    found.mapping["gyro"] |= file_key(table, gyros)
    found.mapping["accel"] |= file_key(table, accels)
    fixes = fixes_of(found, table, time, known)
    axes(found, known, t, force, fixes, rate, increments)
    if known.site is not None:
        found.add("site", list(known.site), ", ".join(f"{x:g}" for x in known.site), "as told")
    elif "gnss" not in found.mapping:
        found.open.append(
            'site: no latitude and longitude; write "site": [latitude deg, longitude deg, height m] (or give --site, or --gnss)'
        )
