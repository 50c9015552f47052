"""The schema of the results file, and runs as rows of it."""

from __future__ import annotations

import hashlib
import json
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sins_env.evaluation.scoring import AXES, NEES_AT, Criteria

SCHEMA_VERSION = 2
#: From each older schema to the next.
MIGRATIONS = {1: ("ALTER TABLE runs ADD COLUMN fallbacks INTEGER DEFAULT 0",)}
KEY = ("task", "suite", "solver", "settings_hash", "code", "run")

_VECTORS = ("t_conv", "hold_max", "steady_mean", "steady_std", "steady_rms", "final")
_SCALARS = ("heading", "step_s")
_TEXTS = ("run", "status", "reason", "traceback", "repairs", "fallbacks")
_VECTOR_COLUMNS = [f"{name}_{axis.lower()}" for name in _VECTORS for axis in AXES]
_NEES_COLUMNS = [f"nees_{round(100 * part)}" for part in NEES_AT]
_SCORES = [*_VECTOR_COLUMNS, *_SCALARS, *_NEES_COLUMNS]
COLUMNS = [*KEY, "settings", "session", *_TEXTS[1:], *_SCORES, "history"]

#: rad, and s from the start of fine alignment; t_conv is Inf where censored; NULL is not known.
SCHEMA = (
    """CREATE TABLE sessions (
        id INTEGER PRIMARY KEY, started TEXT DEFAULT CURRENT_TIMESTAMP, versions TEXT, machine TEXT)""",
    f"""CREATE TABLE runs (
        task TEXT, suite TEXT, solver TEXT, settings_hash TEXT, code TEXT, run INTEGER, settings TEXT,
        session INTEGER REFERENCES sessions (id), status TEXT, reason TEXT, traceback TEXT,
        repairs INTEGER, fallbacks INTEGER DEFAULT 0,
        {", ".join(f"{name} REAL" for name in _SCORES)}, history BLOB, PRIMARY KEY ({", ".join(KEY)}))""",
    "CREATE TABLE tasks (task TEXT PRIMARY KEY, criteria TEXT)",
    """CREATE TABLE costs (
        task TEXT, solver TEXT, settings_hash TEXT, code TEXT, session INTEGER, median_us REAL, p95_us REAL,
        ratio REAL, PRIMARY KEY (task, solver, settings_hash, code))""",
)


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


def to_row(key: Key, session: int, run: Mapping[str, Any]) -> tuple[Any, ...]:
    """The fields of :meth:`Records.row` in the order of COLUMNS."""
    numbers = [float(run[name][j]) for name in _VECTORS for j in range(3)]
    numbers += [float(run[name]) for name in _SCALARS] + [float(value) for value in run["nees"]]
    history = zlib.compress(np.ascontiguousarray(run["history"], dtype="<f4").tobytes())
    told = (str(run["status"]), run["reason"], run["traceback"], int(run["repairs"]), int(run["fallbacks"]))
    head = (*key.values, int(run["run"]), key.settings, session)
    return (*head, *told, *(None if math.isnan(n) else n for n in numbers), history)


def of_row(row: Mapping[str, Any], criteria: Criteria) -> dict[str, Any]:
    """The inverse of :func:`to_row`.

    Raises:
        TypeError, ValueError, zlib.error: a damaged row.
    """

    def number(name: str) -> float:
        return math.nan if row[name] is None else float(row[name])

    out: dict[str, Any] = {name: row[name] for name in _TEXTS}
    out |= {name: np.array([number(f"{name}_{axis.lower()}") for axis in AXES]) for name in _VECTORS}
    out |= {name: number(name) for name in _SCALARS}
    out["nees"] = np.array([number(name) for name in _NEES_COLUMNS])
    history = np.frombuffer(zlib.decompress(row["history"]), dtype="<f4").astype(np.float32)
    out["history"] = history.reshape(len(criteria.history_t), 3)
    return out
