"""Tables through the evaluation: runs are shared between lines, kept in a results file, and made once."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

from sins_env.evaluation import registry
from sins_env.evaluation.filling import Evaluation, fill
from sins_env.evaluation.reproduction.tables import Group, Line, Outcome, Table
from sins_env.evaluation.reproduction.verdicts import verdicts
from sins_env.evaluation.store import Key, Store


def run_tables(
    tables: Sequence[Table], store: Store, runs: int | None = None, *, quick: bool = False, workers: int | None = None
) -> list[list[Outcome]]:
    """The outcomes of the groups of each table; what the file holds already is not run again.

    Args:
        runs: of every group; None is each group's own number. A recording has its windows.
        quick: the groups' small numbers, for a first look.

    Raises:
        ValueError: a task of an earlier version in the file, settings that do not fit.
        KeyboardInterrupt: chunks that had ended are stored.
    """
    plans = [
        [_plan(group, runs or (group.quick if quick else group.runs)) for group in table.groups] for table in tables
    ]
    wanted: dict[Key, Evaluation] = {}
    for one in (one for plan in chain(*plans) for of_line in plan.evaluations for one in of_line):
        wanted[one.key] = max(one, wanted.get(one.key, one), key=lambda each: len(each.runs))
    for task in {one.task.name: one.task for one in wanted.values()}.values():
        store.add_task(task)
    fill(store, list(wanted.values()), workers=workers, cost=False, resume="the same command continues")
    return [[_outcome(plan, store) for plan in table] for table in plans]


class _Plan(NamedTuple):
    group: Group
    evaluations: tuple[
        tuple[Evaluation, ...], ...
    ]  #: of each line, one for each of its tasks; none if it cannot be run
    missing: str = ""  #: why it cannot


def _plan(group: Group, runs: int) -> _Plan:
    missing = _missing(group)
    if missing:
        return _Plan(group, (), missing)
    return _Plan(group, tuple(_evaluations(line, runs) for line in group.lines))


def _missing(group: Group) -> str:
    """Why a group cannot be run: the recording is not there. Solvers and settings that do not fit are errors."""
    for line in group.lines:
        registry.make(line.solver, line.settings)
        try:
            for task in line.tasks:
                task.make(1).close()
        except FileNotFoundError as error:
            return str(error)
    return ""


def _evaluations(line: Line, runs: int) -> tuple[Evaluation, ...]:
    return tuple(
        Evaluation.of(task, line.solver, line.settings, range(min(runs, task.max_runs or runs)), None)
        for task in line.tasks
    )


def _outcome(plan: _Plan, store: Store) -> Outcome:
    if plan.missing:
        return Outcome(plan.group, (), (), plan.missing)
    lines = plan.group.lines
    ours = tuple(
        line.read(*(store.results(one.key, one.runs) for one in of_line))
        for line, of_line in zip(lines, plan.evaluations, strict=True)
    )
    return Outcome(plan.group, ours, tuple(verdicts([line.printed for line in lines], ours)))
