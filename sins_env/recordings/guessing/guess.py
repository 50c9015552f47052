"""The guess of a mapping: names first, then numbers, and an open question where neither tells."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.recordings import column_units
from sins_env.recordings.axes import to_rfu
from sins_env.recordings.columns import unwrapped
from sins_env.recordings.file_format import unpacked_name
from sins_env.recordings.formats import FORMATS, rtklib
from sins_env.recordings.formats.csv_files import COUNTERS
from sins_env.recordings.guessing import measures, names
from sins_env.recordings.text import Head, Style, read_head, read_table
from sins_env.recordings.text.dates import is_date
from sins_env.recordings.text.style import COMMENTS, SPACE

SLOW_HZ = 25.0  #: rate of an IMU below which the unit of whole stamps is doubted
MOST_BESIDE = 50  #: most files of a folder among which parts of a recording are sought
MOST_ROWS = 200_000  #: most rows that are measured
SELF_TOLD = ("npz", "psins-imu", "psins-mat", "novatel", "navego", "kitti")  #: formats whose files say what they hold


@dataclass(frozen=True)
class Known:
    """What the user knows and no file tells."""

    site: tuple[float, float, float] | None = None  #: latitude deg, longitude deg, height m
    axes: str | None = None
    rate_hz: float | None = None
    gnss: str | None = None  #: name of a file with fixes beside the recording's own


class Line(NamedTuple):
    """One key of the mapping."""

    key: str
    value: str
    why: str


@dataclass
class Guess:
    """A mapping, and what is behind each key of it."""

    mapping: dict[str, Any]
    lines: list[Line] = field(default_factory=list)
    open: list[str] = field(default_factory=list)  #: what cannot be measured, each with what to write

    def add(self, key: str, value: Any, shown: str, why: str) -> None:
        """Set a key of the mapping."""
        self.mapping[key] = value
        self.lines.append(Line(key, shown, why))


@dataclass(frozen=True)
class _Columns:
    """The numbers of a table, a column for each name or number."""

    path: Path
    head: Head
    labels: list[Any]  #: names of the columns, or numbers from 1
    values: Array  #: (n, columns); NaN for blanks

    @property
    def named(self) -> list[str]:
        return [label for label in self.labels if isinstance(label, str)]

    def __getitem__(self, label: Any) -> Array:
        return self.values[:, self.labels.index(label)]

    def three(self, labels: list[Any]) -> Array:
        return self.values[:, [self.labels.index(label) for label in labels]]

    def written(self, label: Any) -> str | None:
        """Return the unit that the header writes beside a name."""
        i = self.labels.index(label)
        texts = [*self.head.units[i : i + 1], *self.head.names[i : i + 1]]
        return next((unit for text in texts if (unit := column_units.written(text))), None)


def guess(path: Path, known: Known = Known()) -> Guess:
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
    table = _columns(path)
    found = Guess({"format": "csv", "file": path.name})
    _style(found, table)
    time, t = _time(found, table, known)
    _inertial(found, table, time, t, known)
    return found


def _columns(path: Path) -> _Columns:
    """Read the columns of numbers and dates of the first rows of a table."""
    head = read_head(path, Style(COMMENTS, None, ".", None), measured=True)
    if not head.fields:
        raise ValueError(f"{path}: no rows of numbers")
    style = head.style
    width = head.width
    labels: list[Any] = list(head.names) or list(range(1, width + 1))
    if len(set(labels)) < len(labels):
        labels = [label if labels.count(label) == 1 else i + 1 for i, label in enumerate(labels)]
    data = [i for i in range(width) if i < len(head.fields) and style.holds_data(head.fields[i])]
    dates = [(i,) for i in data if is_date(head.fields[i])]
    numbers = [
        i for i in data if (i,) not in dates and (np.isfinite(style.number(head.fields[i])) or _blank(head.fields[i]))
    ]
    table = read_table(path, None, head, numbers, numbers, dates, most_rows=MOST_ROWS)
    values = np.full((len(table.rows), width), np.nan)
    values[:, numbers + [i for (i,) in dates]] = table.rows
    return _Columns(path, head, labels, values)


def _beside(table: _Columns, role: str) -> _Columns | None:
    """Return the only table beside this one that has as many rows and the columns of a role, as gnss-ins-sim writes them."""
    found = []
    for path in sorted(table.path.parent.glob(f"*{table.path.suffix}"))[:MOST_BESIDE]:
        if path == table.path:
            continue
        try:
            names_ = list(read_head(path, Style(COMMENTS, None, ".", None), measured=True).names)
            there = names.single(names_, role) if role == "time" else next(names.triples(names_, role), None)
            other = _columns(path) if there else None
        except ValueError:
            continue
        if other is not None and len(other.values) == len(table.values):
            found.append(other)
    return found[0] if len(found) == 1 else None


def _file(table: _Columns, of: _Columns) -> dict[str, str]:
    """Return the key of a file of its own."""
    return {} if of is table else {"file": of.path.name}


def _blank(text: str) -> bool:
    return text.lower() in ("", "nan", "null", "none", "n/a", "na", "-", "--")


def _style(found: Guess, table: _Columns) -> None:
    style = table.head.style
    shown = {SPACE: "white space", "\t": "tab"}.get(style.delimiter or "", str(style.delimiter))
    found.add("delimiter", style.delimiter, shown, f"{table.head.width} columns in each of the first rows")
    if style.decimal == ",":
        found.add("decimal", ",", "a comma", f"numbers such as {table.head.fields[0]!r}")
    if table.head.names:
        found.lines.append(
            Line("header", f"line {table.head.line - 1 - bool(table.head.units)}", "names of the columns")
        )


def _time(found: Guess, table: _Columns, known: Known) -> tuple[Any, Array]:
    """Guess the column of times; return it, and the times of the rows, s."""
    counted = next((name for name in table.named if names.plain(name) in COUNTERS), None)
    label = names.single(table.named, "time")
    if label is not None and np.isnan(table[label]).all():
        label = None
    other = _beside(table, "time") if label is None and counted is None and table.named else None
    if other is not None:
        t = _stamps(found, other, names.single(other.named, "time"), known.rate_hz)
        found.mapping["time"] |= _file(table, other)
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


def _stamps(found: Guess, table: _Columns, label: Any, rate_hz: float | None) -> Array:
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


def _inertial(found: Guess, table: _Columns, time: Any, t: Array, known: Known) -> None:
    """Guess the columns and units of gyros and accelerometers, the axes, the fixes and the site."""
    steps = np.diff(t)
    rate = float(1.0 / np.median(steps)) if len(t) > 1 and np.median(steps) > 0 else float("nan")
    (accels, accel), (gyros, gyro) = _sensors(table, time, rate)
    force, turn = accels.three(accel), gyros.three(gyro)
    there: Mask = np.asarray(np.isfinite(np.hstack([force, turn])).all(axis=1))
    if not there.all():
        raise ValueError(
            f"{table.path}: {int((~there).sum())} of {len(there)} rows have blank IMU columns; allowed: a table with all of them "
            "in every row"
        )
    increments = _units(found, gyros, gyro, accels, accel, rate)
    found.mapping["gyro"] |= _file(table, gyros)
    found.mapping["accel"] |= _file(table, accels)
    fixes = _fixes(found, table, time, known)
    _axes(found, known, t, force, fixes, rate, increments)
    if known.site is not None:
        found.add("site", list(known.site), ", ".join(f"{x:g}" for x in known.site), "as told")
    elif "gnss" not in found.mapping:
        found.open.append(
            'site: no latitude and longitude; write "site": [latitude deg, longitude deg, height m] (or give --site, or --gnss)'
        )


def _shown(columns: list[Any]) -> str:
    return ", ".join(map(str, columns))


def _sensors(table: _Columns, time: Any, rate: float) -> list[tuple[_Columns, list[Any]]]:
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


def _named_sensor(table: _Columns, role: str, rate: float) -> tuple[_Columns, list[Any]]:
    several: list[list[Any]] = [
        list(one) for one in names.triples(table.named, role) if np.isfinite(table.three(one)).any()
    ]
    fits = [one for one in several if role == "accel" and measures.force_units(table.three(one), rate)]
    if several:
        return table, (fits or several)[0]
    other = _beside(table, role)
    if other is not None:
        return other, list(next(names.triples(other.named, role)))
    what, such = ("accelerometers", "acc_x") if role == "accel" else ("gyros", "gyro_x")
    raise ValueError(
        f"{table.path}: no three columns named as those of {what}; allowed: names such as {such}, here or in one table beside it "
        f"with as many rows; columns there: {_shown(table.labels)}"
    )


def _units(found: Guess, gyros: _Columns, gyro: list[Any], accels: _Columns, accel: list[Any], rate: float) -> bool:
    """Guess the units; return whether the values are increments."""
    force, turn = accels.three(accel), gyros.three(gyro)
    fits = measures.force_units(force, rate)
    written = accels.written(accel[0])
    chosen = next((one for one in fits if one.name == written), fits[0] if fits and written is None else None)
    size = float(np.median(np.linalg.norm(measures.seconds_means(force, rate), axis=1)))
    if chosen is None:
        said = f" (the header says {written})" if written else ""
        found.add("accel", {"columns": accel}, _shown(accel), "by name")
        found.open.append(
            f'accel: |f| is {size:.5g}{said}, which is gravity in no unit; write "unit" and, for counts, "scale" '
            "(for acceleration without gravity nothing helps: log the specific force)"
        )
        increments = False
    else:
        why = f"{chosen.why}{', and the header says so' if written else ''}"
        found.add("accel", {"columns": accel, "unit": chosen.name}, f"{_shown(accel)} in {chosen.name}", why)
        increments = not column_units.ACCEL[chosen.name].rate
    turns = [] if chosen is None else measures.rate_units(turn, force, rate, increments)
    said_ = gyros.written(gyro[0])
    if said_ in column_units.GYRO and (not turns or said_ in [one.name for one in turns]):
        why = next((f"{one.why}, and the header says so" for one in turns), "the header says so")
        found.add("gyro", {"columns": gyro, "unit": said_}, f"{_shown(gyro)} in {said_}", why)
    elif len(turns) == 1 and said_ not in column_units.GYRO:
        found.add("gyro", {"columns": gyro, "unit": turns[0].name}, f"{_shown(gyro)} in {turns[0].name}", turns[0].why)
    else:
        found.add("gyro", {"columns": gyro}, _shown(gyro), "by name")
        what = f"the header says {said_}, the numbers {turns[0].name} ({turns[0].why})" if turns and said_ else (
            "neither the earth's rate nor the turning of gravity shows the unit"
        )  # fmt: skip
        kind = ", ".join(name for name, unit in column_units.GYRO.items() if unit.rate != increments)
        found.open.append(f'gyro: {what}; write "unit" in gyro, one of {kind}')
    return increments


def _fixes(found: Guess, table: _Columns, time: Any, known: Known) -> tuple[Array, Array] | None:
    """Guess the fixes in the table, or in a file of their own; return their times and speeds, if they have velocities."""
    source = table
    if known.gnss is not None:
        path = table.path.parent / known.gnss
        if rtklib.holds_fixes(path):
            found.add("gnss", known.gnss, known.gnss, "a solution of RTKLIB")
            return None
        source = _columns(path)
        time = names.single(source.named, "time")
    place = [names.single(source.named, role) for role in ("latitude", "longitude", "height")]
    if None in place or time is None or not np.isfinite(source.three(place)).any():
        if known.gnss is not None:
            raise ValueError(
                f"{source.path}: no columns named as time, latitude, longitude and height; columns there: {_shown(source.labels)}"
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
        if source is table:
            vel = source.three(columns)[there]
            t = _seconds(found, table)[there]
            speeds = (t, np.linalg.norm(vel[:, :2], axis=1) * (1e-3 if scale else 1.0))
    std = [names.single(source.named, role) for role in ("std_east", "std_north", "std_up")]
    if None not in std:
        spec["position_std"] = {"columns": std, "frame": "ENU"}
    held = int((np.abs(np.diff(llh, axis=0)).sum(axis=1) == 0).sum()) if len(llh) > 1 else 0
    if source is table and there.all() and held > 0.5 * len(llh):
        found.add("drop_held_fixes", True, "true", "every row has a fix, and most of them repeat the one before")
    shown = f"{_shown(place)}{'; ' + _shown(columns) if speeds is not None or None not in columns else ''}"
    found.add("gnss", spec, shown, f"{int(there.sum())} rows with a fix, in {spec['position'].get('unit', 'deg')}")
    return speeds


def _seconds(found: Guess, table: _Columns) -> Array:
    spec = found.mapping["time"]
    unit = spec.get("unit", "s")
    values = table[spec["column"]]
    values = unwrapped(values, spec["wraps"]) if "wraps" in spec else values
    return values * (column_units.TIME[unit] if isinstance(unit, str) else unit)


def _fix_time(source: _Columns, label: Any, found: Guess) -> dict[str, Any]:
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


def _axes(
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
