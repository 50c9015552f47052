"""What a published table is here: lines, each of a task, a solver and what is read off its runs, beside what is printed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from sins_env.evaluation.reproduction.verdicts import Estimate, Printed
from sins_env.evaluation.tasks import EvaluationTask


@dataclass(frozen=True)
class Line:
    """One line. Lines of the same task, solver and settings share their runs."""

    label: str
    task: EvaluationTask
    solver: str
    read: Callable[..., Estimate]  #: what the line shows, in the unit of the group, of the results of its runs
    settings: Mapping[str, Any] = field(default_factory=dict)
    printed: Printed | None = None  #: None: not in the source
    against: EvaluationTask | None = None  #: ``read`` then gets the results of the same runs of this task besides

    @property
    def tasks(self) -> tuple[EvaluationTask, ...]:
        """Those whose results ``read`` gets."""
        return (self.task,) if self.against is None else (self.task, self.against)


@dataclass(frozen=True)
class Group:
    """Lines that are compared with one another."""

    title: str  #: conditions in a few words
    unit: str
    lines: tuple[Line, ...]
    runs: int = 100
    quick: int = 20  #: runs for a first look
    why: str = ""  #: what to know of lines that come out otherwise than printed


@dataclass(frozen=True)
class Table:
    """A table of a document, by its number there."""

    number: str
    title: str
    source: str
    what: str  #: what is run and what is read off, in a sentence or two
    groups: tuple[Group, ...]


class Outcome(NamedTuple):
    """A group that was run; or the reason why it could not be."""

    group: Group
    ours: tuple[Estimate, ...]
    verdicts: tuple[str, ...]
    missing: str = ""
