"""The results file: SQLite with a write-ahead log, one row per run. docs/tasks_and_scores.md#results-file.

A run is identified by its task, suite-seed hash, solver, settings hash, code version and run number; the version of the
task is in its name. Only the parent process writes rows, one transaction per chunk. A killed evaluation therefore leaves
whole rows, and two evaluations may share a file.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Container, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.bound import bounds, oracle
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.estimators import version
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.show.drawn_results import DrawnResults as Results
from sins_env.evaluation.speed.cost import Cost
from sins_env.evaluation.store.database import Database
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.rows import (
    MOST_TEXT,
    binding,
    bound_json,
    bound_of,
    criteria_change,
    criteria_json,
    criteria_of,
    definition_json,
    definition_of,
    object_of,
    parted,
    scores_of,
    to_blob,
    to_records,
    to_row,
    to_span,
    versions_of,
)
from sins_env.evaluation.store.schema import KEY, RUN_COLUMNS, SPAN_COLUMNS, SPANS, TOLD, TROUBLE, columns_of
from sins_env.evaluation.tasks.catalogue import TASKS, get_task
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.writing.visible import LAYOUT, visible, visible_fields, visible_parts

#: Packages whose versions a session keeps.
PACKAGES = ("sins-env", *version.COMPUTING, "gymnasium", "filterpy")
_OF_KEY = " AND ".join(f"{name} = ?" for name in KEY[:-1])
_TEXTS = columns_of(one for one in TOLD if one.kind == "text")
_WITH_SPANS = "runs LEFT JOIN spans USING (id)"
_WITH_HISTORIES = "runs LEFT JOIN histories USING (id)"
_INSERT_RUN = f"""INSERT OR IGNORE INTO runs ({", ".join(RUN_COLUMNS)})
    VALUES ({", ".join("?" * len(RUN_COLUMNS))}) RETURNING id"""
_INSERT_SPAN = f"""INSERT OR REPLACE INTO spans (id, {", ".join(SPAN_COLUMNS)})
    VALUES ({", ".join("?" * (1 + len(SPAN_COLUMNS)))})"""


class Session(NamedTuple):
    """Session that wrote runs: the file was opened once, on one machine, with one set of packages."""

    id: int
    started: str  #: time of its start, UTC
    machine: str
    versions: dict[str, str]  #: versions of Python and the packages
    runs: int  #: number of the requested runs that it wrote


class Store(Database):
    """A results file: its runs, tasks, sessions and costs.

    Raises:
        StoreError: the file cannot be opened, read or written.
    """

    def __init__(self, path: str | Path, read_only: bool = False) -> None:
        self._session: int | None = None
        self._tasks: dict[str, tuple[EvaluationTask, Bound | Literal["ask"] | None]] = {}
        self._oracles: dict[tuple[str, str, bool], Records | None] = {}
        super().__init__(path, read_only)

    def runs_of(self, key: Key) -> set[int]:
        """Return the numbers of the runs of a key that the file has."""
        with self.explaining():
            return {run for (run,) in self.connection.execute(f"SELECT run FROM runs WHERE {_OF_KEY}", key.values)}

    def add(self, key: Key, records: Records) -> None:
        """Write the rows of a chunk, all or none; rows that the file has already stay as they are.

        Raises:
            ValueError: the file's runs of the task were scored by other criteria.
        """
        self._oracles.clear()
        with self.explaining(), self.transaction():
            session = self.session()
            sql = "INSERT INTO tasks (task, criteria) VALUES (?, ?)"
            sql += " ON CONFLICT DO UPDATE SET criteria = coalesce(criteria, excluded.criteria) RETURNING criteria"
            (held,) = self.connection.execute(sql, (key.task, criteria_json(records.criteria))).fetchone()
            with self.reading(f"the criteria of {key.task}"):
                change = criteria_change(criteria_of(held), records.criteria)
            if change:
                raise ValueError(
                    f"{self.path}: runs of {key.task} were scored by other criteria, {change}; they would not compare: "
                    "--db another file"
                )
            for run in map(records.row, range(len(records))):
                span = to_span(run) if records.criteria.navigates else None
                self.insert(to_row(key, session, run), to_blob(run["history"]), span)

    def insert(self, row: Sequence[Any], history: bytes, span: Sequence[Any] | None) -> bool:
        """Insert the values of RUN_COLUMNS with a history, and with those of SPAN_COLUMNS in navigation.

        It belongs in a transaction. Return whether the run is new; one that the file has stays as it is.
        """
        new = self.connection.execute(_INSERT_RUN, row).fetchone()
        if new:
            self.connection.execute("INSERT OR REPLACE INTO histories VALUES (?, ?)", (*new, history))
            if span is not None:
                self.connection.execute(_INSERT_SPAN, (*new, *span))
        return new is not None

    def add_task(self, task: EvaluationTask) -> None:
        """Write the definition, digest and bound of a task, so that tables can be made from the file alone.

        Raises:
            ValueError: the file has runs of another definition of the task, or of another world.
        """
        now, present = definition_json(task), digest(task)
        bound = bound_json(bounds.find(task))
        definition_of(now)  # what could not be read back is not written
        with self.explaining(), self.transaction():
            sql = "SELECT definition, digest FROM tasks WHERE task = ?"
            held, before = self.connection.execute(sql, (task.name,)).fetchone() or (None, None)
            if held is not None and binding(held) != binding(now):
                change = "its definition"
            elif before is not None and before != present:
                change = f"its world (digest {before}, now {present})"
            else:
                sql = "INSERT INTO tasks (task, definition, digest, bound) VALUES (?, ?, ?, ?) ON CONFLICT DO UPDATE"
                sql += " SET definition = excluded.definition, digest = excluded.digest, bound = excluded.bound"
                self.connection.execute(sql, (task.name, now, present, bound))
                return
        raise ValueError(
            f"{self.path}: {task.name} has changed since its runs were made, {change}; they would not compare: "
            "a changed task needs a new version, or --db another file"
        )

    def digest_of(self, task: str) -> str | None:
        """Return the digest of the task's world when its runs were made; None if an older file does not have it."""
        return self._of_task("digest", task)

    def definition_of(self, task: str) -> str | None:
        """Return the definition of the task when its runs were made, as JSON; None if an older file does not have it."""
        return self._of_task("definition", task)

    def navigates(self, task: str) -> bool:
        """Return whether the runs of the task have velocity and position, too."""
        return self._criteria(task).navigates

    def _criteria(self, task: str) -> Criteria:
        text = self._of_task("criteria", task)
        with self.reading(f"the criteria of {task}"):
            return criteria_of(text or "")

    def _of_task(self, column: str, task: str) -> str | None:
        with self.explaining():
            found = self.connection.execute(f"SELECT {column} FROM tasks WHERE task = ?", (task,)).fetchone()
        return found[0] if found else None

    def sessions(self, key: Key) -> list[Session]:
        """Return the sessions that made the runs of a key, the earliest first."""
        sql = f"""SELECT session, started, machine, versions, count(*) FROM runs
            LEFT JOIN sessions ON sessions.id = session WHERE {_OF_KEY} GROUP BY session ORDER BY session"""
        with self.explaining():
            found = self.connection.execute(sql, key.values).fetchall()
        with self.reading("the sessions"):
            return [
                Session(number or 0, started or "unknown", machine or "unknown", versions_of(versions or "{}"), runs)
                for number, started, machine, versions, runs in found
            ]

    def add_cost(self, key: Key, cost: Cost) -> None:
        """Write or replace the cost of a step of the solver."""
        values = (key.task, key.solver, key.settings_hash, key.code)
        with self.explaining(), self.transaction():
            row = (*values, self.session(), *cost)
            self.connection.execute("INSERT OR REPLACE INTO costs VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)

    def session(self) -> int:
        """Return the number of this session, which the file has from the first time on; it belongs in a transaction."""
        if self._session is None:
            sql = "INSERT INTO sessions (versions, machine) VALUES (?, ?)"
            self._session = self.connection.execute(sql, (json.dumps(version.packages(PACKAGES)), _machine())).lastrowid
        assert self._session is not None
        return self._session

    def keys(
        self, tasks: Sequence[str] = (), solvers: Sequence[str] = (), *, every_code: bool = False, oracles: bool = False
    ) -> list[Key]:
        """Return the keys of these tasks and solvers (all by default) in the order of evaluation.

        A solver has only the key of its latest code, unless ``every_code`` asks for all. The oracle, which is no solver, has one
        only with ``oracles``.
        """
        sql = f"""WITH groups AS (SELECT max(id) AS last FROM runs GROUP BY {", ".join(KEY[:-1])})
            SELECT task, suite, solver, settings, code FROM groups JOIN runs ON id = last ORDER BY last"""
        with self.explaining():
            found = [Key(*row) for row in self.connection.execute(sql)]
        latest = {(key.task, key.suite, key.solver, key.settings): key for key in found}
        there = [key for key in (found if every_code else latest.values()) if oracles or key.solver != oracle.SOLVER]
        return [key for key in there if key.among(tasks, solvers)]

    def results(self, key: Key, runs: Container[int] | None = None, whole: bool = True) -> Results:
        """Return the results of a key, as :func:`evaluate` does, for the runs in ``runs`` or for all.

        Texts are made visible, as they are shown; the key has them as they are stored.
        Without ``whole`` only the fields for tables are read, which is several times faster. Scores that no table shows
        are then NaN. Histories have length 0, unless the task navigates, because its tables need them.
        """
        criteria = self._criteria(key.task)
        scores = scores_of(whole)
        with self.explaining():
            numbers = self._read("runs", columns_of(scores), key, runs)
            spans = self._read(_WITH_SPANS, SPAN_COLUMNS, key, runs) if criteria.navigates else None
            sql = f"SELECT run, {', '.join(map(shortened, columns_of(TOLD)))} FROM runs WHERE {_OF_KEY} AND ({TROUBLE})"
            odd = {
                run: [visible(one, keep=LAYOUT) if isinstance(one, str) else one for one in told]
                for run, *told in self.connection.execute(sql, key.values)
            }
            blobs = None
            if whole or criteria.navigates:
                blobs = [blob or b"" for _, blob in self._read(_WITH_HISTORIES, ["history"], key, runs)]
        with self.reading(f"rows of {key.solver} on {key.task}"):
            known = parted(_array(numbers, columns_of(scores))[:, 1:], scores)
            known |= {} if spans is None else parted(_array(spans, SPAN_COLUMNS)[:, 1:], SPANS)
            records = to_records([row[0] for row in numbers], odd, known, criteria, blobs)
        task, bound = self._task(key.task)
        settings = visible_parts(object_of(key.settings))
        luck = self._oracle(key, whole) if bound is not None else None
        return Results(task, visible(key.solver), settings, visible(key.suite), records, self._cost(key), bound, luck)

    def _oracle(self, key: Key, whole: bool) -> Records | None:
        """Return the runs of the oracle in the task and suite of a key; None if the file has none."""
        if key.solver == oracle.SOLVER:
            return None
        at = key.task, key.suite, whole
        if at not in self._oracles:
            sql = "SELECT settings, code FROM runs WHERE task = ? AND suite = ? AND solver = ? ORDER BY id DESC LIMIT 1"
            with self.explaining():
                found = self.connection.execute(sql, (key.task, key.suite, oracle.SOLVER)).fetchone()
            of = found and Key(key.task, key.suite, oracle.SOLVER, *found)
            self._oracles[at] = self.results(of, whole=whole).records if of else None
        return self._oracles[at]

    def _read(
        self, tables: str, columns: Sequence[str], key: Key, runs: Container[int] | None
    ) -> list[tuple[Any, ...]]:
        """Return the number and these columns of the runs of a key, for the runs in ``runs`` or for all."""
        sql = f"SELECT run, {', '.join(columns)} FROM {tables} WHERE {_OF_KEY} ORDER BY run"
        found = self.connection.execute(sql, key.values).fetchall()
        return found if runs is None else [row for row in found if row[0] in runs]

    def _cost(self, key: Key) -> Cost | None:
        sql = "SELECT median_us, p95_us, ratio FROM costs"
        sql += " WHERE task = ? AND solver = ? AND settings_hash = ? AND code = ?"
        with self.explaining():
            found = self.connection.execute(sql, (key.task, key.solver, key.settings_hash, key.code)).fetchone()
        return Cost(*found) if found else None

    def rows(self, key: Key, columns: Sequence[str]) -> Iterator[tuple[Any, ...]]:
        """Yield these columns of every run of a key, ordered by run; an unknown value is None.

        The columns may be among SPAN_COLUMNS, too.
        """
        sql = f"SELECT {', '.join(map(shortened, columns))} FROM {_WITH_SPANS} WHERE {_OF_KEY} ORDER BY run"
        with self.explaining():
            # map keeps the end of an unfinished iteration from closing the cursor, because the file may be closed already
            yield from map(tuple, self.connection.execute(sql, key.values))

    def _task(self, name: str) -> tuple[EvaluationTask, Bound | Literal["ask"] | None]:
        """Return the task under which the runs were made, and its bound; the present task if an older file has none.

        Nothing is computed from the file's own definition. A missing bound is computed for a task of this package, if
        definition and digest in the file are those of the task; for any other task there is none.
        """
        if name not in self._tasks:
            with self.explaining():
                sql = "SELECT definition, digest, bound FROM tasks WHERE task = ?"
                definition, found, bound = self.connection.execute(sql, (name,)).fetchone()
            with self.reading(f"the definition of {name}"):
                task = get_task(name) if definition is None else definition_of(definition)
                found_bound = _missing_bound(task, found) if bound is None else bound_of(bound)
                self._tasks[name] = visible_fields(task), found_bound
        return self._tasks[name]


def _missing_bound(task: EvaluationTask, found: str | None) -> Literal["ask"] | None:
    """Return "ask" if the task and its digest in a file are those of this package, so that the bound is its; if not, None.

    A recording has no bound, and may not be on this machine.
    """
    own = TASKS.get(task.name)
    if own and own.windows:
        return None
    same = own is not None and binding(definition_json(own)) == binding(definition_json(task))
    return "ask" if own and same and found in (None, digest(own)) else None


def shortened(column: str) -> str:
    """Return the SQL expression that reads a column; of a message or traceback no more than is written today."""
    return f"substr({column}, 1, {MOST_TEXT}) AS {column}" if column in _TEXTS else column


def _array(rows: Sequence[tuple[Any, ...]], columns: Sequence[str]) -> Array:
    """Return rows as an array (R, 1 + columns); NULL becomes NaN."""
    return np.array(rows, dtype=float).reshape(len(rows), 1 + len(columns))


def _machine() -> str:
    return f"{platform.node()} {platform.machine()} {platform.system()} {platform.release()}"
