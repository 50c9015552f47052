"""The guess of gyros and accelerometers: their columns, their units and their axes."""

from __future__ import annotations

from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.recordings import column_units
from sins_env.recordings.axes import to_rfu
from sins_env.recordings.guessing import measures, names
from sins_env.recordings.guessing.table import Columns, Guess, Known, beside, listed


def sensors(table: Columns, time: Any, rate: float) -> list[tuple[Columns, list[Any]]]:
    """Return the columns of accelerometers and of gyros, each with their table.

    They are known by name, in a table beside if this one has none of them, or without names by gravity.
    """
    if table.named:
        return [_named_sensor(table, role, rate) for role in ("accel", "gyro")]
    if time is None:
        raise ValueError(f"{table.path}: no names, and no column of times; allowed: a header, or a mapping by number")
    labels = [one for one in table.labels if one != time and np.isfinite(table[one]).all()]
    threes = [labels[i : i + 3] for i in range(0, len(labels) - 2) if labels[i + 2] == labels[i] + 2]
    heavy = [one for one in threes if measures.force_units(table.three(one), rate)]
    for accel in heavy:
        for gyro in threes:
            if not set(gyro) & set(accel) and abs(gyro[0] - accel[0]) == 3:
                return [(table, accel), (table, gyro)]
    raise ValueError(
        f"{table.path}: no names, and no three columns that feel gravity beside three others; allowed: a header, or a mapping "
        "with the columns by number"
    )


def _named_sensor(table: Columns, role: str, rate: float) -> tuple[Columns, list[Any]]:
    several: list[list[Any]] = [
        list(one) for one in names.triples(table.named, role) if np.isfinite(table.three(one)).any()
    ]
    fits = [one for one in several if role == "accel" and measures.force_units(table.three(one), rate)]
    if several:
        return table, (fits or several)[0]
    other = beside(table, role)
    if other is not None:
        return other, list(next(names.triples(other.named, role)))
    what, such = ("accelerometers", "acc_x") if role == "accel" else ("gyros", "gyro_x")
    raise ValueError(
        f"{table.path}: no three columns named as those of {what}; allowed: names such as {such}, here or in one table beside it "
        f"with as many rows; columns there: {listed(table.labels)}"
    )


def units(found: Guess, gyros: Columns, gyro: list[Any], accels: Columns, accel: list[Any], rate: float) -> bool:
    """Guess the units; return whether the values are increments."""
    force, turn = accels.three(accel), gyros.three(gyro)
    fits = measures.force_units(force, rate)
    written = accels.written(accel[0])
    chosen = next((one for one in fits if one.name == written), fits[0] if fits and written is None else None)
    size = float(np.median(np.linalg.norm(measures.seconds_means(force, rate), axis=1)))
    if chosen is None:
        said = f" (the header says {written})" if written else ""
        found.add("accel", {"columns": accel}, listed(accel), "by name")
        found.open.append(
            f'accel: |f| is {size:.5g}{said}, which is gravity in no unit; write "unit" and, for counts, "scale" '
            "(for acceleration without gravity nothing helps: log the specific force)"
        )
        increments = False
    else:
        why = f"{chosen.why}{', and the header says so' if written else ''}"
        found.add("accel", {"columns": accel, "unit": chosen.name}, f"{listed(accel)} in {chosen.name}", why)
        increments = not column_units.ACCEL[chosen.name].rate
    turns = [] if chosen is None else measures.rate_units(turn, force, rate, increments)
    said_ = gyros.written(gyro[0])
    if said_ in column_units.GYRO and (not turns or said_ in [one.name for one in turns]):
        why = next((f"{one.why}, and the header says so" for one in turns), "the header says so")
        found.add("gyro", {"columns": gyro, "unit": said_}, f"{listed(gyro)} in {said_}", why)
    elif len(turns) == 1 and said_ not in column_units.GYRO:
        found.add("gyro", {"columns": gyro, "unit": turns[0].name}, f"{listed(gyro)} in {turns[0].name}", turns[0].why)
    else:
        found.add("gyro", {"columns": gyro}, listed(gyro), "by name")
        what = f"the header says {said_}, the numbers {turns[0].name} ({turns[0].why})" if turns and said_ else (
            "neither the earth's rate nor the turning of gravity shows the unit"
        )  # fmt: skip
        kind = ", ".join(name for name, unit in column_units.GYRO.items() if unit.rate != increments)
        found.open.append(f'gyro: {what}; write "unit" in gyro, one of {kind}')
    return increments


def axes(
    found: Guess, known: Known, t: Array, force: Array, fixes: tuple[Array, Array] | None, rate: float, increments: bool
) -> None:
    """Guess where x, y, z point: up from gravity, and forward from how the speed of the fixes changes."""
    if known.axes is not None:
        to_rfu(known.axes)
        found.add("axes", known.axes, known.axes, "as told")
        return
    up, share = measures.up_axis(force, rate)
    unit = found.mapping["accel"].get("unit")
    forward = None
    if fixes is not None and unit is not None:
        si = column_units.ACCEL[unit].si * (rate if increments else 1.0)
        forward = measures.forward_axis(t, force * si, *fixes, up)
    felt = f"gravity along {up} ({100 * share:.0f} %)"
    if share < measures.UP_SHARE:
        found.open.append(
            f'axes: no axis points up ({up} has {100 * share:.0f} % of gravity); write "axes", such as FRD, or turn the file'
        )
    elif forward is not None:
        found.add("axes", measures.letters(up, forward[0]), measures.letters(up, forward[0]),
                  f"{felt}, and {forward[0]} follows the speed (correlation {forward[1]:.2f})")  # fmt: skip
    elif up == "-z":
        found.add("axes", "FRD", "FRD", f"{felt}; that x is forward is assumed, as usual with z down")
    else:
        options = [measures.letters(up, sign + axis) for axis in "xyz" if axis != up[1] for sign in "+-"]
        found.open.append(
            f'axes: {felt}, and nothing tells which axis is forward; write "axes", one of {", ".join(options)} (or give --axes)'
        )
