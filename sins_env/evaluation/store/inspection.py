"""Inspection of a results file when it is opened: nothing in it is believed before.

A file may come from a stranger. It may hold the tables, columns and index of ``schema`` and nothing else, and every column
the values that the package writes. What a column may hold follows from the fields of :class:`Records`, so a new field needs
no entry here. Histories are most of a file; each is inspected when it is read.
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import sins_env.evaluation.store.rows as rows  # the package would look for the name in the module "database"
from sins_env.evaluation.play.divergence import STATUSES
from sins_env.evaluation.play.fields import Field
from sins_env.evaluation.store.key import settings_hash
from sins_env.evaluation.store.schema import KEY, SCHEMA, SCORES, SPANS, TOLD

MOST_BYTES = 16_000_000  #: largest row of a table, bytes; SQLite refuses to read a larger one
MOST_SCHEMA = 100_000  #: most characters of a statement, also of one that a file holds
MOST_STEPS = 10_000  #: most steps of SQLite in reading the list of tables, some 1,000 entries; it has 13
MOST_NAME = 500  #: most characters of a name
MOST_SETTINGS = 20_000  #: most characters of the settings of a solver


class _Rule(NamedTuple):
    """What a column may hold: an SQL condition of wrong values, in which ``{0}`` is the column, and the allowed in words."""

    wrong: str
    allowed: str

    def but(self, usual: object) -> _Rule:
        """Return the rule for a column that mostly has one value, which is not looked at twice."""
        return self._replace(wrong=f"{{0}} IS NOT {usual!r} AND ({self.wrong})")

    def or_inf(self) -> _Rule:
        """Return the rule for a column that may hold inf as well."""
        return _Rule(f"{{0}} IS NOT 9e999 AND ({self.wrong})", f"{self.allowed}, or inf")


#: The length of a text in SQL ends at a zero byte, that of a blob does not; UTF-8 has up to four bytes a character.
_NAME = _Rule(
    f"typeof({{0}}) <> 'text' OR length({{0}}) NOT BETWEEN 1 AND {MOST_NAME} "
    f"OR length(CAST({{0}} AS BLOB)) > {4 * MOST_NAME}",
    f"1 to {MOST_NAME} characters",
)
_TEXT = _Rule("typeof({0}) <> 'text'", "text")
_OPTIONAL = _Rule("typeof({0}) NOT IN ('text', 'null')", "text, or NULL")
_OPTIONAL_NAME = _Rule(f"{{0}} IS NOT NULL AND ({_NAME.wrong})", f"{_NAME.allowed}, or NULL")
_SESSION = _Rule("typeof({0}) NOT IN ('integer', 'null')", "the id of a session, or NULL")
_COUNT = _Rule("typeof({0}) <> 'integer' OR {0} < 0", "a whole number that is not negative")
_MOST = f"{rows.MOST_NUMBER:.0e}"
_HUGE = f"abs({{0}}) > {_MOST} AND abs({{0}}) < 9e999"  #: statistics would overflow
_POSITIVE = f"a number from 0 to {_MOST}, or inf"
#: Numbers of a field by unit. SQLite orders numbers before text and blobs, so that one comparison tells both.
_OF_UNIT = {
    "rad": _Rule("{0} NOT BETWEEN -100 AND 100", "an angle in rad, or NULL if it is unknown"),
    **dict.fromkeys(
        ("s", ""), _Rule(f"{{0}} NOT BETWEEN 0 AND 9e999 OR {_HUGE}", f"{_POSITIVE}, or NULL if it is unknown")
    ),
    **dict.fromkeys(
        ("m", "m/s"), _Rule(f"{{0}} >= '' OR {_HUGE}", f"a number up to {_MOST}, inf, or NULL if it is unknown")
    ),
}
_RUNS = _Rule(
    f"typeof({{0}}) <> 'text' OR length({{0}}) > {MOST_SETTINGS} OR {{0}} GLOB '*[^0-9 -]*'",
    "ranges such as '0-199 205'",
)
_TIME = _Rule(f"typeof({{0}}) <> 'real' OR {{0}} < 0 OR {_HUGE}", _POSITIVE)
_RATIO = _Rule(f"{{0}} >= '' OR {{0}} < 0 OR {_HUGE}", f"{_POSITIVE}, or NULL")
_STATUS = _Rule(f"{{0}} IS NULL OR {{0}} NOT IN {STATUSES!r}", f"one of {', '.join(STATUSES)}")
_TOLD = {"word": _STATUS, "count": _COUNT, "text": _TEXT}


def _numbers(fields: Sequence[Field]) -> dict[str, _Rule]:
    """Return the rules of numbers, by column."""
    return {
        name: _OF_UNIT[unit].or_inf() if one.endless else _OF_UNIT[unit]
        for one in fields
        for name, unit in zip(one.columns, one.units, strict=True)
    }


_NAMES = [name for name in KEY if name != "run"]
#: The combinations of names, each with its first row; the index of the table has them, so that no row is read.
_COMBINED = f"(SELECT min(rowid) AS rowid, {', '.join(_NAMES)} FROM runs GROUP BY {', '.join(_NAMES)})"
#: Tables with the rule of each column, and where to read them; those of fields follow from the kinds of the fields.
_RULES: list[tuple[str, str, dict[str, _Rule]]] = [
    (
        "tasks",
        "tasks",
        {"task": _NAME, **dict.fromkeys(("criteria", "definition", "bound"), _OPTIONAL), "digest": _OPTIONAL_NAME},
    ),
    ("sessions", "sessions", {"started": _NAME, "versions": _TEXT, "machine": _NAME}),
    (
        "costs",
        "costs",
        {
            **dict.fromkeys(("task", "solver", "settings_hash", "code"), _NAME),
            **{"session": _SESSION, "median_us": _TIME, "p95_us": _TIME, "ratio": _RATIO},
        },
    ),
    (
        "adoptions",
        "adoptions",
        {
            **dict.fromkeys((*KEY[:-2], "before", "code"), _NAME),
            **{"runs": _RUNS, "compared": _COUNT, "session": _SESSION},
        },
    ),
    ("runs", _COMBINED, dict.fromkeys(_NAMES, _NAME)),
    (
        "runs",
        "runs",
        {
            "run": _COUNT,
            "session": _SESSION,
            **{name: _TOLD[one.kind].but(one.usual) for one in TOLD for name in one.columns},
            **_numbers(SCORES),
        },
    ),
    ("spans", "spans", _numbers(SPANS)),
]


def _wrong(table: str, row: int, column: str, what: str) -> ValueError:
    return ValueError(f"table {table}, row {row}: {column} {what}")


@contextmanager
def _at(table: str, row: int, column: str) -> Iterator[None]:
    """Put table, row and column before the message of a ValueError."""
    try:
        yield
    except ValueError as error:
        raise _wrong(table, row, column, f"cannot be read: {error}") from error


def limit(db: sqlite3.Connection) -> None:
    """Make a connection refuse damaged cells and rows larger than MOST_BYTES, and compute nothing that a file names.

    SQLite reads the list of tables before its first statement; it is read here, within bounds.

    Raises:
        sqlite3.Error: a file that cannot be read, or a list longer than any of this package.
    """
    db.execute("PRAGMA trusted_schema = OFF")
    db.execute("PRAGMA ignore_check_constraints = ON")
    db.execute("PRAGMA cell_size_check = ON")
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
    db.setlimit(sqlite3.SQLITE_LIMIT_SQL_LENGTH, MOST_SCHEMA)
    db.set_progress_handler(lambda: 1, MOST_STEPS)
    db.execute("SELECT count(*) FROM sqlite_master")
    db.set_progress_handler(None, 0)


def inspect_kinds(db: sqlite3.Connection) -> None:
    """Check that a file of any schema has nothing but tables and indices of this package.

    Raises:
        ValueError: a trigger, a view, a computed column, or a table or index of another name.
    """
    for kind, name, sql in _objects(db):
        if (kind, name) not in _LAYOUT or not re.match(rf"CREATE {kind}\b", sql, re.IGNORECASE):
            raise ValueError(f"it has the {kind} {name!r}; allowed: {_allowed()}")
        for (column,) in db.execute("SELECT name FROM pragma_table_xinfo(?) WHERE hidden", (name,)):
            raise ValueError(f"the table {name} has the computed column {column!r}; allowed: {name} of sins-env")


def inspect_pages(db: sqlite3.Connection) -> None:
    """Check that the pages of the tables are trees, each page once, and that their indices have the same rows.

    It comes before any scan: in pages that refer to one page many times a scan would have no end.

    Raises:
        ValueError: a damaged file.
    """
    for kind, name, _ in _objects(db):
        if kind == "table" and name != "histories":
            for (text,) in db.execute(f"PRAGMA integrity_check({name})"):
                if text != "ok":
                    first = text.removeprefix("*** in database main ***\n").partition("\n")[0]
                    raise ValueError(f"damaged ({first})")


def inspect(db: sqlite3.Connection) -> None:
    """Check the tables of the present schema and every value in them.

    Raises:
        ValueError: what does not belong there, with its table, row and column.
        sqlite3.Error: a damaged file.
    """
    inspect_kinds(db)
    found = {(kind, name): _definition(sql) for kind, name, sql in _objects(db)}
    for (kind, name), expected in _LAYOUT.items():
        if (kind, name) not in found:
            raise ValueError(f"it has no {kind} {name}; allowed: {_allowed()}")
        for text in sorted(found[kind, name] ^ expected):
            raise ValueError(
                f"the {kind} {name} {'lacks' if text in expected else 'has'} {text!r}; allowed: {name} of sins-env"
            )
    inspect_pages(db)
    for table, source, rules in _RULES:
        _inspect_values(db, table, source, rules)
    for _ in db.execute(f"SELECT * FROM {_COMBINED}"):
        pass  # which fails where a name is not UTF-8
    _inspect_settings(db)
    _inspect_tasks(db)
    for row, versions in db.execute("SELECT rowid, versions FROM sessions"):
        with _at("sessions", row, "versions"):
            rows.versions_of(versions)


def _objects(db: sqlite3.Connection) -> list[tuple[str, str, str]]:
    """Return kind, name and statement of everything in the file, but for indices that SQLite makes itself."""
    sql = "SELECT type, name, coalesce(sql, '') FROM sqlite_master WHERE NOT (type = 'index' AND sql IS NULL)"
    return db.execute(sql).fetchall()


def _definition(sql: str) -> frozenset[str]:
    """Return the parts of a statement that makes a table: columns and constraints, and what stands behind them.

    Their order does not count, because a column that was added later stands elsewhere. An index is one part.
    """
    sql = " ".join(sql.split())
    if not sql.upper().startswith("CREATE TABLE"):
        return frozenset([sql])
    start, end = sql.index("("), sql.rindex(")")
    parts, depth, begin = [], 0, start + 1
    for at in range(begin, end):
        depth += {"(": 1, ")": -1}.get(sql[at], 0)
        if sql[at] == "," and not depth:
            parts.append(sql[begin:at].strip())
            begin = at + 1
    return frozenset(filter(None, [*parts, sql[begin:end].strip(), sql[end + 1 :].strip()]))


def _name(statement: str) -> tuple[str, str]:
    kind, name = re.findall(r"\w+", statement)[1:3]
    return kind.lower(), name


_LAYOUT = {_name(statement): _definition(statement) for statement in SCHEMA}


def _allowed() -> str:
    return "the tables " + ", ".join(sorted(name for kind, name in _LAYOUT if kind == "table")) + " of sins-env alone"


def _inspect_values(db: sqlite3.Connection, table: str, source: str, rules: dict[str, _Rule]) -> None:
    """Find the first wrong value in one scan."""
    columns = list(rules)
    cases = " ".join(f"WHEN {rules[name].wrong.format(name)} THEN {i}" for i, name in enumerate(columns))
    found = db.execute(f"SELECT rowid, CASE {cases} END AS at FROM {source} WHERE at IS NOT NULL LIMIT 1").fetchone()
    if found is None:
        return
    row, at = found
    name = columns[at]
    sql = f"SELECT typeof({name}), length({name}), iif(typeof({name}) IN ('integer', 'real'), {name}, NULL)"
    kind, length, value = db.execute(f"{sql} FROM {table} WHERE rowid = ?", (row,)).fetchone()
    what = {"null": "NULL", "text": f"text of length {length}", "blob": f"a blob of {length} bytes"}.get(
        kind, repr(value)
    )
    raise _wrong(table, row, name, f"is {what}; allowed: {rules[name].allowed}")


def _inspect_settings(db: sqlite3.Connection) -> None:
    for hashed, settings in db.execute("SELECT DISTINCT settings_hash, settings FROM runs"):
        try:
            if not isinstance(settings, str) or len(settings) > MOST_SETTINGS:
                raise ValueError(f"no text of up to {MOST_SETTINGS:,} characters")
            rows.object_of(settings)
            if hashed != settings_hash(settings):
                raise ValueError(
                    f"settings_hash is {hashed!r}; allowed: {settings_hash(settings)!r}, as the settings say"
                )
        except ValueError as error:
            sql = "SELECT min(rowid) FROM runs WHERE settings_hash = ? AND settings IS ?"
            (row,) = db.execute(sql, (hashed, settings)).fetchone()
            raise _wrong("runs", row, "settings", f"cannot be read: {error}") from error


def _inspect_tasks(db: sqlite3.Connection) -> None:
    scored = set()
    for row, task, criteria, definition, bound in db.execute(
        "SELECT rowid, task, criteria, definition, bound FROM tasks"
    ):
        if criteria is not None:
            scored.add(task)
        with _at("tasks", row, "criteria"):
            scored_by = criteria if criteria is None else rows.criteria_of(criteria)
        with _at("tasks", row, "definition"):
            if definition is not None and rows.definition_of(definition).name != task:
                raise ValueError("another name than the task's; allowed: the same")
        with _at("tasks", row, "bound"):
            known = None if bound is None else rows.bound_of(bound)
            if known and scored_by and known.fits(scored_by) and len(known.t) != len(scored_by.history_t):
                raise ValueError(f"{len(known.t)} times; allowed: the {len(scored_by.history_t)} of the criteria")
    for row, task in db.execute("SELECT min(rowid), task FROM runs GROUP BY task"):
        if task not in scored:
            raise _wrong("runs", row, "task", f"is {task!r}, for which the table tasks has no criteria")
