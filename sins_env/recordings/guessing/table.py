"""The table that is measured, what the user knows, and the mapping as it is found."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.recordings import column_units
from sins_env.recordings.guessing import names
from sins_env.recordings.text import Head, Style, read_head, read_table
from sins_env.recordings.text.dates import is_date
from sins_env.recordings.text.style import COMMENTS

MOST_BESIDE = 50  #: most files of a folder among which parts of a recording are sought
MOST_ROWS = 200_000  #: most rows that are measured


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
class Columns:
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


def columns_of(path: Path) -> Columns:
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
    return Columns(path, head, labels, values)


def beside(table: Columns, role: str) -> Columns | None:
    """Return the only table beside this one that has as many rows and the columns of a role, as gnss-ins-sim writes them."""
    found = []
    for path in sorted(table.path.parent.glob(f"*{table.path.suffix}"))[:MOST_BESIDE]:
        if path == table.path:
            continue
        try:
            names_ = list(read_head(path, Style(COMMENTS, None, ".", None), measured=True).names)
            there = names.single(names_, role) if role == "time" else next(names.triples(names_, role), None)
            other = columns_of(path) if there else None
        except ValueError:
            continue
        if other is not None and len(other.values) == len(table.values):
            found.append(other)
    return found[0] if len(found) == 1 else None


def file_key(table: Columns, of: Columns) -> dict[str, str]:
    """Return the key of a file of its own."""
    return {} if of is table else {"file": of.path.name}


def _blank(text: str) -> bool:
    return text.lower() in ("", "nan", "null", "none", "n/a", "na", "-", "--")


def listed(columns: list[Any]) -> str:
    return ", ".join(map(str, columns))
