"""The ranked table in the terminal: as much of it as the width holds, and a line that says what was left out."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rich import box
from rich.cells import cell_len
from rich.console import Console, Group, RenderableType
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from sins_env.evaluation.score.metrics import Summary
from sins_env.evaluation.score.ranking import by_failures, ranked
from sins_env.evaluation.score.results import Results, by_task
from sins_env.evaluation.show.columns import (
    Column,
    bound_heading,
    bound_text,
    cost_text,
    error_columns,
    failure_text,
    has_spread,
    nees_of,
    nees_text,
    spread_text,
    success_text,
)
from sins_env.evaluation.show.footer import footer
from sins_env.evaluation.show.numbers import seconds, seconds_interval


@dataclass(frozen=True)
class _Column:
    """A column of the terminal's table."""

    heading: str
    cell: Callable[[int, Results], Text]  #: of rank and results
    part: str = ""  #: by which it is left out where the terminal is narrow


MOST_NAME, MOST_SETTING = 60, 24  #: characters of a line below "solver", and of a setting
#: What a narrow terminal does without, in this order, until the table fits.
_LESS = ("intervals of east and north", "cost", "east and north", "NEES", "bound", "median time", "failures")
_LESS_NAVIGATION = (
    "intervals of the other errors", "cost", "vertical errors", "NEES", "bound", "level", "velocity", "failures",
    "the other errors",
)  # fmt: skip
#: Of columns by name; "the other errors" where they are not here.
_PARTS = {
    "level": "level", "position, vertical": "vertical errors", "velocity, vertical": "vertical errors",
    "velocity, horizontal": "velocity",
}  # fmt: skip


def print_tables(results: Sequence[Results], console: Console) -> None:
    """A table per task, as wide as the terminal."""
    for group in by_task(results).values():
        console.print(table(group, console.width))


def table(results: Sequence[Results], width: int = 100) -> RenderableType:
    """One task's solvers for a terminal of ``width`` columns: a value, and its 95 % interval on the line below.

    Numbers and words are never broken. Where room is short, solvers fold at '.' and ':', then columns are left out,
    and the lines below the table say which.
    """
    task, lines = results[0].task, ranked(results)
    order = [part for part in _order(results) if part not in _absent(results)]
    for less in range(len(order) + 1):
        found, room = _table(lines, _columns(results, order[:less]), width)
        if room >= max(_longest(one) for _, one in lines):
            break
    title = Text.assemble((task.name, "bold"), f"  {task.what}")
    notes = footer(results)
    if less:
        left_out = ", ".join(_said(order[:less]))
        notes += f"\nLeft out in {width} columns: {left_out}; a wider terminal or board --md shows all."
    return Group(title, found, Text(notes, style="dim"))


def _order(results: Sequence[Results]) -> tuple[str, ...]:
    if results[0].summary.navigation is None:
        return _LESS
    ranks = by_failures(results[0].task)
    return tuple(part for part in _LESS_NAVIGATION if not (ranks and part == "failures"))


def _absent(results: Sequence[Results]) -> set[str]:
    """Columns that no line of the table could fill."""
    there = {"NEES": any(nees_of(one.summary)[0] for one in results), "bound": any(one.bound for one in results)}
    there["spread"] = has_spread(results[0].task)
    return {part for part, known in there.items() if not known}


def _said(parts: Sequence[str]) -> list[str]:
    return [
        part for part in parts if part.removeprefix("intervals of ") not in parts or not part.startswith("intervals")
    ]


def _columns(results: Sequence[Results], less: Sequence[str]) -> list[_Column]:
    """Those right of the solver."""
    order, navigates = _order(results), results[0].summary.navigation is not None
    others = order[0].removeprefix("intervals of ")

    def errors(column: Column) -> _Column:
        shown = column.main or order[0] not in less

        def cell(_: int, one: Results) -> Text:
            value, ci = column.cell(one)
            return _stacked(value, ci if shown else "")

        stays = column.main or column.ranks
        return _Column(_heading(column), cell, "" if stays else _PARTS.get(column.name, others))

    def time(_: int, one: Results) -> Text:
        return _stacked(seconds(one.summary.t_conv_median_s), seconds_interval(one.summary.t_conv_ci_s))

    out = [
        _Column("runs\naligned", lambda _, one: _success(one.summary)),
        *([] if navigates else [_Column("median\ntime, s", time, "median time")]),
        *map(errors, error_columns(results[0])),
        _Column(bound_heading(results[0]).replace("/ ", "/\n"), lambda _, one: _bound(one), "bound"),
        _Column(f"NEES\n/ {nees_of(results[0].summary)[1]}", lambda _, one: _nees(one.summary), "NEES"),
        _Column("failed", lambda _, one: _failures(one.summary), "failures"),
        _Column("cost\n/ ckf", lambda _, one: Text(cost_text(one)), "cost"),
        _Column("heading\nspread, °", lambda _, one: _stacked(*spread_text(one)), "spread"),
    ]
    absent = set(less) | _absent(results)
    return [column for column in out if column.part not in absent]


_SHORT = {"horizontal": "hor.", "vertical": "vert.", "heading at the end": "heading"}


def _heading(column: Column) -> str:
    """On two lines."""
    *first, last = column.name.replace(",", "").split(" ", 1)
    last = f"{_SHORT.get(last, last)}, {column.unit}"
    return "\n".join([*first, last]) if first else last.replace(", ", "\n")


def _table(lines: Sequence[tuple[int, Results]], columns: Sequence[_Column], width: int) -> tuple[Table, int]:
    """The table, and how wide the names of the solvers may be in it."""
    cells = [[column.cell(rank, one) for column in columns] for rank, one in lines]

    def build(rows: Sequence[Sequence[Text]]) -> Table:
        out = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1), collapse_padding=True)
        out.add_column("#", justify="right", no_wrap=True)
        out.add_column("solver", overflow="fold")
        for column in columns:
            out.add_column(column.heading, justify="right", no_wrap=True)
        out.add_row(*_together(rows))
        return out

    console = Console(width=10_000, color_system=None)
    name = max(_longest(one, fold=False) for _, one in lines)
    widest = [max(column, key=_width) for column in zip(*cells, strict=True)]  # one row stands for all: far faster
    whole = Measurement.get(
        console, console.options, build([[Text(str(len(lines))), Text("x" * name), *widest]])
    ).maximum
    room = width - (whole - name)
    fits = max(min(room, MOST_NAME), 1)
    return build(
        [[_place(*line), _label(line[1], line[0], fits), *row] for line, row in zip(lines, cells, strict=True)]
    ), room


def _together(rows: Sequence[Sequence[Text]]) -> list[Text]:
    """One cell for each column, with the lines of all its rows: many times faster than a cell for each."""
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


def _place(rank: int, one: Results) -> Text:
    return Text(str(rank) if one.summary.scored else "-", style="bold green" if _wins(rank, one) else "")


def _wins(rank: int, one: Results) -> bool:
    return rank == 1 and one.summary.scored


def _label(one: Results, rank: int, room: int) -> Text:
    """Name, module and settings, folded at '.' and ':' to lines of ``room`` characters."""
    module, _, name = one.solver.rpartition(":")
    text = Text("\n".join(_folded(name, room)), style="bold" if _wins(rank, one) else "")
    for part in ([module] if module else []) + _settings(one):
        text.append("\n" + "\n".join(_folded(part, room)), style="dim")
    return text


def _settings(one: Results) -> list[str]:
    """A line each; a long value is cut."""
    lines = [f"{name}={value}" for name, value in sorted(one.settings.items())]
    return [line if len(line) <= MOST_SETTING else line[: MOST_SETTING - 1] + "…" for line in lines]


def _pieces(text: str) -> list[str]:
    """What may not be broken: parts between '.' and ':', each with its mark; a setting stays whole."""
    return [text] if "=" in text else re.findall(r"[^.:]*[.:]+|[^.:]+", text)


def _folded(text: str, room: int) -> list[str]:
    lines = [""]
    for piece in _pieces(text):
        if lines[-1] and len(lines[-1] + piece) > room:
            lines.append("")
        lines[-1] += piece
    return lines


def _longest(one: Results, fold: bool = True) -> int:
    """Characters of the longest line below "solver", as narrow as it can be folded (or as wide as allowed)."""
    module, _, name = one.solver.rpartition(":")
    parts = [name, *([module] if module else []), *_settings(one), "solver"]
    return max(len(line) for part in parts for line in (_pieces(part) if fold else _folded(part, MOST_NAME)))


def _failures(s: Summary) -> Text:
    return Text(failure_text(s).replace(", ", "\n"), style="red" if s.failures else "dim")


def _success(s: Summary) -> Text:
    style = "" if not s.scored else "green" if s.success >= 0.95 else "yellow" if s.success >= 0.5 else "red"
    return Text.assemble((success_text(s), style), (f"\nof {s.runs}", "dim"))


def _stacked(value: str, below: str) -> Text:
    return Text.assemble(value, ("\n" + below, "dim")) if below else Text(value)


def _bound(one: Results) -> Text:
    text, below = bound_text(one)
    return Text.assemble(text, ("\nbelow", "bold red")) if below else Text(text)


def _nees(s: Summary) -> Text:
    text, inside = nees_text(s)
    return Text(text, style="" if inside is None else "green" if inside else "yellow")
