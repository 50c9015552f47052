"""Tables and columns of the results file, and the steps that migrate an older file.

The columns follow from the fields of :class:`Records`. A field with ``since=n`` raises the schema to ``n``. Older files get
its columns when they are opened; the runs that they hold have its usual value there, or none.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable

from sins_env.evaluation.play.fields import Field
from sins_env.evaluation.play.records import FIELDS

SCHEMA_VERSION = max(5, *(one.since for one in FIELDS.values()))
KEY = ("task", "suite", "solver", "settings_hash", "code", "run")

#: Words and counts of a run, which have their usual values in most runs.
TOLD = [one for one in FIELDS.values() if one.kind in ("word", "text", "count") and one.name != "run"]
#: Numbers of every run, and further numbers of navigation tasks, which have a table of their own.
SCORES = [one for one in FIELDS.values() if one.kind == "number" and not one.navigates]
SPANS = [one for one in FIELDS.values() if one.kind == "number" and one.navigates]

_TYPES = {"number": "REAL", "count": "INTEGER", "word": "TEXT", "text": "TEXT"}


def columns_of(fields: Iterable[Field]) -> list[str]:
    """Return the names of the columns of these fields."""
    return [name for one in fields for name in one.columns]


RUN_COLUMNS = [*KEY, "settings", "session", *columns_of([*TOLD, *SCORES])]
SPAN_COLUMNS = columns_of(SPANS)

#: SQL condition of rows with an unusual word or count. A traceback never comes without a reason.
TROUBLE = " OR ".join(f"{one.name} <> {one.usual!r}" for one in TOLD if one.name != "traceback")


def _until(version: int, fields: Iterable[Field]) -> list[Field]:
    return [one for one in fields if one.since <= version]


def _typed(one: Field) -> list[str]:
    """Return the columns of a field with their types; one that was added later has its usual value in older rows."""
    default = f" DEFAULT {one.usual!r}" if one.since > 1 and one.usual is not None else ""
    return [f"{name} {_TYPES[one.kind]}{default}" for name in one.columns]


def _listed(fields: Iterable[Field], version: int) -> str:
    """Return the columns of these fields in a version of the schema."""
    return ", ".join(itertools.chain.from_iterable(_typed(one) for one in _until(version, fields)))


def _runs(version: int) -> str:
    return f"""CREATE TABLE runs (
    id INTEGER PRIMARY KEY, task TEXT, suite TEXT, solver TEXT, settings_hash TEXT, code TEXT, run INTEGER,
    settings TEXT, session INTEGER REFERENCES sessions (id), {_listed(TOLD, version)},
    {_listed(SCORES, version)}, UNIQUE ({", ".join(KEY)}))"""


def _spans(version: int) -> str:
    """Return the statement of the table with numbers of navigation runs, in rad, m/s and m."""
    return f"""CREATE TABLE spans (id INTEGER PRIMARY KEY REFERENCES runs (id),
    {_listed(SPANS, version)})"""


#: Table of histories, apart from the scores, so that a table of scores does not read them.
_HISTORIES = "CREATE TABLE histories (id INTEGER PRIMARY KEY REFERENCES runs (id), history BLOB)"
#: Table of the rows that an older version of the code has made, and that count as made by a later one (adopting.py).
_ADOPTIONS = """CREATE TABLE adoptions (
    task TEXT, suite TEXT, solver TEXT, settings_hash TEXT, before TEXT, code TEXT, runs TEXT, compared INTEGER,
    session INTEGER REFERENCES sessions (id), PRIMARY KEY (task, suite, solver, settings_hash, before, session))"""
_TROUBLES = f"CREATE INDEX troubles ON runs ({', '.join(KEY)}) WHERE {TROUBLE}"

#: Statements that make a new file. Units are rad, and s from the start of fine alignment. A censored t_conv is Inf, and an
#: unknown value is NULL.
SCHEMA = (
    """CREATE TABLE sessions (
        id INTEGER PRIMARY KEY, started TEXT DEFAULT CURRENT_TIMESTAMP, versions TEXT, machine TEXT)""",
    _runs(SCHEMA_VERSION),
    _HISTORIES,
    _spans(SCHEMA_VERSION),
    _TROUBLES,
    "CREATE TABLE tasks (task TEXT PRIMARY KEY, criteria TEXT, definition TEXT, digest TEXT, bound TEXT)",
    """CREATE TABLE costs (
        task TEXT, solver TEXT, settings_hash TEXT, code TEXT, session INTEGER, median_us REAL, p95_us REAL,
        ratio REAL, PRIMARY KEY (task, solver, settings_hash, code))""",
    _ADOPTIONS,
)


def _added(version: int) -> tuple[str, ...]:
    """Return the statements that migrate to a version: they add a column for each of its new fields."""
    added = [(table, one) for table, some in (("runs", [*TOLD, *SCORES]), ("spans", SPANS)) for one in some]
    return tuple(
        f"ALTER TABLE {table} ADD COLUMN {column}"
        for table, one in added
        if one.since == version
        for column in _typed(one)
    )


def _rebuilt() -> tuple[str, ...]:
    """Return the statements that migrate to the third schema, with a table of histories and definitions of tasks."""
    both = ", ".join([*KEY, "settings", "session", *columns_of(_until(2, [*TOLD, *SCORES]))])
    return (
        "ALTER TABLE runs RENAME TO old_runs",
        _runs(3),
        _HISTORIES,
        f"INSERT INTO runs (id, {both}) SELECT rowid, {both} FROM old_runs",
        "INSERT INTO histories SELECT rowid, history FROM old_runs",
        "DROP TABLE old_runs",
        *(f"ALTER TABLE tasks ADD COLUMN {name} TEXT" for name in ("definition", "digest", "bound")),
    )


#: Statements that migrate each older schema to the next. The index follows at the end, because it uses present columns.
MIGRATIONS = {version: _added(version + 1) for version in range(1, SCHEMA_VERSION)}
MIGRATIONS |= {2: _rebuilt(), 3: (_spans(4),), 4: (_ADOPTIONS, *_added(5))}
UNINDEX, REINDEX = "DROP INDEX IF EXISTS troubles", _TROUBLES
