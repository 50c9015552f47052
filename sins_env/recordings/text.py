"""Tables of numbers in text files: a fast reader, and after a failure a search for the reason line by line."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from sins_env.arrays import Array
from sins_env.reading.files import check_lines
from sins_env.writing.files import replacing

_CHUNK = 20_000  #: rows that are formatted at once


@dataclass(frozen=True)
class Style:
    """The way in which a text file separates its numbers."""

    comment: str = "#"
    delimiter: str | None = None  #: one character; None stands for white space and commas
    header: bool = False  #: whether the first line that is no comment holds names

    def fields(self, line: str) -> list[str]:
        """Return the fields of a line; an empty line or a comment has none."""
        body = line.partition(self.comment)[0].strip() if self.delimiter is None else line.rstrip("\r\n")
        if not body.strip() or body.lstrip().startswith(self.comment):
            return []
        if self.delimiter is None:
            return body.replace(",", " ").split()
        return [part.strip() for part in body.split(self.delimiter)]


@dataclass(frozen=True)
class Table:
    """The numbers of a file."""

    path: Path
    style: Style
    rows: Array  #: (n, columns that were asked for) numbers, all finite

    def place(self, row: int) -> str:
        """Return the place of a row in the file, such as 'line 17'."""
        number, _ = next(islice(_lines(self.path, self.style), row, None), (None, []))
        return f"row {row + 1}" if number is None else f"line {number}"  # the file may have become shorter meanwhile


def read_table(
    path: Path, counts: Sequence[int] | None, style: Style = Style(), columns: Sequence[int] | None = None
) -> Table:
    """Read every row of a file.

    Args:
        path: the file.
        counts: numbers of columns that the lines, which are all alike, may have; None takes that of the first line.
        style: the way in which the file separates its numbers.
        columns: which columns to keep, counted from 0; None keeps all.

    Raises:
        ValueError: no table of finite numbers; the error names the line and the column at fault.
    """
    check_lines(path)
    number, first = next(_lines(path, style), (0, []))
    if not first:
        raise ValueError(f"{path}: no rows of numbers")
    width = len(first)
    if columns and max(columns) >= width:
        asked = f"column {max(columns) + 1} is asked for; allowed: a number in each row for every name of the header"
        raise ValueError(f"{path}: line {number} has {width} columns, and {asked}")
    if counts is not None and width not in counts:
        raise _explain(path, style, counts, columns) or AssertionError("unreachable")
    try:
        rows = _fast(path, style, columns)
    except ValueError as error:
        raise _explain(path, style, (width,), columns) or ValueError(f"{path}: {error}") from None
    if not np.isfinite(rows).all() or (columns is not None and not _even(path, style, width)):
        wrong = _explain(path, style, (width,), columns)
        if wrong:
            raise wrong
    return Table(path, style, rows)


def _even(path: Path, style: Style, width: int) -> bool:
    """Return whether every line has the same number of columns; NumPy ignores those that it is not asked for."""
    if style.delimiter is None:
        return all(len(fields) == width for _, fields in _lines(path, style))
    separators = width - 1
    with open(path, encoding="utf-8-sig", errors="replace") as stream:
        return all(line.count(style.delimiter) == separators for line in stream if style.fields(line[:80]))


def _fast(path: Path, style: Style, columns: Sequence[int] | None) -> Array:
    with open(path, encoding="utf-8-sig", errors="replace") as stream, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # NumPy warns of an empty file
        lines: Any = stream
        if style.delimiter is None and "," in stream.read(1 << 16):
            lines = (line.replace(",", " ") for line in stream)
        stream.seek(0)
        skip = next(_lines(path, Style(style.comment, style.delimiter)))[0] if style.header else 0
        rows = np.loadtxt(
            lines, comments=style.comment, delimiter=style.delimiter, skiprows=skip, usecols=columns, ndmin=2
        )
    return np.asarray(rows)


def header(path: Path, style: Style) -> list[str]:
    """Return the fields of the first line that is no comment.

    Raises:
        ValueError: no text file of lines.
    """
    check_lines(path)
    return next((fields for _, fields in _lines(path, Style(style.comment, style.delimiter))), [])


def _lines(path: Path, style: Style) -> Iterator[tuple[int, list[str]]]:
    """Yield number and fields of each line that holds numbers."""
    skip = style.header
    with open(path, encoding="utf-8-sig", errors="replace") as stream:
        for number, line in enumerate(stream, start=1):
            fields = style.fields(line)
            if fields and skip:
                skip = False
            elif fields:
                yield number, fields


def _explain(path: Path, style: Style, counts: Sequence[int], columns: Sequence[int] | None) -> ValueError | None:
    """Return the error for the first line at fault."""
    allowed = " or ".join(map(str, counts))
    found: ValueError | None = None
    for number, fields in _lines(path, style):
        if found is not None:
            return found
        if len(fields) not in counts:
            found = ValueError(f"{path}: line {number} has {len(fields)} columns; allowed: {allowed}")
            continue  # is it the last one?
        for i in range(len(fields)) if columns is None else columns:
            if not _finite(fields[i]):
                comma = " with a decimal point" if _finite(fields[i].replace(",", ".")) else ""
                text = f"{path}: line {number}, column {i + 1} is {fields[i][:40]!r}; allowed: a finite number{comma}"
                return ValueError(text)
    return ValueError(f"{found} (the last line: a truncated file?)") if found else None


def _finite(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def write_rows(stream: IO[str], row: str, rows: Array) -> None:
    """Write every row with the same %-format; %r is the shortest text that reads back to the same bits."""
    for first in range(0, len(rows), _CHUNK):
        part = rows[first : first + _CHUNK]
        stream.write(row * len(part) % tuple(part.ravel().tolist()))


def write_files(files: list[tuple[Path, str, Array]], mapping_path: Path, mapping: dict[str, Any]) -> list[Path]:
    """Write tables of (path, format of a row, rows) and their mapping, all of them or none. Returns the paths.

    Raises:
        OSError: files that cannot be written.
    """
    paths = [*(path for path, _, _ in files), mapping_path]
    with replacing(paths) as new:
        for target, (_, row, rows) in zip(new[:-1], files, strict=True):
            with target.open("w", encoding="ascii", newline="\n") as stream:
                head, newline, body = row.rpartition("\n")
                stream.write(head + newline)
                write_rows(stream, body + "\n", rows)
        new[-1].write_text(json.dumps(mapping, indent=2) + "\n", encoding="ascii")
    return paths
