"""The schema of the results file, and runs as rows of it."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.criteria import AXES, NEES_AT, Criteria
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.schema import NEES_COLUMNS, SCALARS, SCORES, SHOWN, VECTORS
from sins_env.evaluation.tasks.task import EvaluationTask


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
    numbers = [float(run[name][j]) for name in VECTORS for j in range(3)]
    numbers += [float(run[name]) for name in SCALARS] + [float(value) for value in run["nees"]]
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
    return [*(SCORES if whole else [name for name in SCORES if name.startswith(SHOWN)])]


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
        name: _stack(columns, [f"{name}_{axis.lower()}" for axis in AXES], unknown) for name in VECTORS
    }
    scores |= {name: columns.get(name, unknown) for name in SCALARS}
    return Records(
        criteria=criteria,
        run=run,
        status=np.array(status, dtype=np.str_),
        reason=reason,
        traceback=traceback,
        repairs=np.array(repairs, dtype=np.int64),
        fallbacks=np.array(fallbacks, dtype=np.int64),
        nees=_stack(columns, NEES_COLUMNS, unknown),
        history=history,
        span_rms=spans[:, :width],
        span_final=spans[:, width : 2 * width],
        nees_all=spans[:, 2 * width :] if width else np.full((len(numbers), len(NEES_AT)), np.nan),
        **scores,
    )


def _stack(columns: Mapping[str, Array], names: Sequence[str], unknown: Array) -> Array:
    return np.stack([columns.get(name, unknown) for name in names], axis=1)
