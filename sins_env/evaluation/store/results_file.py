"""A results file for Python and notebooks: ``sins_env.Store``, which is opened, filled, and shown as a board."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from rich.console import RenderableType

from sins_env.evaluation.estimators import isolation
from sins_env.evaluation.score.results import Results, by_task
from sins_env.evaluation.show.error_figure import error_figure
from sins_env.evaluation.show.plain_tables import as_json
from sins_env.evaluation.show.rich_tables import NOTEBOOK_WIDTH, in_html, in_text
from sins_env.evaluation.show.terminal_tables import table
from sins_env.evaluation.store.filling import Evaluation, fill
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import Given, get_task, named
from sins_env.evaluation.tasks.task import run_numbers
from sins_env.writing.files import saved

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.figure import Figure


class Board(Sequence[Results]):
    """Results of some solvers on some tasks, in the order of evaluation; its text and its HTML are the ranked tables."""

    def __init__(self, results: Sequence[Results]) -> None:
        self._results = list(results)

    def __getitem__(self, i: Any) -> Any:
        return self._results[i]

    def __len__(self) -> int:
        return len(self._results)

    def __iter__(self) -> Iterator[Results]:
        return iter(self._results)

    def rows(self) -> list[dict[str, Any]]:
        """Return a plain dict for each solver on each task, with every figure of ``sins-env board --json``."""
        found: list[dict[str, Any]] = json.loads(as_json(self._results))
        return found

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the figure of ``sins-env board --plot``: errors over time by task; with ``path`` it is written, too."""
        return saved(error_figure(self._results), path)

    def __repr__(self) -> str:
        return in_text(*self._tables())

    def _repr_html_(self) -> str:
        return in_html(*self._tables())

    def _tables(self) -> list[RenderableType]:
        return [table(group, NOTEBOOK_WIDTH) for group in by_task(self._results).values()] or ["no results yet"]


class ResultsFile(Store):
    """A results file: its runs, tasks, sessions and costs. It is a context manager, which closes it.

    Raises:
        StoreError: the file cannot be opened, read or written.
    """

    @classmethod
    def open(cls, path: str | Path, read_only: bool = False) -> Self:
        """Open a results file; a new one is made, unless it is only to be read.

        Raises:
            StoreError: the file cannot be opened.
        """
        return cls(path, read_only)

    def fill(
        self,
        tasks: Given | Sequence[Given],
        solvers: str | Sequence[str],
        runs: int = 100,
        seed: int | None = None,
        *,
        settings: Mapping[str, Any] | None = None,
        workers: int | None = None,
        executor: str = "processes",
        epoch_timeout_s: float | None = None,
    ) -> Board:
        """Make the runs that the file does not have yet, with progress, and return the board of these tasks and solvers.

        Args:
            tasks: names of tasks, files of scenarios, or tasks; one or several.
            solvers: names, or ``module:Factory``; one or several.
            runs: number of runs; a recording has no more than its windows.
            seed: seed of the suite; None takes that of each task.
            settings: settings of the solvers.
            workers: number of processes; None takes one per core.
            executor: "processes", "dask", or the address of a Dask scheduler.
            epoch_timeout_s: longest time of one call of a solver, s, as in :func:`sins_env.evaluation.evaluate`.

        Raises:
            ValueError: names, settings or numbers that do not fit, or another definition of a task than the file has.
        """
        given = dict(settings or {})
        several: Sequence[Any] = tasks if isinstance(tasks, (list, tuple)) else [tasks]
        chosen = [get_task(task) for task in several]
        names = [solvers] if isinstance(solvers, str) else list(solvers)
        for solver in names:
            isolation.prove(solver, given, epoch_timeout_s)
        wanted = [
            Evaluation.of(task, solver, given, run_numbers(min(runs, task.max_runs or runs)), seed)
            for task in chosen
            for solver in names
        ]
        for task in chosen:
            self.add_task(task)
        more: Any = {"executor": executor, "workers": workers, "epoch_timeout_s": epoch_timeout_s}
        fill(self, wanted, seed, timed=wanted, **more)
        return Board([self.results(one.key) for one in wanted])

    def board(self, tasks: Sequence[str] = (), solvers: Sequence[str] = ()) -> Board:
        """Return the results of these tasks and solvers, by default of all, as a board."""
        return Board([self.results(key) for key in self.keys(named(tasks), solvers)])
