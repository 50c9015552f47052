"""The ranked table in the terminal: as many columns as fit the width, and a line that lists those left out."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rich import box
from rich.cells import cell_len
from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from sins_env.evaluation.score.ranking import ranked
from sins_env.evaluation.score.results import Results, by_task
from sins_env.evaluation.show.cells import Cell
from sins_env.evaluation.show.columns import TERMINAL, Column, sign, table_columns
from sins_env.evaluation.show.footer import footer
from sins_env.evaluation.tasks.task import EvaluationTask

MOST_NAME, MOST_SETTING = 60, 24  #: most characters of a line below "solver", and of a setting
_INTERVALS = "intervals of "
_STYLES = {"good": "green", "fair": "yellow", "bad": "red", "none": "dim"}
_SHORT = {"horizontal": "hor.", "vertical": "vert.", "heading at the end": "heading"}


def print_tables(results: Sequence[Results], console: Console) -> None:
    """Print a table per task, as wide as the terminal."""
    for group in by_task(results).values():
        console.print(table(group, console.width))


def table(results: Sequence[Results], width: int = 100) -> RenderableType:
    """Return the table of one task's solvers for a terminal of ``width`` characters.

    A cell has a value, and its 95 % interval on the line below. Numbers and words are never broken. If room is short,
    names of solvers fold at '.' and ':'. Then columns are left out, and the lines below the table list them.
    """
    task, lines = results[0].task, ranked(results)
    columns = table_columns([one for _, one in lines], TERMINAL)
    cells = [[column.shown(one) for _, one in lines] for column in columns]
    order = dropping(columns, task)
    for count in range(len(order) + 1):
        less = order[:count]
        kept = [
            (_heading(column), [_text(cell, _has_interval(column, task, less)) for cell in found])
            for column, found in zip(columns, cells, strict=True)
            if column.stays(task) or column.part not in less
        ]
        found, room = _table(lines, kept, width)
        if room >= max(longest_piece(one) for _, one in lines):
            break
    title = Text.assemble((task.name, "bold"), f"  {task.what}")
    notes = footer([one for _, one in lines])
    if less:
        gone = {_INTERVALS + part for part in less}  # intervals of what is left out itself
        left_out = ", ".join(part for part in less if part not in gone)
        notes += f"\nLeft out in {width} columns: {left_out}; a wider terminal or board --md shows all."
    return Group(title, found, Text(notes, style="dim"))


def dropping(columns: Sequence[Column], task: EvaluationTask) -> list[str]:
    """Return the parts to leave out one after the other until the table fits: first intervals, then columns."""
    intervals = [_INTERVALS + column.intervals for column in columns if column.intervals and not column.main(task)]
    parts = [column.part for column in sorted(columns, key=lambda column: column.drop) if not column.stays(task)]
    return list(dict.fromkeys(intervals + parts))


def _has_interval(column: Column, task: EvaluationTask, less: Sequence[str]) -> bool:
    return column.main(task) or _INTERVALS + column.intervals not in less


def _heading(column: Column) -> str:
    """Return title and unit on two lines, broken such that the column is narrowest."""
    title = column.title.replace(",", "")
    for long, short in _SHORT.items():
        title = title.replace(long, short)
    words = ", ".join(filter(None, (title, sign(column.unit)))).split(" ")
    breaks = [(" ".join(words[:i]).rstrip(","), " ".join(words[i:])) for i in range(len(words) - 1, 0, -1)]
    return "\n".join(min(breaks, key=lambda lines: max(map(len, lines)), default=words))


def _text(cell: Cell, interval: bool) -> Text:
    """Return the text of a cell, with colours for good and bad; only a grave warning is spelt out."""
    text = Text.assemble((cell.value.replace(", ", "\n"), _STYLES.get(cell.mark, "")))
    if cell.below and interval:
        text.append("\n" + cell.below, style="dim")
    if cell.note and cell.mark == "bad":
        text.append("\n" + cell.note, style="bold red")
    return text


def _table(
    lines: Sequence[tuple[int | None, Results]], columns: Sequence[tuple[str, list[Text]]], width: int
) -> tuple[Table, int]:
    """Return the table, and the width that it leaves for the names of solvers.

    Args:
        lines: ranks and results.
        columns: heading and cells of each column.
        width: width of the terminal in characters.
    """
    cells = list(zip(*(found for _, found in columns), strict=True))

    def build(rows: Sequence[Sequence[Text]]) -> Table:
        out = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1), collapse_padding=True)
        out.add_column("#", justify="right", no_wrap=True)
        out.add_column("solver", overflow="fold")
        for heading, _ in columns:
            out.add_column(heading, justify="right", no_wrap=True)
        out.add_row(*_together(rows))
        return out

    console = Console(width=10_000, color_system=None)
    name = max(longest_piece(one, fold=False) for _, one in lines)
    widest = [max(column, key=_width) for column in zip(*cells, strict=True)]  # one row stands for all: far faster
    whole = Measurement.get(
        console, console.options, build([[Text(str(len(lines))), Text("x" * name), *widest]])
    ).maximum
    room = width - (whole - name)
    fits = max(min(room, MOST_NAME), 1)
    return build(
        [[_place(line[0]), label(line[1], line[0], fits), *row] for line, row in zip(lines, cells, strict=True)]
    ), room


def _together(rows: Sequence[Sequence[Text]]) -> list[Text]:
    """Return one cell per column with the lines of all rows, which is many times faster than a cell per row."""
    heights = [max(str(cell).count("\n") for cell in row) for row in rows]
    padded = (
        [_padded(cell, height) for cell, height in zip(column, heights, strict=True)]
        for column in zip(*rows, strict=True)
    )
    return [Text("\n").join(column) for column in padded]


def _padded(cell: Text, breaks: int) -> Text:
    missing = breaks - cell.plain.count("\n")
    return cell if not missing else Text.assemble(cell, "\n" * missing)


def _width(cell: Text) -> int:
    return max(cell_len(line) for line in str(cell).split("\n"))


def _place(rank: int | None) -> Text:
    return Text(str(rank or "-"), style="bold green" if rank == 1 else "")


def label(one: Results, rank: int | None, room: int) -> Text:
    """Return name, module and settings of a solver, folded at '.' and ':' to lines of ``room`` characters.

    The best are bold, and those with too few runs for a rank are dim.
    """
    module, _, name = one.solver.rpartition(":")
    style = "bold" if rank == 1 else "dim" if one.verdict.preliminary else ""
    text = Text("\n".join(_folded(name, room)), style=style)
    for part in ([module] if module else []) + _settings(one):
        text.append("\n" + "\n".join(_folded(part, room)), style="dim")
    return text


def _settings(one: Results) -> list[str]:
    """Return a line per setting; a long one is cut."""
    lines = [f"{name}={value}" for name, value in sorted(one.settings.items())]
    return [line if len(line) <= MOST_SETTING else line[: MOST_SETTING - 1] + "…" for line in lines]


def _pieces(text: str) -> list[str]:
    """Return the pieces that may not be broken: parts that end with '.' or ':'; a setting stays whole."""
    return [text] if "=" in text else re.findall(r"[^.:]*[.:]+|[^.:]+", text)


def _folded(text: str, room: int) -> list[str]:
    lines = [""]
    for piece in _pieces(text):
        if lines[-1] and len(lines[-1] + piece) > room:
            lines.append("")
        lines[-1] += piece
    return lines


def longest_piece(one: Results, fold: bool = True) -> int:
    """Return the length of the longest line below "solver", folded as narrow as possible (or as wide as allowed)."""
    module, _, name = one.solver.rpartition(":")
    parts = [name, *([module] if module else []), *_settings(one), "solver"]
    return max(len(line) for part in parts for line in (_pieces(part) if fold else _folded(part, MOST_NAME)))
