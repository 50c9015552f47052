"""REPRODUCTION.md, a short paper around the tables: a template has its words, and the runs have every number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Mapping, Sequence
from typing import Any, NamedTuple

from sins_env.checks import unknown
from sins_env.evaluation.reproduction.claims import CLAIMS
from sins_env.evaluation.reproduction.documents.thesis_together import printed_extremes
from sins_env.evaluation.reproduction.figures import FIGURES, Figures
from sins_env.evaluation.reproduction.running import Made
from sins_env.evaluation.reproduction.showing import estimate_text, markdown
from sins_env.evaluation.reproduction.tables import Outcome
from sins_env.evaluation.reproduction.verdicts import IN_ORDER, NOT, OPEN, PRELIMINARY, REPRODUCED, Estimate
from sins_env.evaluation.score.verdicts import LEAST_VERDICT
from sins_env.evaluation.show.numbers import number_text
from sins_env.evaluation.show.templates import template
from sins_env.evaluation.store.store import Store

TEMPLATE = "reproduction/paper.md.j2"
VERDICTS = (REPRODUCED, IN_ORDER, OPEN, NOT, PRELIMINARY)


class Found(NamedTuple):
    """A line of a table that was run; its text is our value with its interval."""

    printed: str
    ours: Estimate
    verdict: str

    def __str__(self) -> str:
        return estimate_text(self.ours)

    @property
    def value(self) -> str:
        """Our value."""
        return number_text(self.ours.value)

    @property
    def bound(self) -> str:
        """The bound of the same figure."""
        return number_text(self.ours.bound)

    @property
    def holds(self) -> bool:
        """Whether the printed figure is reproduced."""
        return self.verdict == REPRODUCED


class Tally(NamedTuple):
    """Numbers of the lines of a group with each verdict."""

    heading: str
    title: str
    counts: tuple[int, ...]  #: numbers of lines in the order of VERDICTS


class Papers:
    """The tables that were run, in the form in which the template asks for them."""

    def __init__(self, made: Sequence[Made]) -> None:
        self._made = {one.table.number: one for one in made}

    def line(self, table: str, group: str, label: str) -> Found:
        """Return a line of the one group of a table whose title has these words.

        Raises:
            ValueError: no such table, group or line, or a group that could not be run.
        """
        if table not in self._made:
            raise unknown("table", table, self._made)
        groups = [one for one in self._made[table].outcomes if group in one.group.title and one.ours]
        if len(groups) != 1:
            raise ValueError(
                f"table {table} has {len(groups)} groups that were run with {group!r} in the title; allowed: one"
            )
        outcome = groups[0]
        labels = {line.label: i for i, line in enumerate(outcome.group.shown)}
        i = labels[_only(label, labels, table)]
        printed = outcome.group.shown[i].printed
        return Found(printed.text if printed else "-", outcome.ours[i], outcome.verdicts[i])

    def ending(self, group: str, end: str) -> list[tuple[str, str]]:
        """Return table and label of the lines of 000 whose label ends so, in groups with these words that were run.

        A line that several tables repeat counts once.
        """
        found = {
            (line.task.name, line.solver, line.printed): (number, line.label)
            for number, made in reversed(self._made.items())
            for one in made.outcomes
            for line in one.group.lines
            if made.table.source == "000" and not made.table.name
            if group in one.group.title and one.ours and line.label.endswith(end)
        }
        return sorted(found.values())

    def ran(self, table: str, group: str, label: str = "") -> bool:
        """Return whether there is such a group with such a line, and it was run."""
        there = (one.group for one in self._made[table].outcomes if group in one.group.title and one.ours)
        return any(line.label.startswith(label) for group in there for line in group.shown)

    def tallies(self) -> list[Tally]:
        """Return the numbers of verdicts of every group that has any."""
        return [
            Tally(made.table.heading, outcome.group.title, counts)
            for made in self._made.values()
            for outcome in made.outcomes
            if sum(counts := _counts(outcome))
        ]

    def figures(self) -> list[tuple[str, str, str, str, str]]:
        """Return document, numbers, content, print and our pictures of every figure, or why there are none."""
        there = {picture.name for made in self._made.values() for picture in made.table.pictures}
        return [(f.document, f.name, f.what, f.printed, _ours(f, there)) for f in FIGURES]

    def sections(self) -> list[str]:
        """Return the tables as Markdown."""
        return [markdown(made.table, made.outcomes) for made in self._made.values()]


def _ours(figures: Figures, there: Container[str]) -> str:
    """Return links to our pictures of a figure, or why there are none."""
    links = [f"[{name}](figures/{name}.svg)" for name in figures.pictures if name in there]
    if figures.pictures and not links:
        return "left out of this run"
    state = ("drawn: " + ", ".join(links)) if links else "not reproducible" if figures.why else ""
    return "; ".join(filter(None, (state, figures.why)))


def _only(label: str, labels: Mapping[str, int], table: str) -> str:
    """Return the label itself, or the only one that begins so."""
    found = [label] if label in labels else [one for one in labels if one.startswith(label)]
    if len(found) != 1:
        raise unknown(f"line of table {table}", label, labels)
    return found[0]


def _counts(outcome: Outcome) -> tuple[int, ...]:
    found = Counter(outcome.verdicts)
    return tuple(found[verdict] for verdict in VERDICTS)


def paper(made: Sequence[Made], store: Store, quick: bool) -> str:
    """Return the whole text. It needs every printed table.

    Raises:
        ValueError: jinja2 is not installed, or a line that the template asks for does not exist.
    """
    papers = Papers(made)
    keys = store.keys()
    sessions = {one.id: one for key in keys for one in store.sessions(key)}
    values: dict[str, Any] = {
        "line": papers.line,
        "ending": papers.ending,
        "claims": [
            (one.document, one.text, papers.line(one.table, one.group, one.line))
            for one in CLAIMS
            if not quick or papers.ran(one.table, one.group, one.line)
        ],
        "extremes": [number_text(size) for size in printed_extremes()],
        "ran": papers.ran,
        "tallies": papers.tallies(),
        "figures": papers.figures(),
        "sure_runs": LEAST_VERDICT,
        "sections": papers.sections(),
        "verdicts": VERDICTS,
        "number": number_text,
        "quick": quick,
        "session": max(sessions.values(), key=lambda one: one.runs),
        "runs": sum(len(store.runs_of(key)) for key in keys),
    }
    text: str = template(TEMPLATE).render(values)
    return text
