"""What an evaluation returns: the records of every solver on every task, and their summaries."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from sins_env.evaluation.bound import bounds
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.score.metrics import Summary, below_bound, bound_ratio, summarise_all
from sins_env.evaluation.score.navigation import bound_means
from sins_env.evaluation.score.repeatability import Repeatability, repeatability
from sins_env.evaluation.speed.cost import Cost
from sins_env.evaluation.tasks.task import EvaluationTask


@dataclass(frozen=True, repr=False)
class Results:
    """What an evaluation gave: one solver, one task, one suite."""

    task: EvaluationTask
    solver: str
    settings: Mapping[str, Any]
    suite: str  #: hash of the suite seed
    records: Records
    cost: Cost | None = None
    stored_bound: Bound | Literal["ask"] | None = "ask"  #: of the task, from a results file; "ask": ask the task

    @cached_property
    def summary(self) -> Summary:
        """Scores over the runs, with intervals."""
        return summarise_all([self.records])[0]

    @cached_property
    def bound(self) -> Bound | None:
        """Of the task; None where there is none, or where these scores are of other epochs than the task's."""
        if not self.records.criteria.scored:
            return None
        found = bounds.find(self.task) if self.stored_bound == "ask" else self.stored_bound
        return found if found and found.fits(self.records.criteria) else None

    @cached_property
    def bound_ratio(self) -> dict[str, float]:
        """RMS over the bound by axis; NaN without one."""
        return bound_ratio(self.records, self.bound) if self.bound else dict.fromkeys("ENU", math.nan)

    @cached_property
    def bound_means(self) -> dict[str, float]:
        """The bound of each ARMSE of a navigation task, by name (quantities.py); empty without a bound."""
        return bound_means(self.records, self.bound) if self.bound and self.records.criteria.navigates else {}

    @cached_property
    def repeatability(self) -> list[Repeatability]:
        """Standard deviation of the heading's error at each heading of the task, and last of all together."""
        return repeatability(self.records, self.task)

    @cached_property
    def below_bound(self) -> bool | None:
        """Whether the solver is better than the bound allows; None: no verdict."""
        return below_bound(self.records, self.bound) if self.bound else None

    @property
    def label(self) -> str:
        """The solver with its settings, as tables and figures show it."""
        given = ", ".join(f"{name}={value}" for name, value in sorted(self.settings.items()))
        return f"{self.solver} ({given})" if given else self.solver

    def __repr__(self) -> str:
        return f"<Results of {self.label} on {self.task.name}: {len(self.records.run)} runs>"


def summarise(results: Sequence[Results]) -> None:
    """Work out the summaries that are not known yet, all at once: several times faster than one after the other."""
    todo = [one for one in results if "summary" not in vars(one)]
    for one, summary in zip(todo, summarise_all([one.records for one in todo]), strict=True):
        vars(one)["summary"] = summary  # where cached_property keeps it


def by_task(results: Iterable[Results]) -> dict[tuple[str, str], list[Results]]:
    """Results by task and suite, in their order."""
    out: dict[tuple[str, str], list[Results]] = {}
    for one in results:
        out.setdefault((one.task.name, one.suite), []).append(one)
    return out
