"""Tables in a narrow terminal or a pipe: nothing in them is cut."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

from rich.console import Console
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text

LEAST_FOLDED = 24  #: least width of a column whose text folds anywhere
_BETWEEN = 3  #: most characters from one column to the next


def whole(table: Table, width: int) -> list[Table]:
    """Return a table as it is, or as several of which each fits the width, so that no number and no word is cut.

    The first column leads each of them. Headings break at spaces.
    """
    console = Console(width=10_000)
    if Measurement.get(console, console.options, table).maximum <= width:
        return [table]
    least = [_least(column, console) for column in table.columns]
    parts: list[list[int]] = [[0]]
    room = width - 1 - least[0] - _BETWEEN
    left = room
    for i, need in enumerate(least[1:], start=1):
        if need + _BETWEEN > left and len(parts[-1]) > 1:
            parts.append([0])
            left = room
        parts[-1].append(i)
        left -= need + _BETWEEN
    found = []
    for number, part in enumerate(parts):
        one = copy(table)
        one.columns = [_fixed(table.columns[i], j, least[i]) for j, i in enumerate(part)]
        one.title = table.title if number == 0 else None
        one.caption = table.caption if number == len(parts) - 1 else None
        found.append(one)
    return found


def _least(column: Column, console: Console) -> int:
    """Return the least width at which nothing in a column is cut, and no number of it broken."""
    header = Text.from_markup(column.header) if isinstance(column.header, str) else column.header
    cells = [Measurement.get(console, console.options, cell) for cell in column.cells]
    longest = max((cell.maximum for cell in cells), default=0)
    if _folds(column):
        return min(longest, LEAST_FOLDED)
    numbers = column.no_wrap or column.justify == "right"
    head = Measurement.get(console, console.options, header).minimum
    return max(head, longest if numbers else max((cell.minimum for cell in cells), default=0))


def _folds(column: Column) -> bool:
    return column.overflow == "fold" and not column.no_wrap


def _fixed(column: Column, place: int, width: int) -> Column:
    """Return a column in its new place; only one that folds takes what room is left."""
    one = replace(column, _index=place)
    return one if _folds(column) else replace(one, width=width, no_wrap=False)
