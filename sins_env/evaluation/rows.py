"""The schema of the results file, and runs as rows of it."""

from __future__ import annotations

import hashlib
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.evaluation.bounds import Bound
from sins_env.evaluation.criteria import AXES, COMPONENTS, NEES_AT, Criteria
from sins_env.evaluation.records import Records
from sins_env.evaluation.tasks import EvaluationTask

Array = NDArray[np.float64]

SCHEMA_VERSION = 4
KEY = ("task", "suite", "solver", "settings_hash", "code", "run")

_VECTORS = ("t_conv", "hold_max", "steady_mean", "steady_std", "steady_rms", "final")
_SCALARS = ("heading", "step_s")
_TEXTS = ("status", "reason", "traceback")
_COUNTS = ("repairs", "fallbacks")
#: Of a table, which is several times faster than all.
_SHOWN = ("t_conv", "steady_rms", "final_u", "heading", "nees")
_VECTOR_COLUMNS = [f"{name}_{axis.lower()}" for name in _VECTORS for axis in AXES]
_NEES_COLUMNS = [f"nees_{round(100 * part)}" for part in NEES_AT]
_SCORES = [*_VECTOR_COLUMNS, *_SCALARS, *_NEES_COLUMNS]
COLUMNS = [*KEY, "settings", "session", *_TEXTS, *_COUNTS, *_SCORES]
SPAN_COLUMNS = [f"{kind}_{name}" for kind in ("rms", "final") for name in COMPONENTS]
SPAN_COLUMNS += [f"nees_all_{round(100 * part)}" for part in NEES_AT]
#: Rows that have more to tell than scores.
TROUBLE = "status <> 'ok' OR reason <> '' OR repairs <> 0 OR fallbacks <> 0"

_RUNS = f"""CREATE TABLE runs (
    id INTEGER PRIMARY KEY, task TEXT, suite TEXT, solver TEXT, settings_hash TEXT, code TEXT, run INTEGER,
    settings TEXT, session INTEGER REFERENCES sessions (id), status TEXT, reason TEXT, traceback TEXT,
    repairs INTEGER, fallbacks INTEGER DEFAULT 0,
    {", ".join(f"{name} REAL" for name in _SCORES)}, UNIQUE ({", ".join(KEY)}))"""
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

    def among(self, tasks: Sequence[str], solvers: Sequence[str]) -> bool:
        """Whether it is of one of these tasks and solvers; none named: of any."""
        return (not tasks or self.task in tasks) and (not solvers or self.solver in solvers)

    @property
    def settings_hash(self) -> str:
        return hashlib.sha256(self.settings.encode()).hexdigest()[:12]

    @property
    def values(self) -> tuple[str, ...]:
        """In the order of KEY, without the run."""
        return self.task, self.suite, self.solver, self.settings_hash, self.code


def canonical(settings: Mapping[str, Any]) -> str:
    """Settings as JSON with sorted keys.

    Raises:
        ValueError: a value that JSON does not have.
    """
    try:
        return json.dumps(dict(settings), sort_keys=True)
    except TypeError as error:
        given = dict(settings)
        raise ValueError(f"settings {given!r}; allowed in a results file: numbers, text, lists") from error


def criteria_text(criteria: Criteria) -> str:
    return json.dumps({n: v.tolist() if isinstance(v, np.ndarray) else v for n, v in vars(criteria).items()})


def criteria_of(text: str) -> Criteria:
    given: dict[str, Any] = json.loads(text)
    fields: dict[str, Any] = {n: np.array(v) if isinstance(v, list) else v for n, v in given.items()}
    return Criteria(**fields)


def definition_text(task: EvaluationTask) -> str:
    return json.dumps({f.name: getattr(task, f.name) for f in fields(task)} | {"kwargs": dict(task.kwargs)})


def definition_of(text: str) -> EvaluationTask:
    """What the present code does not know of is left out."""
    given: dict[str, Any] = json.loads(text)
    return EvaluationTask(**{f.name: given[f.name] for f in fields(EvaluationTask) if f.name in given})


def binding(text: str) -> dict[str, Any]:
    """The part of a definition that makes a version: all but the words."""
    return {name: value for name, value in vars(definition_of(text)).items() if name not in ("what", "source")}


def bound_text(bound: Bound | None) -> str:
    return json.dumps(bound and {name: value.tolist() for name, value in vars(bound).items()})


def bound_of(text: str) -> Bound | None:
    given = json.loads(text)
    return given and Bound(**{name: np.array(value) for name, value in given.items()})


def to_row(key: Key, session: int, run: Mapping[str, Any]) -> tuple[Any, ...]:
    """The fields of :meth:`Records.row` in the order of COLUMNS."""
    numbers = [float(run[name][j]) for name in _VECTORS for j in range(3)]
    numbers += [float(run[name]) for name in _SCALARS] + [float(value) for value in run["nees"]]
    told = (str(run["status"]), run["reason"], run["traceback"], int(run["repairs"]), int(run["fallbacks"]))
    head = (*key.values, int(run["run"]), key.settings, session)
    return (*head, *told, *(None if math.isnan(n) else n for n in numbers))


def to_span(row: int, run: Mapping[str, Any]) -> tuple[Any, ...]:
    """Of a run of a navigation task, in the order of SPAN_COLUMNS after the row's id."""
    numbers = np.concatenate([run["span_rms"], run["span_final"], run["nees_all"]]).tolist()
    return (row, *(None if math.isnan(n) else n for n in numbers))


def to_blob(history: Any) -> bytes:
    return zlib.compress(np.ascontiguousarray(history, dtype="<f4").tobytes())


def numbers_of(whole: bool) -> list[str]:
    """The scores that are read after the run: all, or those that tables show."""
    return [*(_SCORES if whole else [name for name in _SCORES if name.startswith(_SHOWN)])]


def to_records(
    numbers: Array, odd: Mapping[int, Sequence[Any]], spans: Array, criteria: Criteria, blobs: Sequence[bytes] | None
) -> Records:
    """The inverse of :func:`to_row`, :func:`to_span` and :func:`to_blob`.

    Args:
        numbers: (R, 1 + c), the run and the columns of :func:`numbers_of`; scores that were not read are NaN.
        odd: status, reason, traceback, repairs and fallbacks by run, of those in TROUBLE.
        spans: (R, SPAN_COLUMNS), or (R, 0) where the task does not navigate.
        blobs: histories; without them they have length 0.

    Raises:
        ValueError, zlib.error: a damaged row.
    """
    names = ["run", *numbers_of(numbers.shape[1] == 1 + len(numbers_of(True)))]
    columns = dict(zip(names, numbers.T, strict=True))
    unknown = np.full(len(numbers), np.nan)
    run = columns["run"].astype(np.int64)
    usual = ("ok", "", "", 0, 0)
    told = [odd.get(one, usual) for one in run.tolist()] if odd else [usual] * len(run)
    status, reason, traceback, repairs, fallbacks = zip(*told, strict=True) if told else ((),) * 5
    if blobs is None:
        history = np.empty((len(numbers), 0, criteria.components), dtype=np.float32)
    else:
        parts = [np.frombuffer(zlib.decompress(blob), dtype="<f4") for blob in blobs]
        shape = len(parts), len(criteria.history_t), criteria.components
        history = np.stack(parts).astype(np.float32).reshape(shape)
    width = criteria.components if criteria.navigates else 0
    scores: dict[str, Any] = {
        name: _stack(columns, [f"{name}_{axis.lower()}" for axis in AXES], unknown) for name in _VECTORS
    }
    scores |= {name: columns.get(name, unknown) for name in _SCALARS}
    return Records(
        criteria=criteria,
        run=run,
        status=np.array(status, dtype=np.str_),
        reason=reason,
        traceback=traceback,
        repairs=np.array(repairs, dtype=np.int64),
        fallbacks=np.array(fallbacks, dtype=np.int64),
        nees=_stack(columns, _NEES_COLUMNS, unknown),
        history=history,
        span_rms=spans[:, :width],
        span_final=spans[:, width : 2 * width],
        nees_all=spans[:, 2 * width :] if width else np.full((len(numbers), len(NEES_AT)), np.nan),
        **scores,
    )


def _stack(columns: Mapping[str, Array], names: Sequence[str], unknown: Array) -> Array:
    return np.stack([columns.get(name, unknown) for name in names], axis=1)
