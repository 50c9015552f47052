"""Mapping files: small JSON files that say what a recording's own files do not.

Any format takes ``axes``, ``rate_hz``, ``resample_hz``, ``drop_duplicates`` and ``bridge_s``. Any takes what mends its fixes
(``drop_null_fixes``, ``drop_held_fixes``, ``fix_shift_s``) and ``accept``, names of findings with which the recording is
taken as it is. Text formats also take ``site``, ``lever_arm_m``, ``gnss`` and ``reference``. A CSV needs columns and units, too::

    {"format": "csv", "file": "imu.csv", "axes": "FRD", "site": [34.2, 108.9, 380.0],
     "time": {"column": "t", "unit": "ms"},
     "gyro": {"columns": ["wx", "wy", "wz"], "unit": "deg/s"},
     "accel": {"columns": ["fx", "fy", "fz"], "unit": "g"},
     "gnss": {"file": "gnss.csv", "time": {"column": 1}, "position": {"columns": [2, 3, 4], "unit": "deg"},
              "velocity": {"columns": [5, 6, 7], "frame": "NED"}},
     "reference": {"file": "truth.csv", "time": {"column": "t"},
                   "attitude": {"columns": ["yaw", "pitch", "roll"], "unit": "deg"}}}

Columns are names of the header, or numbers from 1. The unit tells an increment (rad, deg, arcsec; m/s) from a rate
(rad/s, deg/s, deg/h; m/s2, g, mg). A rate is held over the sample that its stamp ends. For values taken at the stamps
themselves the mapping says ``"rates": "trapezoid"``. docs/recordings.md has every key, with what is measured when it is
left out.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sins_env import checks
from sins_env.checks import build
from sins_env.reading.documents import read_document
from sins_env.recordings.axes import to_rfu
from sins_env.recordings.findings.finding import REFUSING
from sins_env.recordings.stamps.bridging import BRIDGE_S, MOST_BRIDGE_S
from sins_env.recordings.text.style import COMMENTS, Style

MOST_SHIFT_S = 1e9  #: largest shift of the stamps of the fixes, s
MOST_NAME = 255  #: most characters of the name of a file
MOST_SKIPPED = 10_000  #: most lines before a table
RATES = ("hold", "trapezoid")  #: allowed values of ``rates``


@dataclass(frozen=True)
class Mapping:
    """A mapping. Files that it names are beside the recording's own.

    Raises:
        ValueError: a value out of its range.
    """

    format: str | None = None
    file: str | None = None
    axes: str | None = None
    rate_hz: float | None = None
    resample_hz: float | None = None
    drop_duplicates: bool = False
    velocity_from_positions: bool = False
    site: tuple[float, ...] | None = None  #: latitude deg, longitude deg, height m
    lever_arm_m: tuple[float, ...] | None = None  #: vector from the IMU to the antenna, along the file's axes
    gnss: Any = None
    reference: Any = None
    time: Any = None
    gyro: Any = None
    accel: Any = None
    rates: str = "hold"
    delimiter: str | None = None  #: one character, " " for white space; None measures it
    decimal: str | None = None  #: "." or ","; None takes commas that cannot separate for decimal marks
    comment: tuple[str, ...] = COMMENTS  #: marks from which on a line is no data
    skip_lines: int = 0  #: lines before the table
    header: bool | None = None  #: whether the first row holds names; None finds out
    aids: Any = None  #: readings of aiding sensors, an object for each (:mod:`sins_env.recordings.readings`)
    counter: Any = None  #: column of a counter of samples, which tells time where no column does
    imu: str | None = None  #: name of the IMU: its type in a NovAtel log, its variable in a NaveGo file
    drop_null_fixes: bool = False  #: leaves out fixes at latitude 0 and longitude 0, or below all land
    drop_held_fixes: bool = False  #: leaves out fixes that only repeat the one before
    fix_shift_s: float = 0.0  #: number of seconds that the stamps of the fixes are moved by
    bridge_s: float = BRIDGE_S  #: longest gap between samples that interpolated increments fill, s
    accept: tuple[str, ...] = ()  #: names of findings with which the recording is taken as it is

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        if self.axes is not None:
            to_rfu(self.axes)
        for name in ("rate_hz", "resample_hz"):
            given = getattr(self, name)
            if given is not None:
                set_(self, name, checks.number(name, given, "a positive number of Hz", above=0.0))
        for name, allowed in (
            ("site", "[latitude deg, longitude deg, height m]"),
            ("lever_arm_m", "three numbers in m"),
        ):
            given = getattr(self, name)
            if given is not None:
                set_(self, name, checks.numbers(name, given, 3, allowed))
        for name in ("drop_duplicates", "velocity_from_positions", "drop_null_fixes", "drop_held_fixes"):
            checks.flag(name, getattr(self, name))
        bridge = f"a number of seconds, 0 to {MOST_BRIDGE_S:g}"
        set_(self, "bridge_s", checks.number("bridge_s", self.bridge_s, bridge, least=0.0, most=MOST_BRIDGE_S))
        shift = "a number of seconds"
        set_(
            self,
            "fix_shift_s",
            checks.number("fix_shift_s", self.fix_shift_s, shift, least=-MOST_SHIFT_S, most=MOST_SHIFT_S),
        )
        set_(self, "accept", accepted(self.accept))
        checks.choice("way to integrate rates", self.rates, RATES)
        if self.aids is not None and not isinstance(self.aids, dict):
            raise checks.refused("aids", self.aids, "an object with the columns of each sensor")
        if self.delimiter is not None and not (isinstance(self.delimiter, str) and len(self.delimiter) == 1):
            raise checks.refused("delimiter", self.delimiter, "one character; a space stands for any white space")
        if self.decimal is not None:
            checks.choice("decimal mark", self.decimal, (".", ","))
        if self.decimal == "," and self.delimiter == ",":
            raise ValueError('delimiter and decimal are both ","; allowed: one of them')
        marks = (self.comment,) if isinstance(self.comment, str) else checks.items(self.comment)
        if marks is None or not all(isinstance(mark, str) and 1 <= len(mark) <= 8 for mark in marks):
            raise checks.refused("comment", self.comment, 'the marks of comments, such as ["#", "//"]; [] for none')
        set_(self, "comment", tuple(marks))
        set_(self, "skip_lines", checks.whole("skip_lines", self.skip_lines, least=0, most=MOST_SKIPPED))
        if self.imu is not None and not isinstance(self.imu, str):
            raise checks.refused("imu", self.imu, "a name")

    def style(self) -> Style:
        """Return the style of its tables, with a header if there is one."""
        return Style(self.comment, self.delimiter, self.decimal or ".", self.header, self.skip_lines)

    def text(self) -> str:
        """Return a text that is the same for equal mappings."""
        return json.dumps(asdict(self), sort_keys=True)

    def companions(self) -> list[str]:
        """Return the names of the files that this mapping adds to the recording's own."""
        parts = (self.time, self.gyro, self.accel, self.counter, self.gnss, self.reference)
        parts += tuple((self.aids or {}).values())
        return [name for part in parts if isinstance(name := part.get("file") if isinstance(part, dict) else part, str)]


def accepted(given: Any) -> tuple[str, ...]:
    """Check names of findings, a list of them or one.

    Raises:
        ValueError: a name of no finding that refuses a recording; the nearest is offered.
    """
    names = (given,) if isinstance(given, str) else checks.items(given)
    if names is None:
        raise checks.refused("accept", given, f"names of findings: {', '.join(REFUSING)}")
    for name in names:
        checks.choice("finding to accept", name, REFUSING)
    return tuple(names)


def read_mapping(path: Path) -> dict[str, Any]:
    """Read the keys of a mapping file.

    Raises:
        ValueError: no JSON object; the error names the line.
    """
    given = read_document(path)
    if not isinstance(given, dict):
        raise ValueError(f"{path}: a {type(given).__name__}; allowed: a JSON object, {{...}}")
    return given


def to_mapping(given: dict[str, Any], whose: str) -> Mapping:
    """Make a mapping of its keys.

    Raises:
        ValueError: an unknown key (the nearest is offered), or a value out of its range; the text begins with ``whose``.
    """
    try:
        return build(Mapping, given, "a mapping")
    except ValueError as error:
        raise ValueError(f"{whose}: {error}") from None


def companion(path: Path, name: Any, whose: str = "") -> Path:
    """Return the path of a file that a mapping names, which is beside the recording's own.

    Raises:
        ValueError: no name.
        FileNotFoundError: no such file.
    """
    if not isinstance(name, str):
        key = f"file of {whose}" if whose else "file"
        raise ValueError(f"{path}: {checks.refused(key, name, 'the name of a file beside it')}")
    found = path.parent / name
    if len(name) > MOST_NAME or not found.is_file():
        raise FileNotFoundError(
            f"no file {checks.shown(str(found))}, which {whose or f'the mapping of {path.name}'} names"
        )
    return found
