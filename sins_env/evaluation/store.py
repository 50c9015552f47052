"""The results file: SQLite with a write-ahead log, one row per run. evaluation.md section 5.

A run is identified by task (its version is in the name), suite-seed hash, solver, settings hash, code
version and run number. Rows are written by the parent process, one transaction per chunk, so a killed
evaluation leaves whole rows only and two evaluations may share a file.
"""

from __future__ import annotations

import json
import platform
import sqlite3
import sys
import zlib
from collections.abc import Container, Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from sins_env.evaluation.bounds import Bound
from sins_env.evaluation.cost import Cost
from sins_env.evaluation.monte_carlo import Results
from sins_env.evaluation.records import Records
from sins_env.evaluation.rows import (
    COLUMNS,
    KEY,
    MIGRATIONS,
    SCHEMA,
    SCHEMA_VERSION,
    SPAN_COLUMNS,
    TROUBLE,
    Key,
    binding,
    bound_of,
    bound_text,
    canonical,
    criteria_of,
    criteria_text,
    definition_of,
    definition_text,
    numbers_of,
    to_blob,
    to_records,
    to_row,
    to_span,
)
from sins_env.evaluation.tasks import EvaluationTask, digest, get_task

APPLICATION_ID = 0x53494E53  #: "SINS"
BUSY_S = 30.0


class StoreError(ValueError):
    """The results file cannot be read or written; the message says which file and why."""


class Session(NamedTuple):
    """One opening of the file that wrote runs."""

    id: int
    started: str  #: UTC
    machine: str
    versions: dict[str, str]  #: of Python and the packages
    runs: int  #: of those asked for


class Store:
    """An open results file; a context manager. ``read_only`` never creates or changes it."""

    def __init__(self, path: str | Path, read_only: bool = False) -> None:
        self.path = Path(path)
        if read_only and not self.path.exists():
            raise StoreError(f"{self.path}: no such results file; sins-env eval makes one")
        self._session: int | None = None
        self._tasks: dict[str, tuple[EvaluationTask, Bound | Literal["ask"] | None]] = {}
        with self._errors():
            self._db = _open_read_only(self.path) if read_only else _connect(self.path)
            try:
                self._check(read_only)
            except BaseException:
                self._db.close()
                raise

    def _check(self, read_only: bool) -> None:
        """Schema of an existing file; a new one is created in one transaction."""
        db = self._db
        (version,) = db.execute("PRAGMA user_version").fetchone()
        (application,) = db.execute("PRAGMA application_id").fetchone()
        empty = db.execute("SELECT count(*) FROM sqlite_master").fetchone() == (0,)
        if not empty and application != APPLICATION_ID:
            raise StoreError(f"{self.path}: a SQLite file, but not a results file of sins-env")
        old = not empty and version in MIGRATIONS
        if not (empty or old or version == SCHEMA_VERSION):
            allowed = ", ".join(map(str, [*MIGRATIONS, SCHEMA_VERSION]))
            raise StoreError(f"{self.path}: results of schema {version}; this version reads {allowed}")
        if read_only:
            if empty:
                raise StoreError(f"{self.path}: an empty file, no results")
            if old:
                self._read_a_migrated_copy()
            return
        db.execute("PRAGMA journal_mode = WAL")
        with self._transaction():
            if db.execute("SELECT count(*) FROM sqlite_master").fetchone() == (0,):
                for statement in SCHEMA:
                    db.execute(statement)
                db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            _migrate(db)

    def _read_a_migrated_copy(self) -> None:
        """A file that only is to be read stays as it is; its copy in memory gets the present schema."""
        copy = _connect(":memory:")
        self._db.backup(copy)
        self._db.close()
        self._db = copy
        _migrate(copy)

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._db.close()

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: {_explain(error)}") from error

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise

    def runs_of(self, key: Key) -> set[int]:
        """The runs that are there already."""
        where = " AND ".join(f"{name} = ?" for name in KEY[:-1])
        with self._errors():
            return {run for (run,) in self._db.execute(f"SELECT run FROM runs WHERE {where}", key.values)}

    def add(self, key: Key, records: Records) -> None:
        """Write the rows of a chunk, all or none; rows that are there already stay as they are."""
        marks = ", ".join("?" * len(COLUMNS))
        with self._errors(), self._transaction():
            session = self._of_session()
            sql = "INSERT INTO tasks (task, criteria) VALUES (?, ?)"
            sql += " ON CONFLICT DO UPDATE SET criteria = coalesce(criteria, excluded.criteria)"
            self._db.execute(sql, (key.task, criteria_text(records.criteria)))
            sql = f"INSERT OR IGNORE INTO runs ({', '.join(COLUMNS)}) VALUES ({marks}) RETURNING id"
            for run in map(records.row, range(len(records))):
                new = self._db.execute(sql, to_row(key, session, run)).fetchone()
                if new:
                    self._db.execute("INSERT OR REPLACE INTO histories VALUES (?, ?)", (*new, to_blob(run["history"])))
                    if records.criteria.navigates:
                        of_span = ", ".join("?" * (1 + len(SPAN_COLUMNS)))
                        self._db.execute(f"INSERT OR REPLACE INTO spans VALUES ({of_span})", to_span(new[0], run))

    def add_task(self, task: EvaluationTask) -> None:
        """Write what a table needs of a task, so that it can be made from the file alone.

        Raises:
            ValueError: the file has runs of another task of that name, or of another world.
        """
        now, present = definition_text(task), digest(task)
        bound = bound_text(task.bound())
        with self._errors(), self._transaction():
            sql = "SELECT definition, digest FROM tasks WHERE task = ?"
            held, before = self._db.execute(sql, (task.name,)).fetchone() or (None, None)
            if held is not None and binding(held) != binding(now):
                change = "its definition"
            elif before is not None and before != present:
                change = f"its world (digest {before}, now {present})"
            else:
                sql = "INSERT INTO tasks (task, definition, digest, bound) VALUES (?, ?, ?, ?) ON CONFLICT DO UPDATE"
                sql += " SET definition = excluded.definition, digest = excluded.digest, bound = excluded.bound"
                self._db.execute(sql, (task.name, now, present, bound))
                return
        raise ValueError(
            f"{self.path}: {task.name} has changed since its runs were made, {change}; they would not compare: "
            "a changed task needs a new version, or --db another file"
        )

    def digest_of(self, task: str) -> str | None:
        """Of the task's world when its runs were made; None in files that are older than that."""
        return self._of_task("digest", task)

    def definition_of(self, task: str) -> str | None:
        """JSON of the task when its runs were made; None in files that are older than that."""
        return self._of_task("definition", task)

    def navigates(self, task: str) -> bool:
        """Whether its runs have velocity and position, too."""
        criteria = self._of_task("criteria", task)
        return criteria is not None and criteria_of(criteria).navigates

    def _of_task(self, column: str, task: str) -> str | None:
        with self._errors():
            found = self._db.execute(f"SELECT {column} FROM tasks WHERE task = ?", (task,)).fetchone()
        return found[0] if found else None

    def sessions(self, key: Key) -> list[Session]:
        """Which sessions made the runs of a solver, the earliest first."""
        where = " AND ".join(f"{name} = ?" for name in KEY[:-1])
        sql = f"""SELECT session, started, machine, versions, count(*) FROM runs
            LEFT JOIN sessions ON sessions.id = session WHERE {where} GROUP BY session ORDER BY session"""
        with self._errors():
            found = self._db.execute(sql, key.values).fetchall()
        with self._damage("the sessions"):
            return [
                Session(number, started, machine, json.loads(versions), runs)
                for number, started, machine, versions, runs in found
            ]

    def add_cost(self, key: Key, cost: Cost) -> None:
        """Write, or replace, what a step of the solver costs."""
        values = (key.task, key.solver, key.settings_hash, key.code)
        with self._errors(), self._transaction():
            row = (*values, self._of_session(), *cost)
            self._db.execute("INSERT OR REPLACE INTO costs VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)

    def _of_session(self) -> int:
        if self._session is None:
            sql = "INSERT INTO sessions (versions, machine) VALUES (?, ?)"
            self._session = self._db.execute(sql, (json.dumps(_versions()), _machine())).lastrowid
        assert self._session is not None
        return self._session

    def keys(self, tasks: Sequence[str] = (), solvers: Sequence[str] = ()) -> list[Key]:
        """What the file holds, of each solver the latest code only, in the order of evaluation."""
        sql = f"""WITH groups AS (SELECT max(id) AS last FROM runs GROUP BY {", ".join(KEY[:-1])})
            SELECT task, suite, solver, settings, code FROM groups JOIN runs ON id = last ORDER BY last"""
        with self._errors():
            found = [Key(*row) for row in self._db.execute(sql)]
        latest = {(key.task, key.suite, key.solver, key.settings): key for key in found}
        return [key for key in latest.values() if key.among(tasks, solvers)]

    def results(self, key: Key, runs: Container[int] | None = None, whole: bool = True) -> Results:
        """The runs of a solver (those in ``runs``, or all) as :func:`evaluate` returns them.

        Not ``whole`` is for tables and several times faster: scores that no table shows are NaN, and histories of
        length 0 but where the task navigates, whose tables need them.
        """
        where = " AND ".join(f"{name} = ?" for name in KEY[:-1])
        with self._errors():
            sql = f"SELECT {', '.join(numbers_of(whole))} FROM runs WHERE {where} ORDER BY run"
            numbers = self._db.execute(sql, key.values).fetchall()
            if runs is not None:
                numbers = [row for row in numbers if row[0] in runs]
            sql = f"SELECT run, status, reason, traceback, repairs, fallbacks FROM runs WHERE {where} AND ({TROUBLE})"
            odd = {run: told for run, *told in self._db.execute(sql, key.values)}
            stored = self._db.execute("SELECT criteria FROM tasks WHERE task = ?", (key.task,)).fetchone()
        with self._damage(f"the criteria of {key.task}"):
            criteria = criteria_of(stored[0])
        columns = SPAN_COLUMNS if criteria.navigates else []
        with self._errors():
            spans = self._beside("spans", columns, where, key, runs) if columns else [()] * len(numbers)
            blobs = None
            if whole or criteria.navigates:
                blobs = [blob or b"" for (blob,) in self._beside("histories", ["history"], where, key, runs)]
            values = (key.task, key.solver, key.settings_hash, key.code)
            sql = "SELECT median_us, p95_us, ratio FROM costs"
            sql += " WHERE task = ? AND solver = ? AND settings_hash = ? AND code = ?"
            cost = self._db.execute(sql, values).fetchone()
        with self._damage(f"rows of {key.solver} on {key.task}"):
            given = np.array(numbers, dtype=float).reshape(len(numbers), -1)  # NULL becomes NaN
            of_span = np.array(spans, dtype=float).reshape(len(numbers), len(columns))
            records = to_records(given, odd, of_span, criteria, blobs)
        task, bound = self._task(key.task)
        settings = json.loads(key.settings)
        return Results(task, key.solver, settings, key.suite, records, Cost(*cost) if cost else None, bound)

    def rows(self, key: Key, columns: Sequence[str]) -> Iterator[tuple[Any, ...]]:
        """These columns of every run, in their order, those of SPAN_COLUMNS, too; None is not known."""
        where = " AND ".join(f"{name} = ?" for name in KEY[:-1])
        sql = f"SELECT {', '.join(columns)} FROM runs LEFT JOIN spans USING (id) WHERE {where} ORDER BY run"
        with self._errors():
            yield from self._db.execute(sql, key.values)

    def _beside(
        self, table: str, columns: Sequence[str], where: str, key: Key, runs: Container[int] | None
    ) -> list[tuple[Any, ...]]:
        """What another table holds of each run; None where it has no row of it."""
        sql = f"SELECT run, {', '.join(columns)} FROM runs LEFT JOIN {table} USING (id) WHERE {where} ORDER BY run"
        return [row[1:] for row in self._db.execute(sql, key.values) if runs is None or row[0] in runs]

    def _task(self, name: str) -> tuple[EvaluationTask, Bound | Literal["ask"] | None]:
        """The task under which the runs were made, and its bound; the present ones where an older file has neither."""
        if name not in self._tasks:
            with self._errors():
                sql = "SELECT definition, bound FROM tasks WHERE task = ?"
                definition, bound = self._db.execute(sql, (name,)).fetchone()
            with self._damage(f"the definition of {name}"):
                task = get_task(name) if definition is None else definition_of(definition)
                self._tasks[name] = task, "ask" if bound is None else bound_of(bound)
        return self._tasks[name]

    @contextmanager
    def _damage(self, what: str) -> Iterator[None]:
        try:
            yield
        except (TypeError, ValueError, KeyError, zlib.error) as error:
            raise StoreError(f"{self.path}: {what} cannot be read ({error})") from error


def _migrate(db: sqlite3.Connection) -> None:
    """Bring the tables to the present schema, step by step."""
    (version,) = db.execute("PRAGMA user_version").fetchone()
    while version in MIGRATIONS:
        for statement in MIGRATIONS[version]:
            db.execute(statement)
        version += 1
    db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")


def _connect(target: str | Path) -> sqlite3.Connection:
    """Transactions are begun explicitly (no isolation level)."""
    return sqlite3.connect(target, timeout=BUSY_S, isolation_level=None, uri=isinstance(target, str))


def _open_read_only(path: Path) -> sqlite3.Connection:
    """For reading. A connection that may write removes the log's files when it closes, so it is preferred;
    the last resort is for a directory that cannot be written."""
    uri = path.resolve().as_uri()
    for mode in ("?mode=rw", "?mode=ro", "?immutable=1"):
        db = _connect(uri + mode)
        try:
            db.execute("PRAGMA query_only = 1")
            db.execute("SELECT count(*) FROM sqlite_master")
            return db
        except sqlite3.OperationalError:
            db.close()
            if mode == "?immutable=1":
                raise
    raise AssertionError("unreachable")


def _explain(error: sqlite3.Error) -> str:
    text = str(error)
    for part, meaning in (
        ("not a database", "not a results file (not SQLite)"),
        ("locked", f"locked by another program for more than {BUSY_S:.0f} s"),
        ("readonly", "cannot be written (read-only)"),
        ("unable to open", "cannot be opened: no such directory, or no permission"),
        ("full", "the disk is full"),
        ("malformed", "damaged (not a whole SQLite file)"),
    ):
        if part in text:
            return meaning
    return text


def _versions() -> dict[str, str]:
    names = ("sins-env", "numpy", "scipy", "gymnasium", "filterpy")
    out = {"python": sys.version.split()[0]}
    for name in names:
        try:
            out[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            out[name] = "not installed"
    return out


def _machine() -> str:
    return f"{platform.node()} {platform.machine()} {platform.system()} {platform.release()}"


__all__ = ["Key", "Session", "Store", "StoreError", "canonical"]
