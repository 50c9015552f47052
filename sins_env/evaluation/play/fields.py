"""What a field of Records says of itself: from this the results file, exports and comparisons derive their columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.evaluation.play.criteria import AXES, COMPONENT_UNITS, COMPONENTS, NEES_AT, PHI

#: How a column's heading ends in an export.
SUFFIXES = {"rad": "_rad", "m/s": "_mps", "m": "_m", "s": "_s", "": ""}
_DTYPES: dict[str, Any] = {"number": float, "count": np.int64, "word": np.str_, "curve": np.float32}
NEES_PARTS = tuple(f"{round(100 * part)}" for part in NEES_AT)


@dataclass(frozen=True)
class Field:
    """One value of a run, or several parts, each a column."""

    kind: Literal["number", "count", "word", "text", "curve"] = "number"
    parts: tuple[str, ...] = ()  #: their names; none where the field is one value
    units: tuple[str, ...] = ("",)  #: of each part
    components: tuple[str, ...] = ()  #: the error that each part is one of, if it is
    navigates: bool = False  #: of navigation tasks only; elsewhere it has no parts
    column: str = ""  #: what its columns are named after, where that is not its own name
    in_tables: bool = True  #: whether tables need it; those that they do not are not read for them
    compared: bool = True  #: whether runs that are made again must have the same
    since: int = 1  #: the schema of the results file that has it first; older files get its columns, empty
    usual: str | int | None = None  #: what a word, text or count is in most runs
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
        """How many columns it has."""
        return len(self.columns)

    def of_runs(self, values: Sequence[Any] | NDArray[Any]) -> Any:
        """The field of runs from the values of each."""
        return tuple(values) if self.kind == "text" else np.array(values, dtype=_DTYPES[self.kind])

    def absent(self, runs: int) -> Array:
        """The field where the task has none: no parts, or NaN."""
        return np.full((runs, 0) if self.parts else (runs,), np.nan)

    def unknown(self, runs: int) -> Array:
        """The field where it was not read: NaN."""
        return np.full((runs, self.width) if self.parts else (runs,), np.nan)


def kept(**said: Any) -> Mapping[str, Field]:
    """Say of a dataclass field what it is: ``field(metadata=kept(kind="count"))``."""
    return {"is": Field(**said)}


def error_of(components: Sequence[str] = COMPONENTS[PHI], **said: Any) -> Mapping[str, Field]:
    """Say that a field has an error of each of these components, by default of the misalignment along E, N, U."""
    parts = [axis.lower() for axis in AXES] if components == COMPONENTS[PHI] else components
    units = tuple(COMPONENT_UNITS[COMPONENTS.index(name)] for name in components)
    return kept(parts=tuple(parts), units=units, components=tuple(components), **said)
