"""Access to a results file: SQLite with a write-ahead log, migration of its schema, and errors in one line."""

from __future__ import annotations

import itertools
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import sins_env.evaluation.store.inspection as inspection  # the package would look for the name in this module
from sins_env.evaluation.store.schema import MIGRATIONS, REINDEX, SCHEMA, SCHEMA_VERSION, UNINDEX

APPLICATION_ID = 0x53494E53  #: mark of our files in the SQLite header, "SINS"
_NAMES_A_FILE = bytes.fromhex("d9d505f920a163d7")  #: end of a rollback journal that names another file
BUSY_S = 30.0  #: longest wait for another program that has locked the file, s


class StoreError(ValueError):
    """Error for a results file that cannot be read or written; the message has the file and the reason."""


class Database:
    """An open results file, which is a context manager. With ``read_only`` it never creates or changes the file.

    The whole file is inspected before anything else is read from it or written to it (``inspection``).

    Raises:
        StoreError: no such file, not a results file, a newer schema, or no access.
    """

    def __init__(self, path: str | Path, read_only: bool = False) -> None:
        self.path = Path(path)
        self._file: tuple[int, int] | None = None  #: the file that is written, which must stay at its path
        if read_only and not self.path.exists():
            raise StoreError(f"{self.path}: no such results file; sins-env eval makes one")
        if not read_only and self.path.exists() and not os.access(self.path, os.W_OK):
            raise StoreError(f"{self.path}: cannot be written (read-only)")
        _refuse_foreign_journal(self.path)
        with self.explaining():
            self.connection = _open_read_only(self.path) if read_only else _connect(self.path)
            try:
                self._check(read_only)
                self._file = None if read_only else _identity(self.path)
            except BaseException:
                self.connection.close()
                raise

    def _check(self, read_only: bool) -> None:
        """Check and migrate the schema of an existing file; create that of a new one in one transaction."""
        db = self.connection
        facts = "user_version, application_id FROM pragma_user_version, pragma_application_id"
        # in one statement, because another process may be making the file
        objects, version, application = db.execute(f"SELECT (SELECT count(*) FROM sqlite_master), {facts}").fetchone()
        empty = not objects
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
            self._inspect()
            return
        if not (empty or old):
            self._inspect()
        db.execute("PRAGMA journal_mode = WAL")
        with self.transaction():
            if db.execute("SELECT count(*) FROM sqlite_master").fetchone() == (0,):
                for statement in SCHEMA:
                    db.execute(statement)
                db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            if self._migrate():
                self._inspect()

    def _inspect(self) -> None:
        try:
            with self.snapshot():
                inspection.inspect(self.connection)
        except ValueError as error:
            raise StoreError(f"{self.path}: {error}") from error

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """Read everything in the context from one state of the file, whatever others write meanwhile."""
        if self.connection.in_transaction:
            yield
            return
        self.connection.execute("BEGIN")
        try:
            yield
        finally:
            if self.connection.in_transaction:  # an error of SQLite may have ended it
                self.connection.execute("ROLLBACK")

    def _migrate(self) -> bool:
        """Migrate the tables to the present schema, step by step; return whether they were older."""
        db = self.connection
        (found,) = db.execute("PRAGMA user_version").fetchone()
        if found == SCHEMA_VERSION:
            return False
        try:
            inspection.inspect_kinds(db)
            db.execute(UNINDEX)  # an older index may compute anything
            inspection.inspect_pages(db)
        except ValueError as error:
            raise StoreError(f"{self.path}: {error}") from error
        steps = itertools.chain.from_iterable(MIGRATIONS[version] for version in range(found, SCHEMA_VERSION))
        for statement in [*steps, REINDEX]:
            db.execute(statement)
        db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        return True

    def _read_a_migrated_copy(self) -> None:
        """Migrate a temporary copy of an older file, for a file opened to be read stays as it is."""
        copy = _connect("")
        self.connection.backup(copy)
        self.connection.close()
        self.connection = copy
        self._migrate()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self.connection.close()

    @contextmanager
    def explaining(self) -> Iterator[None]:
        """Turn errors of SQLite into a StoreError with the file and the reason."""
        try:
            yield
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: {_explain(error)}") from error

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Write everything in the context, or nothing if it raises an exception.

        Raises:
            StoreError: another program has removed or replaced the file.
        """
        self.connection.execute("BEGIN IMMEDIATE")
        try:
            yield
            self.connection.execute("COMMIT")
        except BaseException:
            if self.connection.in_transaction:
                self.connection.execute("ROLLBACK")
            raise
        if self._file and _identity(self.path) != self._file:  # the connection would go on writing to the old file
            raise StoreError(f"{self.path}: removed or replaced by another program; --resume makes again what was lost")

    @contextmanager
    def reading(self, what: str) -> Iterator[None]:
        """Turn the exceptions of a damaged row into a StoreError that names what cannot be read."""
        try:
            yield
        except (TypeError, ValueError, KeyError) as error:
            raise StoreError(f"{self.path}: {what} cannot be read ({error})") from error


def _refuse_foreign_journal(path: Path) -> None:
    """Refuse a rollback journal that names another file, which SQLite would remove after it has rolled back.

    SQLite writes the name for transactions over several files. This package has none.
    """
    journal = path.resolve().with_name(f"{path.resolve().name}-journal")
    if not journal.is_file():
        return
    try:
        with open(journal, "rb") as file:
            file.seek(max(os.fstat(file.fileno()).st_size - len(_NAMES_A_FILE), 0))
            if file.read() != _NAMES_A_FILE:
                return
    except FileNotFoundError:  # another process has ended its transaction
        return
    raise StoreError(f"{journal}: names another file, as no journal of sins-env does; remove it to open {path.name}")


def _connect(target: str | Path) -> sqlite3.Connection:
    """Connect to a file or an SQLite URI, without an isolation level, so that transactions begin explicitly."""
    db = sqlite3.connect(target, timeout=BUSY_S, isolation_level=None, uri=isinstance(target, str))
    try:
        inspection.limit(db)
    except BaseException:
        db.close()
        raise
    return db


def _identity(path: Path) -> tuple[int, int] | None:
    """Return device and number of the file at a path; None if there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def _open_read_only(path: Path) -> sqlite3.Connection:
    """Open a file for reading.

    A connection that may write comes first, because it removes the files of the log when it closes. The last mode is for
    a directory that cannot be written. It comes first for a file that cannot be written and has no log, because a connection
    that may not write would make the files of the log and leave them.
    """
    uri = path.resolve().as_uri()
    modes = ("?mode=rw", "?mode=ro", "?immutable=1")
    sealed = not os.access(path, os.W_OK) and not path.with_name(f"{path.name}-wal").exists()
    for mode in modes[-1:] if sealed else modes:
        try:
            db = _connect(uri + mode)
        except sqlite3.OperationalError:
            if mode == "?immutable=1":
                raise
            continue
        db.execute("PRAGMA query_only = 1")
        return db
    raise AssertionError("unreachable")


def _explain(error: sqlite3.Error) -> str:
    text = str(error)
    for part, meaning in (
        ("not a database", "not a results file (not SQLite)"),
        ("locked", f"locked by another program for more than {BUSY_S:.0f} s"),
        ("readonly", "cannot be written (read-only)"),
        ("unable to open", "cannot be opened: no such directory, or no permission"),
        ("full", "the disk is full; free some space, and --resume continues"),
        ("malformed", "damaged (not a whole SQLite file)"),
        ("interrupted", "not a results file of sins-env: too many tables and indices"),
        ("too big", f"a row of more than {inspection.MOST_BYTES / 1e6:.0f} MB"),
        ("decode to UTF-8", "damaged (a text that is not UTF-8)"),
    ):
        if part in text:
            return meaning
    return text
