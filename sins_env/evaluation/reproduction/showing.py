"""Reproduced tables in the terminal and as Markdown: printed, ours with its 95 % interval, verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Group as Lines
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table as RichTable
from rich.text import Text

from sins_env.evaluation.outcome import titled
from sins_env.evaluation.reproduction.tables import Outcome, Table
from sins_env.evaluation.reproduction.verdicts import IN_ORDER, NOT, REPRODUCED
from sins_env.evaluation.words import number

_STYLES = {REPRODUCED: "green", IN_ORDER: "yellow", NOT: "red"}


def _cells(outcome: Outcome) -> Iterator[tuple[str, str, str, str]]:
    """Label, printed, ours and verdict of each line."""
    for line, ours, verdict in zip(outcome.group.lines, outcome.ours, outcome.verdicts, strict=True):
        printed = number(line.printed.value) if line.printed else "-"
        lost = f", {ours.lost} lost" if ours.lost else ""
        yield line.label, printed, f"{number(ours.value)} [{number(ours.low)}, {number(ours.high)}]{lost}", verdict


def _heading(outcome: Outcome) -> str:
    """The group's conditions, its unit and how many runs stand behind it."""
    counts = {ours.runs + ours.lost for ours in outcome.ours}
    runs = f"; {'/'.join(map(str, sorted(counts)))} runs" if counts else ""
    return f"{outcome.group.title} ({outcome.group.unit}{runs})"


def _notes(outcome: Outcome) -> list[str]:
    if outcome.missing:
        return [f"Not run: {outcome.missing}"]
    odd = any(verdict in (IN_ORDER, NOT) for verdict in outcome.verdicts)
    return [outcome.group.why] if odd and outcome.group.why else []


def terminal(table: Table, outcomes: Sequence[Outcome]) -> RenderableType:
    """For a rich console."""
    parts: list[RenderableType] = [
        Text.assemble((f"{table.source}, table {table.number}", "bold"), f"  {table.title}"),
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
    found = titled(escape(_heading(outcome)))
    found.add_column("")
    found.add_column("printed", justify="right")
    found.add_column("ours [95 %]", justify="right", no_wrap=True)
    found.add_column("verdict")
    for label, printed, ours, verdict in _cells(outcome):
        found.add_row(label, printed, escape(ours), Text(verdict, style=_STYLES.get(verdict, "")))
    return found


def markdown(table: Table, outcomes: Sequence[Outcome]) -> str:
    """A section of REPRODUCTION.md."""
    lines = [f"## {table.source}, table {table.number}: {table.title}", "", table.what, ""]
    for outcome in outcomes:
        lines += [f"**{_heading(outcome)}**", ""]
        if outcome.ours:
            lines += ["| | printed | ours [95 %] | verdict |", "|---|---:|---:|---|"]
            lines += [f"| {' | '.join(cells)} |" for cells in _cells(outcome)]
            lines.append("")
        for note in _notes(outcome):
            lines += [note, ""]
    return "\n".join(lines)
