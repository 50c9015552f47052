"""Descriptions of the fields of Records, from which the results file, exports and comparisons derive their columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.evaluation.play.criteria import AXES, COMPONENT_UNITS, COMPONENTS, NEES_AT, PHI

#: Endings of the headings in an export, by unit.
SUFFIXES = {"rad": "_rad", "m/s": "_mps", "m": "_m", "s": "_s", "": ""}
_DTYPES: dict[str, Any] = {"number": float, "count": np.int64, "word": np.str_, "curve": np.float32}
NEES_PARTS = tuple(f"{round(100 * part)}" for part in NEES_AT)


@dataclass(frozen=True)
class Field:
    """Description of a field: one value of a run, or several parts, each of which is a column."""

    kind: Literal["number", "count", "word", "text", "curve"] = "number"
    parts: tuple[str, ...] = ()  #: names of the parts; none if the field is one value
    units: tuple[str, ...] = ("",)  #: unit of each part
    components: tuple[str, ...] = ()  #: error component of each part, among COMPONENTS; none for other values
    navigates: bool = False  #: whether only navigation tasks have it; in alignment it has no parts
    column: str = ""  #: stem of the names of its columns, if it differs from ``name``
    in_tables: bool = True  #: whether tables need it; fields that they do not need are not read for them
    compared: bool = True  #: whether a run that is made again must have the same value
    since: int = 1  #: first schema of the results file that has it; older files get its columns, empty
    endless: bool = False  #: whether an error may be inf, in a run too short to tell how large it stays
    usual: str | int | None = None  #: value of a word, text or count in most runs
    name: str = ""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns in the results file."""
        stem = self.column or self.name
        return tuple(f"{stem}_{part}" for part in self.parts) or (stem,)

    @property
    def headings(self) -> tuple[str, ...]:
        """Names of its columns in an export, with their units."""
        ends = (SUFFIXES[unit] for unit in self.units)
        return tuple(name.removesuffix(end) + end for name, end in zip(self.columns, ends, strict=True))

    @property
    def width(self) -> int:
        """Number of its columns."""
        return len(self.columns)

    def of_runs(self, values: Sequence[Any] | NDArray[Any]) -> Any:
        """Return the field of several runs from the value of each."""
        return tuple(values) if self.kind == "text" else np.array(values, dtype=_DTYPES[self.kind])

    def absent(self, runs: int) -> Array:
        """Return the field for a task that does not have it: no parts, or NaN."""
        return np.full((runs, 0) if self.parts else (runs,), np.nan)

    def unknown(self, runs: int) -> Array:
        """Return the field if it was not read: NaN."""
        return np.full((runs, self.width) if self.parts else (runs,), np.nan)


def kept(**said: Any) -> Mapping[str, Field]:
    """Return the metadata that describe a dataclass field: ``field(metadata=kept(kind="count"))``."""
    return {"is": Field(**said)}


def error_of(components: Sequence[str] = COMPONENTS[PHI], **said: Any) -> Mapping[str, Field]:
    """Return the metadata of a field with an error of each of these components, by default the misalignment E, N, U."""
    parts = [axis.lower() for axis in AXES] if components == COMPONENTS[PHI] else components
    units = tuple(COMPONENT_UNITS[COMPONENTS.index(name)] for name in components)
    return kept(parts=tuple(parts), units=units, components=tuple(components), **said)
