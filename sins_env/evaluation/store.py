"""The results file: SQLite with a write-ahead log, one row per run. evaluation.md section 5.

A run is identified by task (its version is in the name), suite-seed hash, solver, settings hash, code version and run
number. Rows are written by the parent process, one transaction per chunk, so a killed evaluation leaves whole rows only
and two evaluations may share a file.
"""

from __future__ import annotations

import hashlib
import json
import math
import platform
import sqlite3
import sys
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from sins_env.evaluation.cost import Cost
from sins_env.evaluation.monte_carlo import Results
from sins_env.evaluation.scoring import AXES, NEES_AT, Criteria, Records
from sins_env.evaluation.tasks import get_task

APPLICATION_ID = 0x53494E53  #: "SINS"
SCHEMA_VERSION = 1
BUSY_S = 30.0
VECTORS = ("t_conv", "hold_max", "steady_mean", "steady_std", "steady_rms", "final")
SCALARS = ("heading", "step_s")

_KEY = ("task", "suite", "solver", "settings_hash", "code", "run")
_VECTOR_COLUMNS = [f"{name}_{axis.lower()}" for name in VECTORS for axis in AXES]
_NEES_COLUMNS = [f"nees_{round(100 * part)}" for part in NEES_AT]
_SCORES = [*_VECTOR_COLUMNS, *SCALARS, *_NEES_COLUMNS]
_COLUMNS = [*_KEY, "settings", "session", "status", "reason", "traceback", "repairs", *_SCORES, "history"]
_SCHEMA = (
    "CREATE TABLE sessions (id INTEGER PRIMARY KEY, started TEXT DEFAULT CURRENT_TIMESTAMP, versions TEXT, machine TEXT)",
    "CREATE TABLE runs (task TEXT, suite TEXT, solver TEXT, settings_hash TEXT, code TEXT, run INTEGER, settings TEXT,"
    " session INTEGER REFERENCES sessions (id), status TEXT, reason TEXT, traceback TEXT, repairs INTEGER,"
    f" {', '.join(f'{name} REAL' for name in _SCORES)}, history BLOB, PRIMARY KEY ({', '.join(_KEY)}))",
    "CREATE TABLE tasks (task TEXT PRIMARY KEY, criteria TEXT)",
    "CREATE TABLE costs (task TEXT, solver TEXT, settings_hash TEXT, code TEXT, session INTEGER, median_us REAL,"
    " p95_us REAL, ratio REAL, PRIMARY KEY (task, solver, settings_hash, code))",
)


class StoreError(ValueError):
    """The results file cannot be read or written; the message says which file and why."""


@dataclass(frozen=True)
class Key:
    """Which solver on which suite, with which code."""

    task: str
    suite: str
    solver: str
    settings: str  #: canonical JSON
    code: str

    @classmethod
    def of(cls, task: str, suite: str, solver: str, settings: Mapping[str, Any], code: str) -> Key:
        return cls(task, suite, solver, canonical(settings), code)

    @property
    def settings_hash(self) -> str:
        return hashlib.sha256(self.settings.encode()).hexdigest()[:12]

    @property
    def values(self) -> tuple[str, ...]:
        return self.task, self.suite, self.solver, self.settings_hash, self.code


def canonical(settings: Mapping[str, Any]) -> str:
    """Settings as JSON with sorted keys.

    Raises:
        ValueError: a value that JSON does not have.
    """
    try:
        return json.dumps(dict(settings), sort_keys=True)
    except TypeError as error:
        raise ValueError(f"settings {dict(settings)!r}; allowed in a results file: numbers, text, lists") from error


class Store:
    """An open results file; a context manager. ``read_only`` never creates or changes it."""

    def __init__(self, path: str | Path, read_only: bool = False) -> None:
        self.path = Path(path)
        if read_only and not self.path.exists():
            raise StoreError(f"{self.path}: no such results file; sins-env eval makes one")
        self._session: int | None = None
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
        if not empty and version != SCHEMA_VERSION:
            raise StoreError(f"{self.path}: results of schema {version}; this version reads schema {SCHEMA_VERSION}")
        if read_only:
            if empty:
                raise StoreError(f"{self.path}: an empty file, no results")
            return
        db.execute("PRAGMA journal_mode = WAL")
        with self._transaction():
            if db.execute("SELECT count(*) FROM sqlite_master").fetchone() == (0,):
                for statement in _SCHEMA:
                    db.execute(statement)
                db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")

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
        where = " AND ".join(f"{name} = ?" for name in _KEY[:-1])
        with self._errors():
            return {run for (run,) in self._db.execute(f"SELECT run FROM runs WHERE {where}", key.values)}

    def add(self, key: Key, records: Records) -> None:
        """Write the rows of a chunk, all or none; rows that are there already stay as they are."""
        marks = ", ".join("?" * len(_COLUMNS))
        with self._errors(), self._transaction():
            session = self._of_session()
            rows = [_to_row(key, session, records.row(i)) for i in range(len(records))]
            self._db.execute("INSERT OR IGNORE INTO tasks VALUES (?, ?)", (key.task, _criteria(records.criteria)))
            self._db.executemany(f"INSERT OR IGNORE INTO runs ({', '.join(_COLUMNS)}) VALUES ({marks})", rows)

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
        """What the file holds, the latest code of each solver only, in the order in which it was evaluated."""
        sql = "SELECT task, suite, solver, settings, code FROM runs GROUP BY 1, 2, 3, 4, 5 ORDER BY max(rowid)"
        with self._errors():
            found = [Key(*row) for row in self._db.execute(sql)]
        latest = {(key.task, key.suite, key.solver, key.settings): key for key in found}
        return [k for k in latest.values() if (not tasks or k.task in tasks) and (not solvers or k.solver in solvers)]

    def results(self, key: Key) -> Results:
        """The runs of a solver as :func:`evaluate` returns them."""
        where = " AND ".join(f"{name} = ?" for name in _KEY[:-1])
        with self._errors():
            cursor = self._db.execute(f"SELECT {', '.join(_COLUMNS)} FROM runs WHERE {where}", key.values)
            rows = [dict(zip(_COLUMNS, row, strict=True)) for row in cursor]
            stored = self._db.execute("SELECT criteria FROM tasks WHERE task = ?", (key.task,)).fetchone()
            values = (key.task, key.solver, key.settings_hash, key.code)
            sql = "SELECT median_us, p95_us, ratio FROM costs"
            sql += " WHERE task = ? AND solver = ? AND settings_hash = ? AND code = ?"
            cost = self._db.execute(sql, values).fetchone()
        try:
            criteria = _criteria_of(stored[0])
            records = Records.of_rows(criteria, [_of_row(row, criteria) for row in rows])
        except (TypeError, ValueError, KeyError, zlib.error) as error:
            raise StoreError(f"{self.path}: rows of {key.solver} on {key.task} are damaged ({error})") from error
        settings = json.loads(key.settings)
        return Results(get_task(key.task), key.solver, settings, key.suite, records, Cost(*cost) if cost else None)


def _connect(target: str | Path) -> sqlite3.Connection:
    """Transactions are begun explicitly (no isolation level)."""
    return sqlite3.connect(target, timeout=BUSY_S, isolation_level=None, uri=isinstance(target, str))


def _open_read_only(path: Path) -> sqlite3.Connection:
    """Also where the directory cannot be written, which a write-ahead log would need."""
    for suffix in ("?mode=ro", "?immutable=1"):
        db = _connect(f"{path.resolve().as_uri()}{suffix}")
        try:
            db.execute("SELECT count(*) FROM sqlite_master")
            return db
        except sqlite3.OperationalError:
            db.close()
            if suffix != "?mode=ro":
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


def _criteria(criteria: Criteria) -> str:
    return json.dumps({n: v.tolist() if isinstance(v, np.ndarray) else v for n, v in vars(criteria).items()})


def _criteria_of(text: str) -> Criteria:
    return Criteria(**{n: np.array(v) if isinstance(v, list) else v for n, v in json.loads(text).items()})


def _to_row(key: Key, session: int, row: Mapping[str, Any]) -> tuple[Any, ...]:
    numbers = [float(row[name][j]) for name in VECTORS for j in range(3)]
    numbers += [float(row[name]) for name in SCALARS] + [float(value) for value in row["nees"]]
    history = zlib.compress(np.ascontiguousarray(row["history"], dtype="<f4").tobytes())
    told = (key.settings, session, str(row["status"]), row["reason"], row["traceback"], int(row["repairs"]))
    return (*key.values, int(row["run"]), *told, *(None if math.isnan(n) else n for n in numbers), history)


def _of_row(row: Mapping[str, Any], criteria: Criteria) -> dict[str, Any]:
    def number(name: str) -> float:
        return math.nan if row[name] is None else float(row[name])

    out: dict[str, Any] = {name: row[name] for name in ("run", "status", "reason", "traceback", "repairs")}
    out |= {name: np.array([number(f"{name}_{axis.lower()}") for axis in AXES]) for name in VECTORS}
    out |= {name: number(name) for name in SCALARS}
    out["nees"] = np.array([number(name) for name in _NEES_COLUMNS])
    history = np.frombuffer(zlib.decompress(row["history"]), dtype="<f4").astype(np.float32)
    out["history"] = history.reshape(len(criteria.history_t), 3)
    return out
