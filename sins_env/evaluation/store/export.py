"""All runs of a results file as one table, a line per run: CSV, JSON or Parquet.

Columns say their unit. Times are from the start of fine alignment and inf where censored; JSON has no inf, there it is null as
what is not known. Error histories stay in the results file (``Store.results(key).records.history``).
"""

from __future__ import annotations

import csv
import importlib
import itertools
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.schema import COLUMNS, KEY, SPAN_COLUMNS
from sins_env.evaluation.store.store import Store

FORMATS = ("csv", "json", "parquet")
_LEFT_OUT = ("session", "settings_hash")
_WHOLE = ("run", "repairs", "fallbacks")
_WORDS = (*(name for name in KEY if name != "run"), "settings", "status", "reason", "traceback")
_READ = [name for name in COLUMNS if name not in _LEFT_OUT]


def _with_unit(name: str) -> str:
    if name in _WHOLE or name in _WORDS or name.startswith("nees"):
        return name
    if name.startswith(("t_conv", "step_s")):
        return name if name.endswith("_s") else f"{name}_s"
    kind = next((unit for part, unit in (("_vel_", "mps"), ("_pos_", "m")) if part in name), "rad")
    return f"{name}_{kind}"


def headings(navigates: bool) -> list[str]:
    """Names of the columns, with units; those of navigation follow where any of the tasks navigates."""
    return [_with_unit(name) for name in _columns(navigates)]


def _columns(navigates: bool) -> list[str]:
    return [*_READ, *(SPAN_COLUMNS if navigates else ())]


def export(store: Store, keys: Iterable[Key], form: str, path: str | Path) -> int:
    """Write the runs of these keys; how many.

    Raises:
        ValueError: no such format, or Parquet without pyarrow.
    """
    if form not in FORMATS:
        raise ValueError(f"format {form!r}; allowed: {', '.join(FORMATS)}")
    wanted = list(keys)
    columns = _columns(any(store.navigates(key.task) for key in wanted))
    rows = (row for key in wanted for row in store.rows(key, columns))
    return {"csv": _csv, "json": _json, "parquet": _parquet}[form](columns, rows, Path(path))


def check_parquet() -> Any:
    """pyarrow.

    Raises:
        ValueError: it is not installed.
    """
    try:
        importlib.import_module("pyarrow.parquet")
        return importlib.import_module("pyarrow")
    except ImportError as error:
        raise ValueError("Parquet needs pyarrow, which is not installed: pip install 'sins-env[data]'") from error


def _csv(columns: Sequence[str], rows: Iterator[tuple[Any, ...]], path: Path) -> int:
    count = itertools.count()
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(_with_unit, columns))
        writer.writerows(row for row, _ in zip(rows, count, strict=False))
    return next(count)


def _json(columns: Sequence[str], rows: Iterator[tuple[Any, ...]], path: Path) -> int:
    """A list of objects, one per line; settings as an object."""
    count, heads = 0, [_with_unit(name) for name in columns]
    place = heads.index("settings")
    with open(path, "w", encoding="utf-8") as file:
        file.write("[")
        for count, row in enumerate(rows, start=1):
            values: list[Any] = [None if isinstance(value, float) and math.isinf(value) else value for value in row]
            values[place] = json.loads(values[place])
            text = json.dumps(dict(zip(heads, values, strict=True)), allow_nan=False)
            file.write(f"{',' if count > 1 else ''}\n{text}")
        file.write("\n]\n")
    return count


def _parquet(columns: Sequence[str], rows: Iterator[tuple[Any, ...]], path: Path) -> int:
    arrow = check_parquet()
    kinds = [arrow.int64() if n in _WHOLE else arrow.string() if n in _WORDS else arrow.float64() for n in columns]
    given = list(zip(*rows, strict=True)) or [()] * len(columns)
    arrays = [arrow.array(column, type=kind) for column, kind in zip(given, kinds, strict=True)]
    table = arrow.Table.from_arrays(arrays, names=[_with_unit(name) for name in columns])
    arrow.parquet.write_table(table, path)
    return len(given[0])
