"""Export of the runs of a results file as one table with a line per run: CSV, JSON or Parquet.

Names of columns end with their unit. Times are from the start of fine alignment, and censored times are inf. JSON has no
inf, so there they are null, as unknown values are. Error histories stay in the results file
(``Store.results(key).records.history``).
"""

from __future__ import annotations

import csv
import importlib
import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.rows import object_of
from sins_env.evaluation.store.schema import KEY, SCORES, SPANS, TOLD
from sins_env.evaluation.store.store import Store
from sins_env.writing.files import replacing
from sins_env.writing.visible import in_csv, in_json

FORMATS = ("csv", "json", "parquet")
_KIND_OF = {"run": "count"}  #: kinds of the columns that no field of the records has; the others are words


class _Column(NamedTuple):
    """Column of the results file with its heading in an export."""

    name: str
    heading: str
    kind: str


def _columns(navigates: bool) -> list[_Column]:
    key = [name for name in KEY if name != "settings_hash"]
    head = [_Column(name, name, _KIND_OF.get(name, "word")) for name in [*key, "settings"]]
    fields = [*TOLD, *SCORES, *(SPANS if navigates else ())]
    return head + [
        _Column(name, heading, one.kind)
        for one in fields
        for name, heading in zip(one.columns, one.headings, strict=True)
    ]


def headings(navigates: bool) -> list[str]:
    """Return the headings of the columns, with units; ``navigates`` adds those of navigation."""
    return [column.heading for column in _columns(navigates)]


def export(store: Store, keys: Iterable[Key], form: str, path: str | Path) -> int:
    """Write the runs of these keys to a file, and return their number.

    Raises:
        ValueError: no such format, or Parquet without pyarrow.
    """
    if form not in FORMATS:
        raise ValueError(f"format {form!r}; allowed: {', '.join(FORMATS)}")
    wanted = list(keys)
    columns = _columns(any(store.navigates(key.task) for key in wanted))
    names = [column.name for column in columns]
    rows = (row for key in wanted for row in store.rows(key, names))
    with replacing([Path(path)]) as (new,):
        return {"csv": _csv, "json": _json, "parquet": _parquet}[form](columns, rows, new)


def check_parquet() -> Any:
    """Import and return pyarrow.

    Raises:
        ValueError: it is not installed.
    """
    try:
        importlib.import_module("pyarrow.parquet")
        return importlib.import_module("pyarrow")
    except ImportError as error:
        raise ValueError("Parquet needs pyarrow, which is not installed: pip install 'sins-env[data]'") from error


def _csv(columns: Sequence[_Column], rows: Iterator[tuple[Any, ...]], path: Path) -> int:
    count = itertools.count()
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(column.heading for column in columns)
        writer.writerows(map(in_csv, row) for row, _ in zip(rows, count, strict=False))
    return next(count)


def _json(columns: Sequence[_Column], rows: Iterator[tuple[Any, ...]], path: Path) -> int:
    """Write a list of objects, one per line; settings are an object, too."""
    count, heads = 0, [column.heading for column in columns]
    with open(path, "w", encoding="utf-8") as file:
        file.write("[")
        for count, row in enumerate(rows, start=1):
            values = dict(zip(heads, row, strict=True))
            values["settings"] = object_of(values["settings"])
            text = json.dumps(in_json(values), allow_nan=False)
            file.write(f"{',' if count > 1 else ''}\n{text}")
        file.write("\n]\n")
    return count


def _parquet(columns: Sequence[_Column], rows: Iterator[tuple[Any, ...]], path: Path) -> int:
    arrow = check_parquet()
    kinds = {"count": arrow.int64(), "number": arrow.float64()}
    given = list(zip(*rows, strict=True)) or [()] * len(columns)
    arrays = [
        arrow.array(values, type=kinds.get(column.kind, arrow.string()))
        for values, column in zip(given, columns, strict=True)
    ]
    table = arrow.Table.from_arrays(arrays, names=[column.heading for column in columns])
    arrow.parquet.write_table(table, path)
    return len(given[0])
