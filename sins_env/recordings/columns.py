"""Columns of a text table that an object of a mapping names: numbers in SI, times, vectors in East-North-Up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sins_env import checks
from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.recordings import column_units
from sins_env.recordings.assembling import geodetic
from sins_env.recordings.axes import swap_ned
from sins_env.recordings.mapping import Mapping, companion
from sins_env.recordings.stamps.scales import WEEK_S
from sins_env.recordings.stamps.wraps import check_increasing, unrolled
from sins_env.recordings.text import Head, Style, Table, read_head, read_table
from sins_env.recordings.text.dates import is_date, seconds_of_parts
from sins_env.recordings.times import MOST_WEEK, Times, told

FRAMES = ("ENU", "NED")  #: allowed frames of vectors
FIELD_KEYS = ("column", "columns", "unit", "frame", "scale", "file")  #: keys of the object of a field
TIME_KEYS = ("column", "columns", "unit", "week", "scale", "wraps", "file")  #: keys of an object of times
DATES = "calendar"  #: unit of dates
PARTS_OF_DATE = 6  #: year, month, day, hour, minute, second


@dataclass(frozen=True)
class Part:
    """Columns of a file that one object of the mapping names."""

    path: Path
    style: Style
    measured: bool  #: whether the delimiter is measured
    spec: dict[str, Any]  #: description of each field, {"columns": [...], "unit": ...}
    optional: bool = False  #: whether a row may lack all of the fields but the time

    @cached_property
    def head(self) -> Head:
        """The head of the file."""
        named = any(isinstance(column, str) for spec in self.spec.values() for column in _named(spec))
        style = replace(self.style, header=True) if named and self.style.header else self.style
        return read_head(self.path, style, self.measured)

    @cached_property
    def _columns(self) -> dict[str, list[int]]:
        """Places of the columns of each field, counted from 0."""
        head = self.head
        if not head.fields:
            raise ValueError(f"{self.path}: no rows of numbers")
        names, found = list(head.names), {}
        for field, spec in self.spec.items():
            found[field] = [self._place(field, column, names) for column in _named(spec)]
        if names and len(head.fields) != len(names):
            extra = head.fields[len(names) :]
            if len(head.fields) < len(names) or any(extra):
                delimiter = {" ": "white space", "\t": "tab"}.get(head.style.delimiter or "", head.style.delimiter)
                raise ValueError(
                    f"{self.path}: line {head.line} has {len(head.fields)} columns (delimiter {delimiter!r}), the header "
                    f"{len(names)} names; allowed: a name for every column, or columns by number with another skip_lines"
                )
        return found

    def _place(self, field: str, column: Any, names: list[str]) -> int:
        many = len(self.head.fields) if not names else len(names)
        if isinstance(column, str):
            if column in names:
                return names.index(column)
            short = [i for i, name in enumerate(names) if name.partition("[")[0].partition("(")[0].strip() == column]
            if len(short) == 1:  # a name without its unit
                return short[0]
            if not names:
                raise ValueError(
                    f"{self.path}: column of {field} is {column!r}, and no header has names; allowed: a whole number from 1 "
                    f"to {many}"
                )
            raise ValueError(f"{self.path}: {unknown(f'column of {field}', column, names)}")
        if isinstance(column, int) and not isinstance(column, bool) and 1 <= column <= many:
            return column - 1
        allowed = f"a name of the header line, or a whole number from 1 to {many}, the columns of line {self.head.line}"
        raise ValueError(f"{self.path}: {checks.refused(f'column of {field}', column, allowed)}")

    @cached_property
    def _table(self) -> tuple[list[int], Table]:
        """The places of the columns of numbers, and the table with them, followed by dates."""
        date = self._date
        wanted = sorted(
            {place for field, places in self._columns.items() for place in places if field != "time" or not date}
        )
        blanks = []
        if self.optional:
            times = set(self._columns["time"])
            blanks = [place for place in wanted if place not in times]
        dates = [tuple(self._columns["time"])] if date else []
        return wanted, read_table(self.path, None, self.head, wanted, blanks, dates)

    @cached_property
    def _date(self) -> bool:
        """Whether the times are dates in text."""
        places = self._columns.get("time", [])
        if (
            not places
            or len(places) == PARTS_OF_DATE
            or "week" in self.spec["time"]
            or max(places) >= len(self.head.fields)
        ):
            return False
        told_ = self.spec["time"].get("unit")
        first = "T".join(self.head.fields[i] for i in places)
        return told_ == DATES or len(places) == 2 or (told_ is None and is_date(first))

    @cached_property
    def _there(self) -> Any:
        """Which rows hold the fields: all, unless the part is optional."""
        wanted, table = self._table
        if not self.optional:
            return slice(None)
        times = set(self._columns["time"])
        blank = np.isnan(table.rows[:, [i for i, place in enumerate(wanted) if place not in times]])
        half = np.flatnonzero(blank.any(axis=1) & ~blank.all(axis=1))
        if len(half):
            where = table.place(int(half[0]))
            raise ValueError(
                f"{self.path}: {where} has a part of a fix; allowed: all of its columns, or all of them blank"
            )
        if blank.all():
            raise ValueError(
                f"{self.path}: no row holds a fix; allowed: a fix in some row, or a mapping without these columns"
            )
        return np.flatnonzero(~blank.any(axis=1))

    def __getitem__(self, field: str) -> Array:
        """Return the columns of a field, (n, columns), times the scale that the mapping tells."""
        wanted, table = self._table
        return self._scaled(field, table.rows[self._there][:, [wanted.index(place) for place in self._columns[field]]])

    def view(self, field: str) -> Array:
        """Return the same without a copy, if the columns stand side by side in the file and the mapping tells no scale."""
        wanted, table = self._table
        places = [wanted.index(place) for place in self._columns[field]]
        if places != list(range(places[0], places[0] + len(places))):
            return self[field]
        return self._scaled(field, table.rows[self._there][:, places[0] : places[-1] + 1])

    def _scaled(self, field: str, values: Array) -> Array:
        scale = self.spec[field].get("scale")
        if scale is None:
            return values
        many = values.shape[1]
        given = [scale] * many if isinstance(scale, (int, float)) else scale
        return values * np.array(checks.numbers(f"scale of {field}", given, many, f"a number, or {many} of them"))

    def release(self) -> None:
        """Forget the numbers, which are a third of the memory while a large file is read; places of rows stay known."""
        wanted, table = self._table
        there = self._there
        self.__dict__.update(_table=(wanted, replace(table, rows=table.rows[:0].copy())), _there=there)

    def place(self, row: int) -> str:
        """Return the place of a row in the file."""
        there = self._there
        return self._table[1].place(row if isinstance(there, slice) else int(there[row]))

    def unit(self, field: str, allowed: Any, default: str | None = None) -> Any:
        """Return the value of the unit of a field.

        Raises:
            ValueError: no unit of this name, or another one than the file says.
        """
        given = self.spec[field].get("unit", default)
        if not isinstance(given, str) or given not in allowed:
            raise ValueError(f"{self.path}: {unknown(f'unit of {field}', given, allowed)}")
        self._check_written(field, given, allowed)
        return allowed[given]

    def _check_written(self, field: str, given: str, allowed: Any) -> None:
        """Hold a unit against those that the header, or the row below it, writes beside the names.

        Raises:
            ValueError: the file has another one.
        """
        head = self.head
        if self.spec[field].get("scale") is not None or not all(isinstance(c, str) for c in _named(self.spec[field])):
            return
        for place in self._columns[field]:
            texts = [*head.names[place : place + 1], *head.units[place : place + 1]]
            written = [unit for text in texts if (unit := column_units.written(text))]
            for unit in written:
                if unit in allowed and allowed[unit] != allowed[given]:
                    raise ValueError(
                        f"{self.path}: unit of {field} is {given!r}, and the header says {unit!r} of column {place + 1} "
                        f"({texts[-1][:40]!r}); allowed: that unit, or the columns by number if the header is wrong"
                    )

    def enu(self, field: str) -> Array | None:
        """Return the vectors of a field in East-North-Up, (n, 3); None if the file has none.

        Raises:
            ValueError: no frame of this name.
        """
        if field not in self.spec:
            return None
        frame = self.spec[field].get("frame")
        if frame not in FRAMES:
            raise ValueError(f"{self.path}: {unknown(f'frame of {field}', frame, FRAMES)}")
        return swap_ned(self[field]) if frame == "NED" else self[field]

    def times(self) -> Times:
        """Return the times of the rows, as they are.

        Raises:
            ValueError: a unit or a scale of no such name, or numbers that are no times.
        """
        spec, (wanted, table) = self.spec["time"], self._table
        scale = spec.get("scale")
        if self._date:
            return told(table.rows[self._there][:, -1], scale or "UTC")
        columns = table.rows[self._there][:, [wanted.index(place) for place in self._columns["time"]]]
        if columns.shape[1] == PARTS_OF_DATE:
            t = seconds_of_parts(columns)
            bad = np.flatnonzero(~np.isfinite(t))
            if len(bad):
                raise ValueError(
                    f"{self.path}: time is {columns[bad[0]]} at {self.place(int(bad[0]))}; allowed: year, month, day, "
                    "hour, minute, second"
                )
            return told(t, scale or "UTC")
        t = columns[:, 0]
        if spec.get("wraps") is not None:
            t = unwrapped(
                t, checks.number("wraps of time", spec["wraps"], "the number of values of its counter", above=1.0)
            )
        else:
            self._check_wraps(t)
        t = t * self._time_unit(spec.get("unit", "s"))
        if "week" in spec:
            week = columns[:, 1]
            bad = np.flatnonzero((week != np.rint(week)) | (week < 0) | (week > MOST_WEEK))
            if len(bad):
                at = self.place(int(bad[0]))
                raise ValueError(
                    f"{self.path}: week is {week[bad[0]]:g} at {at}; allowed: a whole number, 0 to {MOST_WEEK}"
                )
            return told(week * WEEK_S + t, scale or "GPS")
        return told(unrolled(t), scale)

    def _check_wraps(self, counts: Array) -> None:
        """Check that times do not begin again at 0 as a counter of 16 or 32 bits does.

        Raises:
            ValueError: they do; the error says what reads them.
        """
        back = np.flatnonzero(np.diff(counts) < 0)
        for bits in (16, 32) if len(back) and (counts == np.rint(counts)).all() else ():
            before, after = counts[back[0]], counts[back[0] + 1]
            if counts.max() < 2**bits and before - after > 2 ** (bits - 1):
                raise ValueError(
                    f"{self.path}: time runs from {before:.0f} to {after:.0f} at {self.place(int(back[0]) + 1)}, as a counter "
                    f'of {bits} bits does; allowed: "wraps": {2**bits} in time'
                )

    def _time_unit(self, given: Any) -> float:
        if isinstance(given, str) and given in column_units.TIME:
            value: float = column_units.TIME[given]
            return value
        if isinstance(given, str):
            told = unknown("unit of time", given, (*column_units.TIME, DATES))
            raise ValueError(f"{self.path}: {told}, or its seconds as a number, such as 1e-4 for 0.1 ms")
        return checks.number(
            "unit of time", given, f"{', '.join(column_units.TIME)}, or its seconds, such as 1e-4", above=0.0
        )

    def increasing(self) -> Times:
        """Return the times of the rows, which must ascend.

        Raises:
            ValueError: times that repeat or run back, besides what ``times`` raises.
        """
        found = self.times()
        check_increasing(str(self.path), "time", self.place, found.t)
        return found

    def position(self) -> Array:
        """Return latitude rad, longitude rad and height m, (n, 3)."""
        llh = self["position"]
        return geodetic(self.path, "position", self.place, llh, self.unit("position", column_units.ANGLE, "deg"))


def unwrapped(counts: Array, values: float) -> Array:
    """Return counts that begin again at 0 after ``values`` of them, (n,), without these jumps."""
    back = np.diff(counts, prepend=counts[:1]) < -0.5 * values
    return counts + values * np.cumsum(back)


def _named(spec: dict[str, Any]) -> list[Any]:
    """Return the columns of a field, by names or numbers; a week stands behind its seconds."""
    columns = [spec["column"]] if "column" in spec else list(spec["columns"])
    return [*columns, spec["week"]] if "week" in spec else columns


def make_part(
    path: Path,
    mapping: Mapping,
    whose: str,
    given: Any,
    keys: tuple[str, ...],
    counts: dict[str, tuple[tuple[int, ...], bool]],
    optional: bool = False,
) -> Part:
    """Check an object of the mapping, and return its columns.

    ``counts`` has the allowed numbers of columns of each field, and whether it is needed.

    Raises:
        ValueError: an object of another form.
        FileNotFoundError: no such file beside the recording's own.
    """
    if not isinstance(given, dict):
        raise checks.refused(f"{whose} of the mapping of {path.name}", given, f"an object of {', '.join(keys)}")
    for key in given:
        if key not in keys:
            raise unknown(f"key of {whose} in the mapping of {path.name}", key, keys)
    spec = {key: value for key, value in given.items() if key != "file" and value is not None}
    for field, (count, needed) in counts.items():
        if field not in spec:
            if needed:
                raise ValueError(f"{path}: {whose} without {field!r}; allowed: a mapping that names its columns")
            continue
        _check_field(path, field, spec[field], count)
    where = companion(path, given["file"], f"{whose} of the mapping of {path.name}") if "file" in given else path
    return Part(where, mapping.style(), mapping.delimiter is None, spec, optional)


def _check_field(path: Path, field: str, value: Any, count: tuple[int, ...]) -> None:
    columns: Any = None
    if isinstance(value, dict) and len({"column", "columns"} & value.keys()) == 1:
        columns = [value["column"]] if "column" in value else value["columns"]
    if not isinstance(columns, list) or len(columns) not in count:
        allowed = f'{{"columns": [{" or ".join(map(str, count))} of them], "unit": ...}}'
        raise checks.refused(f"{field} of the mapping of {path.name}", value, allowed)
    keys = TIME_KEYS if field in ("time", "counter") else FIELD_KEYS
    for key in value:
        if key not in keys:
            raise unknown(f"key of {field} in the mapping of {path.name}", key, keys)
