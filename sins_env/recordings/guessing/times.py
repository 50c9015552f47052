"""The guess of the times: a column, a counter or a rate, and their unit."""

from __future__ import annotations

from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.recordings import column_units
from sins_env.recordings.columns import unwrapped
from sins_env.recordings.formats.csv_files import COUNTERS
from sins_env.recordings.guessing import measures, names
from sins_env.recordings.guessing.table import Columns, Guess, Known, beside, file_key
from sins_env.recordings.text.dates import is_date

SLOW_HZ = 25.0  #: rate of an IMU below which the unit of whole stamps is doubted


def time_of(found: Guess, table: Columns, known: Known) -> tuple[Any, Array]:
    """Guess the column of times; return it, and the times of the rows, s."""
    counted = next((name for name in table.named if names.plain(name) in COUNTERS), None)
    label = names.single(table.named, "time")
    if label is not None and np.isnan(table[label]).all():
        label = None
    other = beside(table, "time") if label is None and counted is None and table.named else None
    if other is not None:
        t = _stamps(found, other, names.single(other.named, "time"), known.rate_hz)
        found.mapping["time"] |= file_key(table, other)
        return None, t
    if label is None:
        label = next((one for one in table.labels if one != counted and _increases(table[one])), None)
    if label is None:
        rate = known.rate_hz
        t = np.arange(1.0, len(table.values) + 1)
        if counted is not None:
            found.add("counter", {"column": counted}, counted, "it counts the samples")
            counts = table[counted]
            t = unwrapped(counts, 65536.0 if counts.max() < 65536 else 2.0**32)
        if rate is None:
            found.open.append(
                'rate_hz: no column tells time, and no number its rate; write "rate_hz": 100.0 (or give --rate)'
            )
            return None, t * np.nan
        found.add("rate_hz", rate, f"{rate:g} Hz", "as told")
        return None, t / rate
    return label, _stamps(found, table, label, known.rate_hz)


def _increases(values: Array) -> bool:
    """Return whether values increase by even steps other than 1, as times do and counters do not; a counter may wrap once."""
    steps = np.diff(values)
    if len(steps) < 2 or not np.isfinite(steps).all():
        return False
    step = float(np.median(steps))
    return step > 0 and bool((steps != 1).any()) and bool(np.mean((steps > 0) & (steps < 10 * step)) > 0.99)


def _stamps(found: Guess, table: Columns, label: Any, rate_hz: float | None) -> Array:
    values, i = table[label], table.labels.index(label)
    spec: dict[str, Any] = {"column": label}
    if is_date(table.head.fields[i]):
        found.add("time", spec, str(label), f"dates such as {table.head.fields[i]}")
        return values
    steps = np.diff(values)
    step = float(np.median(steps))
    written = table.written(label)
    unit: Any = written if written in column_units.TIME else measures.time_unit(step)
    why = f"the header says {unit}" if unit == written else f"steps of {step:g} are then {_rate(step, unit)}"
    if names.plain(str(label)) == "sampletimefine":
        unit, why = 1e-4, "SampleTimeFine of Xsens counts 1e-4 s"
    whole = bool((values == np.rint(values)).all())
    if unit not in (written, 1e-4) and rate_hz is not None:
        unit, why = _unit_at(step, rate_hz), f"steps of {step:g} are then the {rate_hz:g} Hz told"
    elif unit not in (written, 1e-4) and whole and 1.0 / (step * column_units.TIME[unit]) < SLOW_HZ:
        found.open.append(
            f'time: steps of {step:g} are {_rate(step, unit)} in {unit}, and may be another unit; write "unit" in time, such as '
            f'"{unit}" or 1e-4 for 1e-4 s (or give --rate)'
        )
    bits = next(
        (bits for bits in (16, 32) if whole and values.max() < 2**bits and (steps < -(2 ** (bits - 1))).any()), None
    )
    if bits is not None:
        spec["wraps"] = 2**bits
        values = unwrapped(values, 2.0**bits)
        why += f"; a counter of {bits} bits begins again"
    spec["unit"] = unit
    t = values * (column_units.TIME[unit] if isinstance(unit, str) else unit)
    week: Any = names.single(table.named, "week")
    if week is None and isinstance(label, int) and label > 1:
        before = table[label - 1]
        week = (
            label - 1 if (before == np.rint(before)).all() and np.ptp(before) <= 1 and 0 < before[0] < 10_000 else None
        )
    if week is not None:
        spec["week"] = week
        t = t + table[week] * 604_800.0
        why += f"; weeks in column {week}"
    found.add("time", spec, f"{label} in {unit if isinstance(unit, str) else f'{unit:g} s'}", why)
    return np.asarray(t)


def _unit_at(step: float, rate_hz: float) -> Any:
    """Return the unit of time that makes a step the period of a rate: its name, or its seconds."""
    value = 1.0 / (rate_hz * step)
    return next(
        (name for name, unit in column_units.TIME.items() if abs(value / unit - 1) < 0.05), float(f"{value:.3g}")
    )


def _rate(step: float, unit: str) -> str:
    return f"{1.0 / (step * column_units.TIME[unit]):.4g} Hz" if step > 0 else "no rate"
