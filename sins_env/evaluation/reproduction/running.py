"""Running of tables: their lines share runs, which are made once and kept in a results file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.reproduction.tables import Group, Outcome, Picture, Source, Table
from sins_env.evaluation.reproduction.verdicts import verdicts
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.store.filling import Evaluation, fill
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.task import EvaluationTask


class Drawn(NamedTuple):
    """A picture and the results behind it."""

    picture: Picture
    results: tuple[Results, ...]


class Made(NamedTuple):
    """A table that was run."""

    table: Table
    outcomes: tuple[Outcome, ...]
    pictures: tuple[Drawn, ...]


def run_tables(
    tables: Sequence[Table], store: Store, runs: int | None = None, *, quick: bool = False, workers: int | None = None
) -> list[Made]:
    """Run tables, and return the outcomes of their groups and the results behind their pictures.

    Args:
        tables: the tables.
        store: results file; the runs that it holds are not made again.
        runs: number of runs of every group; None takes each group's own number. A recording has its windows.
        quick: whether to take the groups' small numbers for a first look, and to leave out what takes long.
        workers: number of processes.

    Raises:
        ValueError: a task of an earlier version in the file, or settings that do not fit.
        KeyboardInterrupt: the user stopped it; chunks of runs that had ended are stored.
    """
    plans = [_Plan(table, runs, quick) for table in tables]
    wanted: dict[Key, Evaluation] = {}
    for one in (one for plan in plans for one in plan.evaluations()):
        wanted[one.key] = max(one, wanted.get(one.key, one), key=lambda each: len(each.runs))
    for task in {one.task.name: one.task for one in wanted.values()}.values():
        store.add_task(task)
    fill(
        store,
        list(wanted.values()),
        timed=[one for plan in plans for one in plan.timed()],
        workers=workers,
        oracles={name for plan in plans for name in plan.lucky()},
    )
    shelf, made = _Shelf(store), []
    with Bar(f"{len(plans)} tables") as bar:
        for done, plan in enumerate(plans):
            bar.update(done, len(plans), note=f"table {plan.table.number}")
            made.append(plan.made(shelf))
    return made


class _Shelf:
    """The results of a file. Each is read once, and keeps its summary."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._read: dict[tuple[Key, int], Results] = {}

    def __call__(self, one: Evaluation) -> Results:
        name = one.key, len(one.runs)
        if name not in self._read:
            self._read[name] = self._store.results(one.key, one.runs)
        return self._read[name]


class _Plan:
    """The runs that a table needs."""

    def __init__(self, table: Table, runs: int | None, quick: bool) -> None:
        self.table = _with_recordings(first_look(table) if quick else table)
        self._groups = [
            (group, runs or (group.quick if quick else group.runs), _missing(group, quick))
            for group in self.table.groups
        ]
        self._pictures = [(p, runs or (p.quick if quick else p.runs)) for p in self.table.pictures]
        self._evaluations: dict[tuple[str, int], Evaluation] = {}

    def evaluations(self) -> Iterable[Evaluation]:
        for group, runs, missing in self._groups:
            yield from (self._evaluation(source, runs) for source in (() if missing else group.sources))
        for picture, runs in self._pictures:
            yield from self._of_picture(picture, runs)

    def timed(self) -> Iterable[Evaluation]:
        for group, runs, missing in self._groups:
            for line in group.lines:
                if line.timed and not missing:
                    yield from (self._evaluation(source, runs) for source in line.sources)

    def lucky(self) -> Iterable[str]:
        for group, _, missing in self._groups:
            yield from (line.task.name for line in group.lines if line.lucky and not missing)

    def made(self, shelf: _Shelf) -> Made:
        outcomes = tuple(self._outcome(group, runs, missing, shelf) for group, runs, missing in self._groups)
        pictures = tuple(Drawn(p, tuple(map(shelf, self._of_picture(p, runs)))) for p, runs in self._pictures)
        return Made(self.table, outcomes, pictures)

    def _outcome(self, group: Group, runs: int, missing: str, shelf: _Shelf) -> Outcome:
        if missing:
            return Outcome(group, (), (), missing)
        if group.compute:
            ours = tuple(group.compute(runs))
        else:
            found = ([shelf(self._evaluation(source, runs)) for source in line.sources] for line in group.lines)
            ours = tuple(line.read(*results) for line, results in zip(group.lines, found, strict=True))
        return Outcome(group, ours, tuple(verdicts([line.printed for line in group.shown], ours)))

    def _of_picture(self, picture: Picture, runs: int) -> list[Evaluation]:
        bands = [self._evaluation(one, runs) for one in picture.sources]
        return [*bands, *(self._evaluation(one, 1) for one in picture.singles)]

    def _evaluation(self, source: Source, runs: int) -> Evaluation:
        """Return the evaluation of a source. It is kept, because the version of a solver's code is a hash of all sources."""
        name = source.name, min(runs, source.task.max_runs or runs)
        if name not in self._evaluations:
            self._evaluations[name] = Evaluation.of(*source, range(name[1]), None)
        return self._evaluations[name]


def first_look(table: Table) -> Table:
    """Return the table without the lines and pictures that a quick look leaves out."""
    groups = (replace(group, lines=tuple(line for line in group.lines if line.quick)) for group in table.groups)
    return replace(table, groups=tuple(groups), pictures=tuple(p for p in table.pictures if p.quick))


def _missing(group: Group, quick: bool) -> str:
    """Return why a group is not run, such as a missing recording; empty if it is.

    Solvers and settings that do not fit are errors.
    """
    if quick and not group.quick:
        return "left out of a quick look (--quick)."
    for source in group.sources:
        finding.make(source.solver, source.settings)
        if missing := _absent(source.task):
            return missing
    return ""


def _absent(task: EvaluationTask) -> str:
    """Return the reason why a task cannot be played: its recording is not there; empty if it can be."""
    try:
        task.make(1).close()
    except FileNotFoundError as error:
        return str(error)
    return ""


def _with_recordings(table: Table) -> Table:
    """Return the table without the pictures whose recording is not there."""
    there = (p for p in table.pictures if not any(_absent(one.task) for one in (*p.sources, *p.singles)))
    return replace(table, pictures=tuple(there))
