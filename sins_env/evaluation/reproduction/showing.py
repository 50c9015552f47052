"""Reproduced tables in the terminal and as Markdown: the printed figure, ours with its 95 % interval, bound, verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rich.console import Group as Lines
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table as RichTable
from rich.text import Text

from sins_env.evaluation.reproduction.tables import Outcome, Table
from sins_env.evaluation.reproduction.verdicts import IN_ORDER, NOT, OPEN, PRELIMINARY, REPRODUCED, Estimate
from sins_env.evaluation.show.numbers import number_text
from sins_env.evaluation.show.rich_tables import titled

_STYLES = {REPRODUCED: "green", IN_ORDER: "yellow", OPEN: "yellow", PRELIMINARY: "dim", NOT: "red"}
NEAR_ONE = 0.1  #: distance from one within which a quotient is shown with three decimals
_HEADS = ("printed", "ours [95 %]", "bound", "verdict")


def estimate_text(ours: Estimate) -> str:
    """Write a value with its interval, and the number of lost runs."""
    lost = f", {ours.lost} lost" if ours.lost else ""
    numbers = ours.value, ours.low, ours.high
    near = abs(ours.value - 1.0) < NEAR_ONE and math.isfinite(sum(numbers))
    value, low, high = (f"{x:.3f}" if near else number_text(x) for x in numbers)
    exact = ours.low == ours.high if near else low == high
    return f"{value}{lost}" if exact else f"{value} [{low}, {high}]{lost}"


def _cells(outcome: Outcome) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield label, printed figure, ours, bound and verdict of each line."""
    for line, ours, verdict in zip(outcome.group.shown, outcome.ours, outcome.verdicts, strict=True):
        yield (
            line.label,
            line.printed.text if line.printed else "-",
            estimate_text(ours),
            number_text(ours.bound),
            verdict,
        )


def _columns(outcome: Outcome) -> list[int]:
    """Return which cells are shown; the bound is left out if no line has one."""
    bounded = any(not math.isnan(ours.bound) for ours in outcome.ours)
    return [i for i in range(5) if bounded or i != 3]


def _heading(outcome: Outcome) -> str:
    """Return the group's conditions, its unit and its number of runs."""
    counts = {ours.runs + ours.lost for ours in outcome.ours} - {0}  # a cost has no runs
    runs = f"; {'/'.join(map(str, sorted(counts)))} runs" if counts else ""
    return f"{outcome.group.title} ({outcome.group.unit}{runs})"


def _notes(outcome: Outcome) -> list[str]:
    if outcome.missing:
        return [f"Not run: {outcome.missing}"]
    odd = any(verdict in (IN_ORDER, OPEN, NOT, PRELIMINARY) for verdict in outcome.verdicts)
    return [outcome.group.why] if odd and outcome.group.why else []


def terminal(table: Table, outcomes: Sequence[Outcome]) -> RenderableType:
    """Return a table for a rich console."""
    parts: list[RenderableType] = [
        Text.assemble((table.heading, "bold"), f"  {table.title}"),
        Text(table.what, style="dim"),
    ]
    for outcome in outcomes:
        if outcome.ours:
            parts.append(_rich(outcome))
        else:
            parts.append(Text(f"\n{_heading(outcome)}", style="bold"))
        parts += [Text(note, style="dim") for note in _notes(outcome)]
    return Lines(*parts, Text())


def _rich(outcome: Outcome) -> RichTable:
    found = titled(_heading(outcome))
    shown = _columns(outcome)
    found.add_column("")
    for i in shown[1:]:
        found.add_column(_HEADS[i - 1], justify="left" if i == 4 else "right", no_wrap=i == 2)
    for cells in _cells(outcome):
        styled = [Text(cell, style=_STYLES.get(cell, "")) if i == 4 else escape(cell) for i, cell in enumerate(cells)]
        found.add_row(*(styled[i] for i in shown))
    return found


def markdown(table: Table, outcomes: Sequence[Outcome]) -> str:
    """Return a table as a section of REPRODUCTION.md."""
    lines = [f"### {table.heading}: {table.title}", "", table.what, ""]
    for picture in table.pictures:
        lines += [f"![{picture.caption}](figures/{picture.name}.svg)", "", f"*{picture.caption}*", ""]
    for outcome in outcomes:
        lines += [f"**{_heading(outcome)}**", ""]
        if outcome.ours:
            shown = _columns(outcome)
            lines.append(f"| {' | '.join(['', *(_HEADS[i - 1] for i in shown[1:])])} |")
            lines.append(f"|{'|'.join('---:' if i in (1, 2, 3) else '---' for i in shown)}|")
            lines += [f"| {' | '.join(cells[i] for i in shown)} |" for cells in _cells(outcome)]
            lines.append("")
        for note in _notes(outcome):
            lines += [note, ""]
    return "\n".join(lines)
