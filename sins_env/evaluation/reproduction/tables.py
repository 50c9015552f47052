"""The form of a published table: lines with the runs of a solver, a figure read off these runs, and the printed one."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from sins_env.evaluation.reproduction.verdicts import Estimate, Print
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.tasks.task import EvaluationTask

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Source(NamedTuple):
    """Runs of a solver on a task."""

    task: EvaluationTask
    solver: str
    settings: Mapping[str, Any] = {}

    @property
    def name(self) -> str:
        """A text that tells these runs from others."""
        return json.dumps([self.task.name, self.solver, dict(self.settings)], sort_keys=True)


@dataclass(frozen=True)
class Line:
    """A line of a table. Lines with the same task, solver and settings share their runs."""

    label: str
    task: EvaluationTask
    solver: str
    read: Callable[..., Estimate]  #: function from the results of the runs to the figure, in the unit of the group
    settings: Mapping[str, Any] = field(default_factory=dict)
    printed: Print | None = None  #: printed figure; None if the source has none
    against: Source | None = None  #: other runs whose results ``read`` gets as well
    timed: bool = False  #: whether ``read`` needs the cost of a step
    quick: bool = True  #: whether a first look shows the line, if it shows its group
    lucky: bool = False  #: whether ``read`` needs the oracle in the same runs

    @property
    def sources(self) -> tuple[Source, ...]:
        """The runs whose results ``read`` gets."""
        own = Source(self.task, self.solver, self.settings)
        return (own,) if self.against is None else (own, self.against)


class Claim(NamedTuple):
    """A line of a computed group."""

    label: str
    printed: Print | None = None


@dataclass(frozen=True)
class Group:
    """Lines that are compared with one another."""

    title: str  #: conditions in a few words
    unit: str
    lines: tuple[Line, ...] = ()
    runs: int = 100
    quick: int = 20  #: number of runs in a first look; 0 leaves the group out
    why: str = ""  #: explanation of lines that differ from the print
    claims: tuple[Claim, ...] = ()  #: lines of a system that is no environment, instead of ``lines``
    #: Function from a number of runs to the estimates of ``claims``. It takes seconds.
    compute: Callable[[int], Sequence[Estimate]] | None = None

    @property
    def shown(self) -> tuple[Line | Claim, ...]:
        """The lines, or the claims in their place."""
        return self.lines or self.claims

    @property
    def sources(self) -> list[Source]:
        """The runs of all lines, each once."""
        return list({source.name: source for line in self.lines for source in line.sources}.values())


@dataclass(frozen=True)
class Picture:
    """A figure of a table, drawn from the results of ``sources`` and then of ``singles``."""

    name: str  #: name of the file
    caption: str
    draw: Callable[[Sequence[Results]], Figure]
    sources: tuple[Source, ...] = ()
    singles: tuple[Source, ...] = ()  #: runs whose first one alone is drawn
    runs: int = 40  #: number of runs of each of ``sources``
    quick: int = 5  #: number of runs in a first look; 0 leaves the figure out


@dataclass(frozen=True)
class Table:
    """A table of a document."""

    number: str  #: number in the document
    title: str
    source: str  #: document
    what: str  #: description of the runs and of the figures read off them, in a sentence or two
    groups: tuple[Group, ...]
    name: str = ""  #: name such as "figures 2.3 to 2.5"; empty for "table" and its number
    beyond: bool = False  #: whether the document does not print it, so that it is made on demand only
    pictures: tuple[Picture, ...] = ()

    @property
    def heading(self) -> str:
        """Document and name of the table."""
        return f"{self.source}, {self.name or f'table {self.number}'}"


class Outcome(NamedTuple):
    """A group that was run, or the reason why it was not."""

    group: Group
    ours: tuple[Estimate, ...]
    verdicts: tuple[str, ...]
    missing: str = ""
