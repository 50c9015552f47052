"""The reader of text tables: a fast path for blocks of sound lines, and a search for the reason in a block that fails."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.reading.files import text_blocks
from sins_env.recordings.text.dates import FORMS, calendar_seconds
from sins_env.recordings.text.head import Head, first_lines, read_head
from sins_env.recordings.text.style import BLANKS, PLAIN, SEPARATOR, SPACE, Style, plain_exponents

MOST_FIELD = 40  #: most characters of a field that an error repeats


class _Block(NamedTuple):
    """Rows of a part of the file."""

    numbers: range | list[int]  #: number of the line of each row
    lines: list[str]


@dataclass(frozen=True)
class Table:
    """The numbers of a file."""

    path: Path
    head: Head
    rows: Array  #: (n, columns that were asked for, then dates) numbers
    _numbers: list[range | list[int]] = field(repr=False, default_factory=list)

    def place(self, row: int) -> str:
        """Return the place of a row in the file, such as 'line 17'."""
        for numbers in self._numbers:
            if row < len(numbers):
                return f"line {numbers[row]}"
            row -= len(numbers)
        return f"row {row + 1}"


def header(path: Path, style: Style) -> list[str]:
    """Return the fields of the first row of a table.

    Raises:
        ValueError: no text file of lines.
    """
    return next((fields for line in first_lines(path)[style.skip_lines :] if (fields := style.fields(line))), [])


def read_table(
    path: Path,
    counts: Sequence[int] | None,
    style: Style | Head = PLAIN,
    columns: Sequence[int] | None = None,
    blanks: Sequence[int] = (),
    dates: Sequence[tuple[int, ...]] = (),
    most_rows: int | None = None,
) -> Table:
    """Read every row of a file.

    Args:
        path: the file.
        counts: numbers of columns that the rows, which are all alike, may have; None takes that of the first row.
        style: the way in which the file writes its table, or its head, which has been read with it.
        columns: which columns of numbers to keep, counted from 0; None keeps all.
        blanks: those of them that may be blank, which gives NaN.
        dates: columns that together hold a date, counted from 0; each becomes a column of seconds since 1980-01-06.
        most_rows: number of rows from which on no more are read; None reads all.

    Raises:
        ValueError: no such table; the error names the line and the column at fault.
        OSError: no such file, or one that cannot be read.
    """
    head = style if isinstance(style, Head) else read_head(path, style, counts=counts)
    return _Reader(path, head, counts, columns, tuple(blanks), tuple(dates)).read(most_rows)


@dataclass(frozen=True)
class _Reader:
    path: Path
    head: Head
    counts: Sequence[int] | None
    columns: Sequence[int] | None
    blanks: tuple[int, ...]
    dates: tuple[tuple[int, ...], ...]

    def read(self, most_rows: int | None) -> Table:
        width = len(self.head.fields)
        if not width:
            raise ValueError(f"{self.path}: no rows of numbers")
        wanted = [*(self.columns or ()), *(place for date in self.dates for place in date)]
        if wanted and max(wanted) >= width:
            asked = f"column {max(wanted) + 1} is asked for; allowed: a number in each row for every name of the header"
            raise ValueError(f"{self.path}: line {self.head.line} has {width} columns, and {asked}")
        rows, filled = np.empty((0, 0)), 0
        numbers: list[range | list[int]] = []
        blocks = self._blocks()
        for block in blocks:
            try:
                part = self._values(block.lines)
                fault = None if self._sound(part) else self._fault(block)
            except ValueError as error:
                fault = self._fault(block)
                if fault is None:
                    raise ValueError(f"{self.path}: lines {block.numbers[0]} on: {error}") from None
            if fault is not None:
                row, text = fault
                last = row == len(block.lines) - 1 and "columns" in text and next(blocks, None) is None
                raise ValueError(f"{self.path}: {text}{' (the last line: a truncated file?)' if last else ''}")
            if filled == 0:
                rows = np.empty(part.shape)
            elif filled + len(part) > len(rows):  # grown in place, without a second copy of everything
                rows.resize((filled + filled // 4 + len(part), part.shape[1]), refcheck=False)
            rows[filled : filled + len(part)] = part
            filled += len(part)
            numbers.append(block.numbers)
            if most_rows is not None and filled >= most_rows:
                break
        if not filled:
            raise ValueError(f"{self.path}: no rows of numbers")
        rows.resize((filled, rows.shape[1]), refcheck=False)
        return Table(self.path, self.head, rows, numbers)

    def _blocks(self) -> Iterator[_Block]:
        """Yield the rows of data in blocks."""
        style, before = self.head.style, 0
        for lines in text_blocks(self.path):
            start = max(self.head.first - before, 0)
            if start < len(lines):
                kept, first = lines[start:], before + start + 1
                numbers: range | list[int] = range(first, first + len(kept))
                text = "\n".join(kept)
                marked = any(mark in text for mark in style.comments)
                bare = [style.bare(line) for line in kept] if marked else kept
                if not all(bare) or any(map(str.isspace, bare)):
                    here = [i for i, line in enumerate(bare) if line and not line.isspace()]
                    numbers, bare = [first + i for i in here], [bare[i] for i in here]
                if bare:
                    yield _Block(numbers, bare)
            before += len(lines)

    def _values(self, lines: list[str]) -> Array:
        """Return the numbers of a block of rows.

        Raises:
            ValueError: rows of other forms.
        """
        style = self.head.style
        delimiter = style.delimiter
        if delimiter not in (None, SPACE) and any('"' in line for line in lines):
            lines, delimiter = style.unquoted(lines), SEPARATOR
        width = len(self.head.fields)
        if delimiter in (None, SPACE):
            if delimiter is None and style.decimal == ".":
                lines = [line.replace(",", " ") for line in lines]
            even = self.columns is None or all(len(line.split()) == width for line in lines)
        else:
            even = all(line.count(delimiter) == width - 1 for line in lines)
        if not even:
            raise ValueError(f"rows of another number of columns than {width}")
        dates = [self._dates(lines, delimiter, date) for date in self.dates]
        if style.decimal == ",":
            lines = [line.replace(",", ".") for line in lines]
        text = "\n".join(lines)
        exact = plain_exponents(text)
        if self.blanks:
            mark = re.escape(delimiter or SPACE)
            words = "|".join(re.escape(word) for word in BLANKS if word)
            exact = re.sub(rf"(?im)(^|{mark})[ ]*(?:{words})?[ ]*(?=$|{mark})", r"\1nan", exact)
        lines = lines if exact is text else exact.split("\n")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values = np.loadtxt(
                lines,
                comments=None,
                delimiter=None if delimiter == SPACE else delimiter,
                usecols=None if self.columns is None else list(self.columns),
                ndmin=2,
            )
        if self.columns is None and values.shape[1] != width:
            raise ValueError(f"rows of another number of columns than {width}")
        return np.column_stack([values, *dates]) if dates else np.asarray(values)

    def _dates(self, lines: list[str], delimiter: str | None, places: tuple[int, ...]) -> Array:
        split = [line.split(None if delimiter == SPACE else delimiter) for line in lines]
        return calendar_seconds(["T".join(row[i].strip(" '") for i in places) for row in split])

    def _sound(self, part: Array) -> bool:
        """Return whether all numbers are finite, but for those that may be blank, and all rows are of an allowed width."""
        if self.counts is not None and len(self.head.fields) not in self.counts:
            return False
        finite = np.isfinite(part)
        if finite.all():
            return True
        if not self.blanks or self.columns is None:
            return False
        may = np.isin(np.arange(part.shape[1]), [list(self.columns).index(i) for i in self.blanks])
        return bool((finite | (may & np.isnan(part))).all())

    def _fault(self, block: _Block) -> tuple[int, str] | None:
        """Return the first row at fault and what is wrong with it; None if every row is sound."""
        style, width = self.head.style, len(self.head.fields)
        counts = (width,) if self.counts is None or width in self.counts else self.counts
        *most, last = map(str, counts)
        allowed = f"{', '.join(most)} or {last}" if most else last
        for row, line in enumerate(block.lines):
            number = block.numbers[row]
            try:
                fields = style.fields(line)
            except ValueError as error:
                return row, f"line {number} has {error}; allowed: quotes in pairs"
            if len(fields) not in counts:
                return row, f"line {number} has {len(fields)} columns; allowed: {allowed}{self._advice(line, counts)}"
            dated = {place for date in self.dates for place in date}
            for i in range(len(fields)) if self.columns is None else self.columns:
                if i in dated or (i in self.blanks and fields[i].lower() in BLANKS):
                    continue
                if not math.isfinite(style.number(fields[i])):
                    found = f"line {number}, column {i + 1} is {fields[i][:MOST_FIELD]!r}"
                    return row, f"{found}; allowed: a finite number{self._hint(row, i, fields)}"
            for date in self.dates:
                if not math.isfinite(calendar_seconds(["T".join(fields[i] for i in date)])[0]):
                    found = " ".join(fields[i] for i in date)[:MOST_FIELD]
                    return row, f"line {number}, column {date[0] + 1} is {found!r}; allowed: {FORMS}"
        return None

    def _advice(self, line: str, counts: Sequence[int]) -> str:
        """Return the delimiter that would give a row an allowed number of columns."""
        style = self.head.style
        if style.decimal == "." and "," in line and style.delimiter in (None, SPACE) and len(line.split()) in counts:
            return ' with "decimal": "," in the mapping'
        return ""

    def _hint(self, row: int, place: int, fields: list[str]) -> str:
        text = fields[place]
        if self.head.style.decimal == "." and math.isfinite(Style(decimal=",").number(text)) and "," in text:
            return ' with a decimal point, or "decimal": "," in the mapping'
        if row == 0 and self.head.style.words_only(fields):
            return ', or "skip_lines" in the mapping for what stands before the table'
        return ""
