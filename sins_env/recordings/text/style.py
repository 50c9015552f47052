"""The style of a text table: how a line becomes fields, and a field a number."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass

COMMENTS = ("#", "%", "//")  #: marks of comments, unless told otherwise
SPACE = " "  #: delimiter that stands for any white space
SEPARATOR = "\x1f"  #: delimiter of lines whose quotes have been taken off
BLANKS = ("", "nan", "null", "none", "n/a", "na", "-", "--")  #: fields that hold no value, in lower case
_EXPONENT = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")  #: Fortran's 1.5D-03
_TIME = re.compile(r"\d{1,4}[-/.:]\d{1,2}[-/.:]\d")  #: beginning of a date or of a time of day
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Style:
    """The way in which a text file writes its table."""

    comments: tuple[str, ...] = ("#",)  #: marks from which on a line is no data
    delimiter: str | None = None  #: one character, " " for white space; None stands for white space and commas
    decimal: str = "."  #: decimal mark
    header: bool | None = False  #: whether the first row holds names; None finds out
    skip_lines: int = 0  #: lines before the table

    def bare(self, line: str) -> str:
        """Return a line without its comment."""
        for mark in self.comments:
            if mark in line:
                line = line[: line.index(mark)]
        return line

    def fields(self, line: str) -> list[str]:
        """Return the fields of a line as they are written, without quotes; an empty line or a comment has none."""
        body = self.bare(line)
        if not body.strip():
            return []
        if self.delimiter is None and self.decimal == ".":
            return body.replace(",", " ").split()
        if self.delimiter in (None, SPACE):
            return body.split()
        if '"' in body:
            body = self.unquoted([body])[0]
            return [part.strip() for part in body.split(SEPARATOR)]
        return [part.strip(" \t'") for part in body.split(self.delimiter)]

    def unquoted(self, lines: list[str]) -> list[str]:
        """Return lines without quotes, with ``SEPARATOR`` between their fields.

        Raises:
            ValueError: a quote that does not end in its line.
        """
        assert self.delimiter is not None
        try:
            rows = list(csv.reader(lines, delimiter=self.delimiter, skipinitialspace=True, strict=True))
        except csv.Error:
            rows = []
        if len(rows) != len(lines):
            raise ValueError("a quote that does not end before a delimiter in its line")
        return [SEPARATOR.join(row) for row in rows]

    def plain(self, field: str) -> str:
        """Return a field with a decimal point and an exponent of e."""
        field = field.replace(",", ".") if self.decimal == "," else field
        return plain_exponents(field)

    def number(self, field: str) -> float:
        """Return the value of a field; NaN if it is no number."""
        text = self.plain(field)
        return float(text) if _NUMBER.fullmatch(text) else math.nan

    def holds_data(self, field: str) -> bool:
        """Return whether a field looks like a number, with either decimal mark, a blank or a time, and not like a word."""
        text = plain_exponents(field.replace(",", ".")).lower()
        return bool(text in BLANKS or _NUMBER.fullmatch(text) or _TIME.match(text))

    def words_only(self, fields: list[str]) -> bool:
        """Return whether fields are names or units: some are there, and none looks like data."""
        there = [field for field in fields if field]
        return bool(there) and not any(map(self.holds_data, there))


PLAIN = Style()  #: white space and commas between numbers, and comments behind #


def plain_exponents(text: str) -> str:
    """Return a text with e for the exponents that Fortran writes with D."""
    return _EXPONENT.sub("e", text) if "D" in text or "d" in text else text
