"""Tables and columns of the results file, and the steps that bring an older file up to date."""

from __future__ import annotations

from sins_env.evaluation.play.criteria import AXES, COMPONENTS, NEES_AT

SCHEMA_VERSION = 4
KEY = ("task", "suite", "solver", "settings_hash", "code", "run")

VECTORS = ("t_conv", "hold_max", "steady_mean", "steady_std", "steady_rms", "final")
SCALARS = ("heading", "step_s")
_TEXTS = ("status", "reason", "traceback")
_COUNTS = ("repairs", "fallbacks")
#: Of a table, which is several times faster than all.
SHOWN = ("t_conv", "steady_rms", "final_u", "heading", "nees")
_VECTOR_COLUMNS = [f"{name}_{axis.lower()}" for name in VECTORS for axis in AXES]
NEES_COLUMNS = [f"nees_{round(100 * part)}" for part in NEES_AT]
SCORES = [*_VECTOR_COLUMNS, *SCALARS, *NEES_COLUMNS]
COLUMNS = [*KEY, "settings", "session", *_TEXTS, *_COUNTS, *SCORES]
SPAN_COLUMNS = [f"{kind}_{name}" for kind in ("rms", "final") for name in COMPONENTS]
SPAN_COLUMNS += [f"nees_all_{round(100 * part)}" for part in NEES_AT]

#: Rows that have more to tell than scores.
TROUBLE = "status <> 'ok' OR reason <> '' OR repairs <> 0 OR fallbacks <> 0"

_RUNS = f"""CREATE TABLE runs (
    id INTEGER PRIMARY KEY, task TEXT, suite TEXT, solver TEXT, settings_hash TEXT, code TEXT, run INTEGER,
    settings TEXT, session INTEGER REFERENCES sessions (id), status TEXT, reason TEXT, traceback TEXT,
    repairs INTEGER, fallbacks INTEGER DEFAULT 0,
    {", ".join(f"{name} REAL" for name in SCORES)}, UNIQUE ({", ".join(KEY)}))"""
#: Apart from the scores, so that a table reads those alone.
_HISTORIES = "CREATE TABLE histories (id INTEGER PRIMARY KEY REFERENCES runs (id), history BLOB)"

_TROUBLES = f"CREATE INDEX troubles ON runs ({', '.join(KEY)}) WHERE {TROUBLE}"
#: Of runs of navigation tasks: rad, m/s, m.
_SPANS = f"""CREATE TABLE spans (id INTEGER PRIMARY KEY REFERENCES runs (id),
    {", ".join(f"{name} REAL" for name in SPAN_COLUMNS)})"""

#: rad, and s from the start of fine alignment; t_conv is Inf where censored; NULL is not known.
SCHEMA = (
    """CREATE TABLE sessions (
        id INTEGER PRIMARY KEY, started TEXT DEFAULT CURRENT_TIMESTAMP, versions TEXT, machine TEXT)""",
    _RUNS,
    _HISTORIES,
    _SPANS,
    _TROUBLES,
    "CREATE TABLE tasks (task TEXT PRIMARY KEY, criteria TEXT, definition TEXT, digest TEXT, bound TEXT)",
    """CREATE TABLE costs (
        task TEXT, solver TEXT, settings_hash TEXT, code TEXT, session INTEGER, median_us REAL, p95_us REAL,
        ratio REAL, PRIMARY KEY (task, solver, settings_hash, code))""",
)
#: From each older schema to the next.
MIGRATIONS = {
    1: ("ALTER TABLE runs ADD COLUMN fallbacks INTEGER DEFAULT 0",),
    2: (
        "ALTER TABLE runs RENAME TO old_runs",
        _RUNS,
        _HISTORIES,
        f"INSERT INTO runs (id, {', '.join(COLUMNS)}) SELECT rowid, {', '.join(COLUMNS)} FROM old_runs",
        "INSERT INTO histories SELECT rowid, history FROM old_runs",
        "DROP TABLE old_runs",
        *(f"ALTER TABLE tasks ADD COLUMN {name} TEXT" for name in ("definition", "digest", "bound")),
    ),
    3: (_SPANS, _TROUBLES),
}
