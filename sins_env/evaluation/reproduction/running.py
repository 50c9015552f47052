"""Tables through the evaluation: runs are shared between lines, kept in a results file, and made once."""

from __future__ import annotations

from collections.abc import Sequence

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
    groups = [group for table in tables for group in table.groups]
    missing = {id(group): _missing(group) for group in groups}
    wanted: dict[Key, Evaluation] = {}
    for group in groups:
        count = runs or (group.quick if quick else group.runs)
        for line in group.lines if not missing[id(group)] else ():
            one = _evaluation(line, count)
            most = max(one, wanted.get(one.key, one), key=lambda each: len(each.runs))
            wanted[one.key] = most
    for task in {one.task.name: one.task for one in wanted.values()}.values():
        store.add_task(task)
    fill(store, list(wanted.values()), workers=workers, cost=False, resume="the same command continues")
    return [
        [
            _outcome(group, store, runs or (group.quick if quick else group.runs), missing[id(group)])
            for group in table.groups
        ]
        for table in tables
    ]


def _missing(group: Group) -> str:
    """Why a group cannot be run: the recording is not there. Solvers and settings that do not fit are errors."""
    for line in group.lines:
        registry.make(line.solver, line.settings)
        try:
            line.task.make(1).close()
        except FileNotFoundError as error:
            return str(error)
    return ""


def _evaluation(line: Line, runs: int) -> Evaluation:
    return Evaluation.of(line.task, line.solver, line.settings, range(min(runs, line.task.max_runs or runs)), None)


def _outcome(group: Group, store: Store, runs: int, missing: str) -> Outcome:
    if missing:
        return Outcome(group, (), (), missing)
    ours = []
    for line in group.lines:
        one = _evaluation(line, runs)
        ours.append(line.read(store.results(one.key, one.runs)))
    return Outcome(group, tuple(ours), tuple(verdicts([line.printed for line in group.lines], ours)))
