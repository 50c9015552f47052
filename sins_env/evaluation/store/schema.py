"""Tables and columns of the results file, and the steps that bring an older file up to date.

What is kept of a run follows from the fields of :class:`Records`. A field that says ``since=n`` makes ``n`` the present schema;
older files get its columns when they are opened, empty for the runs that they hold.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable

from sins_env.evaluation.play.fields import Field
from sins_env.evaluation.play.records import FIELDS

SCHEMA_VERSION = max(4, *(one.since for one in FIELDS.values()))
KEY = ("task", "suite", "solver", "settings_hash", "code", "run")

#: Words and counts: of most runs there is nothing to tell.
TOLD = [one for one in FIELDS.values() if one.kind in ("word", "text", "count") and one.name != "run"]
#: Numbers of every run, and those of navigation tasks besides, which have a table of their own.
SCORES = [one for one in FIELDS.values() if one.kind == "number" and not one.navigates]
SPANS = [one for one in FIELDS.values() if one.kind == "number" and one.navigates]

_TYPES = {"number": "REAL", "count": "INTEGER", "word": "TEXT", "text": "TEXT"}


def columns_of(fields: Iterable[Field]) -> list[str]:
    """Names of the columns of these fields."""
    return [name for one in fields for name in one.columns]


COLUMNS = [*KEY, "settings", "session", *columns_of([*TOLD, *SCORES])]
SPAN_COLUMNS = columns_of(SPANS)

#: Rows that have more to tell than scores. A traceback comes with a reason.
TROUBLE = " OR ".join(f"{one.name} <> {one.usual!r}" for one in TOLD if one.name != "traceback")


def _until(version: int, fields: Iterable[Field]) -> list[Field]:
    return [one for one in fields if one.since <= version]


def _typed(one: Field) -> list[str]:
    """Columns with their types; what was told later has the usual value in the rows that were there before."""
    default = f" DEFAULT {one.usual!r}" if one.since > 1 and one.usual is not None else ""
    return [f"{name} {_TYPES[one.kind]}{default}" for name in one.columns]


def _listed(fields: Iterable[Field], version: int) -> str:
    """The columns that a version of the schema has of these fields."""
    return ", ".join(itertools.chain.from_iterable(_typed(one) for one in _until(version, fields)))


def _runs(version: int) -> str:
    return f"""CREATE TABLE runs (
    id INTEGER PRIMARY KEY, task TEXT, suite TEXT, solver TEXT, settings_hash TEXT, code TEXT, run INTEGER,
    settings TEXT, session INTEGER REFERENCES sessions (id), {_listed(TOLD, version)},
    {_listed(SCORES, version)}, UNIQUE ({", ".join(KEY)}))"""


def _spans(version: int) -> str:
    """Numbers of runs of navigation tasks: rad, m/s, m."""
    return f"""CREATE TABLE spans (id INTEGER PRIMARY KEY REFERENCES runs (id),
    {_listed(SPANS, version)})"""


#: Apart from the scores, so that a table reads those alone.
_HISTORIES = "CREATE TABLE histories (id INTEGER PRIMARY KEY REFERENCES runs (id), history BLOB)"
_TROUBLES = f"CREATE INDEX troubles ON runs ({', '.join(KEY)}) WHERE {TROUBLE}"

#: rad, and s from the start of fine alignment; t_conv is Inf where censored; NULL is not known.
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
)


def _added(version: int) -> tuple[str, ...]:
    """The step to a version: a column for each field that is new in it."""
    added = [(table, one) for table, some in (("runs", [*TOLD, *SCORES]), ("spans", SPANS)) for one in some]
    return tuple(
        f"ALTER TABLE {table} ADD COLUMN {column}"
        for table, one in added
        if one.since == version
        for column in _typed(one)
    )


def _rebuilt() -> tuple[str, ...]:
    """The step to the third schema: histories in a table of their own, definitions of tasks."""
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


#: From each older schema to the next. The index follows at the end, for it is of the columns of the present one.
MIGRATIONS = {version: _added(version + 1) for version in range(1, SCHEMA_VERSION)}
MIGRATIONS |= {2: _rebuilt(), 3: (_spans(4),)}
REINDEX = ("DROP INDEX IF EXISTS troubles", _TROUBLES)
