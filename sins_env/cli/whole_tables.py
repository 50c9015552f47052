"""Tables in a narrow terminal or a pipe: nothing in them is cut."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

from rich.console import Console
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text

LEAST_FOLDED = 24  #: least width of a column whose text folds anywhere


def whole(table: Table, width: int) -> list[Table]:
    """Return a table as it is, or as several of which each fits the width, so that no number and no word is cut.

    The first column leads each of them.
    """
    console = Console(width=10_000)

    def least(column: Column) -> int:
        header = Text.from_markup(column.header) if isinstance(column.header, str) else column.header
        sizes = [Measurement.get(console, console.options, part) for part in (header, *column.cells)]
        if column.overflow == "fold" and not column.no_wrap:
            return min(max(size.maximum for size in sizes), LEAST_FOLDED)
        return max(size.maximum if column.no_wrap else size.minimum for size in sizes)

    first, *others = table.columns
    between = 3  # at most, from one column to the next
    room = width - least(first) - between - 1
    parts: list[list[Column]] = [[]]
    left = room
    for column in others:
        need = least(column) + between
        if need > left and parts[-1]:
            parts.append([])
            left = room
        parts[-1].append(column)
        left -= need
    if len(parts) == 1:
        return [table]
    found = []
    for i, part in enumerate(parts):
        one = copy(table)
        one.columns = [replace(column, _index=j) for j, column in enumerate([first, *part])]
        one.title, one.caption = table.title if i == 0 else None, table.caption if i == len(parts) - 1 else None
        found.append(one)
    return found
