"""What a published table is here: lines, each of runs of a solver and what is read off them, beside what is printed."""

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
        """What tells it from others."""
        return json.dumps([self.task.name, self.solver, dict(self.settings)], sort_keys=True)


@dataclass(frozen=True)
class Line:
    """One line. Lines of the same task, solver and settings share their runs."""

    label: str
    task: EvaluationTask
    solver: str
    read: Callable[..., Estimate]  #: what the line shows, in the unit of the group, of the results of its runs
    settings: Mapping[str, Any] = field(default_factory=dict)
    printed: Print | None = None  #: None: not in the source
    against: Source | None = None  #: ``read`` then gets the results of the same runs of these besides
    timed: bool = False  #: ``read`` needs what a step costs
    quick: bool = True  #: in a first look, if its group is

    @property
    def sources(self) -> tuple[Source, ...]:
        """Those whose results ``read`` gets."""
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
    quick: int = 20  #: runs for a first look; 0: not in it
    why: str = ""  #: what to know of lines that come out otherwise than printed
    claims: tuple[Claim, ...] = ()  #: in the place of lines: of a system that is no environment
    compute: Callable[[int], Sequence[Estimate]] | None = (
        None  #: the estimates of ``claims`` from so many runs, in seconds
    )

    @property
    def shown(self) -> tuple[Line | Claim, ...]:
        return self.lines or self.claims

    @property
    def sources(self) -> list[Source]:
        """Those of all lines, each once."""
        return list({source.name: source for line in self.lines for source in line.sources}.values())


@dataclass(frozen=True)
class Picture:
    """A figure of a table, drawn of results: those of ``sources``, then of the first run of each of ``singles``."""

    name: str  #: of the file
    caption: str
    draw: Callable[[Sequence[Results]], Figure]
    sources: tuple[Source, ...] = ()
    singles: tuple[Source, ...] = ()
    runs: int = 40  #: of each of ``sources``
    quick: int = 5  #: 0: not in a first look


@dataclass(frozen=True)
class Table:
    """A table of a document, by its number there."""

    number: str
    title: str
    source: str
    what: str  #: what is run and what is read off, in a sentence or two
    groups: tuple[Group, ...]
    name: str = ""  #: such as "figures 2.3 to 2.5"; empty: "table" and its number
    beyond: bool = False  #: not printed: made only when it is asked for
    pictures: tuple[Picture, ...] = ()

    @property
    def heading(self) -> str:
        return f"{self.source}, {self.name or f'table {self.number}'}"


class Outcome(NamedTuple):
    """A group that was run; or the reason why it could not be."""

    group: Group
    ours: tuple[Estimate, ...]
    verdicts: tuple[str, ...]
    missing: str = ""
