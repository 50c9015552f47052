"""The head of a text table: lines to skip, names, units, and what its first rows tell about delimiter and decimal mark."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sins_env.reading.files import text_blocks
from sins_env.recordings.text.style import PLAIN, SPACE, Style

DELIMITERS = ("\t", ";", "|", ",", SPACE)  #: delimiters that are tried, in this order
FIRST_ROWS = 20  #: rows on which the delimiter is measured
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(e[+-]?\d+)?", re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+")


@dataclass(frozen=True)
class Head:
    """What stands before the first row of data, and the form of that row."""

    style: Style  #: the style with everything that was left open
    names: tuple[str, ...]  #: names of the columns; empty without a header
    units: tuple[str, ...]  #: words in the row below the names; empty without such a row
    first: int  #: lines before the first row of data
    fields: tuple[str, ...]  #: fields of the first row of data

    @property
    def line(self) -> int:
        """Number of the line of the first row of data, from 1."""
        return self.first + 1

    @property
    def width(self) -> int:
        """Number of columns that have a name or a value: a delimiter at the end of the line begins no column."""
        return len(self.names) or len(self.fields) - (len(self.fields) > 1 and self.fields[-1] == "")


def first_lines(path: Path) -> list[str]:
    """Return the first lines of a text file, about a megabyte of them.

    Raises:
        ValueError: no text file of lines.
        OSError: no such file, or one that cannot be read.
    """
    return next((block for block in text_blocks(path, told=False) if block), [])


def read_head(path: Path, style: Style = PLAIN, measured: bool = False, counts: Sequence[int] | None = None) -> Head:
    """Read names, units and the form of the first row of data.

    Args:
        path: the file.
        style: what is known of its style.
        measured: whether the delimiter is to be measured.
        counts: allowed numbers of columns, if they are known; they tell a decimal comma from a separating one.

    Raises:
        ValueError: no text file, or no row of data.
    """
    lines = first_lines(path)
    rows = [i for i, line in enumerate(lines) if i >= style.skip_lines and style.bare(line).strip()]
    if not rows:
        return Head(style, (), (), len(lines), ())
    if measured:
        style = replace(style, delimiter=_delimiter(style, [lines[i] for i in rows[:FIRST_ROWS]]))
    names: list[str] = []
    units: list[str] = []
    at = 0
    fields = style.fields(lines[rows[0]])
    if style.header or (style.header is None and style.words_only(fields)):
        names, at = fields, 1
        if at < len(rows) and style.words_only(style.fields(lines[rows[at]])):
            units, at = style.fields(lines[rows[at]]), 2
    first = rows[at] if at < len(rows) else len(lines)
    fields = style.fields(lines[first]) if at < len(rows) else []
    if not names and style.header is None:
        names = _commented_names(style, lines[style.skip_lines : first], len(fields))
    if _has_decimal_commas(path, style, lines[first] if fields else "", counts):
        style = replace(style, decimal=",")
        fields = style.fields(lines[first])
    while names and names[-1] == "":
        names.pop()
    return Head(style, tuple(names), tuple(units), first, tuple(fields))


def _delimiter(style: Style, lines: list[str]) -> str:
    """Return the delimiter that makes fields of data of the most of these lines, each with as many."""
    body = lines[2:] or lines  # below names and units
    best, most = ",", 0.0
    for delimiter in DELIMITERS:
        found = [replace(style, delimiter=delimiter, decimal=decimal) for decimal in ".,"][: 1 + (delimiter != ",")]
        for one in found:
            try:
                rows = [one.fields(line) for line in body]
            except ValueError:  # quotes that do not fit
                continue
            width = len(rows[-1])
            good = sum(sum(map(one.holds_data, row)) / len(row) for row in rows if len(row) == width > 1) / len(rows)
            if round(good, 3) > most:
                best, most = delimiter, round(good, 3)
    return best


def _commented_names(style: Style, lines: list[str], width: int) -> list[str]:
    """Return the names in the last comment before the data, if they are as many as the columns: EuRoC writes them so."""
    for line in reversed(lines):
        mark = next((mark for mark in style.comments if line.lstrip().startswith(mark)), None)
        if mark is None:
            continue
        names = replace(style, comments=()).fields(line.lstrip().removeprefix(mark))
        return names if len(names) == width and style.words_only(names) else []
    return []


def _has_decimal_commas(path: Path, style: Style, line: str, counts: Sequence[int] | None) -> bool:
    """Return whether the commas of the first row are decimal marks; they cannot be if they separate.

    Raises:
        ValueError: commas that may stand for a decimal mark or for thousands.
    """
    if style.decimal == "," or "," not in line or (style.delimiter == "," and '"' not in line):
        return False
    if style.delimiter is None:
        words = style.bare(line).split()
        if counts is None or len(words) not in counts or len(style.fields(line)) in counts:
            return False
    else:
        words = style.fields(line)
    commas = [word for word in words if "," in word]
    if any("." in word for word in words) or not all(map(_DECIMAL_COMMA.fullmatch, commas)):
        return False
    if all(map(_THOUSANDS.fullmatch, commas)) and not any(word.startswith(("0", "-0")) for word in commas):
        raise ValueError(
            f"{path}: {commas[0]!r} may be {commas[0].replace(',', '.')} or {commas[0].replace(',', '')}; allowed: "
            '"decimal": "," in the mapping, or no comma within a number'
        )
    return True
