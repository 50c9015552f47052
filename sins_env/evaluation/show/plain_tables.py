"""The ranked table as Markdown, CSV and JSON, from the one list of columns."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable
from typing import Any

from sins_env.evaluation.score.ranking import ranked
from sins_env.evaluation.score.results import Results, by_task
from sins_env.evaluation.show import columns
from sins_env.evaluation.show.cells import Cell
from sins_env.evaluation.show.columns import MARKDOWN, Column
from sins_env.evaluation.show.footer import footer
from sins_env.writing.visible import in_csv, in_json, in_markdown


def as_json(results: Iterable[Results]) -> str:
    """Return a JSON list of objects, one per solver; a value that is unknown or infinite is null.

    The keys are those of docs/tasks_and_scores.md#json-keys.
    """
    return json.dumps([_entry(one) for group in by_task(results).values() for _, one in ranked(group)], indent=2)


def _entry(one: Results) -> dict[str, Any]:
    entry: dict[str, Any] = {"task": one.task.name, "solver": one.solver, "settings": in_json(dict(one.settings))}
    for column in columns.data_columns([one]):
        for key, value in column.json(one).items():
            entry[key] = entry.get(key, {}) | value if isinstance(value, dict) else value
    return entry


def as_csv(results: Iterable[Results]) -> str:
    """Return CSV with a line per solver and every figure; unknown values are empty. Navigation has columns of its own."""
    out, given = io.StringIO(), list(results)
    writer = csv.writer(out, lineterminator="\n")
    wanted = columns.data_columns(given)
    names = [name for column in wanted for name in column.csv]
    writer.writerow(["task", "suite", "rank", "solver", "settings", *names])
    for (task, suite), group in by_task(given).items():
        for rank, one in ranked(group):
            settings = json.dumps(dict(one.settings), sort_keys=True)
            row = [task, suite, rank or "", one.solver, settings]
            for column in wanted:
                row += column.figures(one) if column.holds(one) else [""] * len(column.csv)
            writer.writerow(["" if isinstance(value, float) and math.isnan(value) else in_csv(value) for value in row])
    return out.getvalue()


def as_markdown(results: Iterable[Results]) -> str:
    """A table per task."""
    parts = []
    for (name, _), group in by_task(results).items():
        lines = ranked(group)
        wanted = columns.table_columns([one for _, one in lines], MARKDOWN)
        rows = [["#", "solver", *map(_heading, wanted)], ["---:", "---", *["---:"] * len(wanted)]]
        for rank, one in lines:
            cells = [_inline(column.shown(one)) for column in wanted]
            rows.append([str(rank or "-"), one.label, *cells])
        body = "\n".join("| " + " | ".join(map(in_markdown, row)) + " |" for row in rows)
        what, notes = in_markdown(group[0].task.what), in_markdown(footer([one for _, one in lines]))
        parts.append(f"### {in_markdown(name)}\n\n{what}\n\n{body}\n\n{notes}\n")
    return "\n".join(parts)


def _heading(column: Column) -> str:
    return column.markdown or ", ".join(filter(None, (column.title, columns.sign(column.unit))))


def _inline(cell: Cell) -> str:
    """Return the value with its interval in brackets and a warning in parentheses."""
    text = f"{cell.value} [{cell.below}]" if cell.below else cell.value
    return f"{text} ({cell.note})" if cell.note else text
