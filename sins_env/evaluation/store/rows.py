"""Conversion of runs, criteria, definitions and bounds to values of the results file, and back."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.fields import Field
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.schema import SCORES, SPANS, TOLD
from sins_env.evaluation.tasks.task import EvaluationTask


def criteria_json(criteria: Criteria) -> str:
    """Return criteria as JSON."""
    return json.dumps({n: v.tolist() if isinstance(v, np.ndarray) else v for n, v in vars(criteria).items()})


def criteria_of(text: str) -> Criteria:
    """Return criteria from their JSON; the inverse of :func:`criteria_json`."""
    given: dict[str, Any] = json.loads(text)
    fields: dict[str, Any] = {n: np.array(v) if isinstance(v, list) else v for n, v in given.items()}
    return Criteria(**fields)


def definition_json(task: EvaluationTask) -> str:
    """Return the definition of a task as JSON."""
    return json.dumps({f.name: getattr(task, f.name) for f in fields(task)} | {"kwargs": dict(task.kwargs)})


def definition_of(text: str) -> EvaluationTask:
    """Return the task of a definition; fields that the present code does not have are left out."""
    given: dict[str, Any] = json.loads(text)
    return EvaluationTask(**{f.name: given[f.name] for f in fields(EvaluationTask) if f.name in given})


def binding(text: str) -> dict[str, Any]:
    """Return the part of a definition that may not change within a version: all fields but the descriptions."""
    return {name: value for name, value in vars(definition_of(text)).items() if name not in ("what", "source")}


def bound_json(bound: Bound | None) -> str:
    """Return a bound as JSON; null if there is none."""
    return json.dumps(bound and {name: value.tolist() for name, value in vars(bound).items()})


def bound_of(text: str) -> Bound | None:
    """Return a bound from its JSON; the inverse of :func:`bound_json`."""
    given = json.loads(text)
    return given and Bound(**{name: np.array(value) for name, value in given.items()})


def to_row(key: Key, session: int, run: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the values of RUN_COLUMNS for a run, as :meth:`Records.row` gives it."""
    told = [int(run[one.name]) if one.kind == "count" else str(run[one.name]) for one in TOLD]
    return (*key.values, int(run["run"]), key.settings, session, *told, *_numbers(SCORES, run))


def to_span(row: int, run: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the id of the row and the values of SPAN_COLUMNS for a run of a navigation task."""
    return (row, *_numbers(SPANS, run))


def _numbers(fields: Sequence[Field], run: Mapping[str, Any]) -> list[float]:
    """Return every part of these fields; SQLite keeps NaN as NULL."""
    return [value for one in fields for value in np.atleast_1d(run[one.name]).tolist()]


def to_blob(history: Any) -> bytes:
    """Return a history as compressed little-endian float32."""
    return zlib.compress(np.ascontiguousarray(history, dtype="<f4").tobytes())


def scores_of(whole: bool) -> list[Field]:
    """Return the fields of SCORES to read: all, or only those that tables show."""
    return [one for one in SCORES if whole or one.in_tables]


def to_records(
    run: Sequence[int],
    odd: Mapping[int, Sequence[Any]],
    numbers: Mapping[str, Array],
    criteria: Criteria,
    blobs: Sequence[bytes] | None,
) -> Records:
    """Return the records of stored runs; the inverse of :func:`to_row`, :func:`to_span` and :func:`to_blob`.

    Args:
        run: numbers of the runs.
        odd: values of TOLD by run, for the runs in TROUBLE.
        numbers: fields by name, as :func:`parted` gives them; scores that were not read are NaN.
        criteria: criteria of the task.
        blobs: histories; None gives histories of length 0.

    Raises:
        ValueError, zlib.error: a damaged row.
    """  # fmt: skip
    usual = tuple(one.usual for one in TOLD)
    told = [odd.get(one, usual) for one in run] if odd else [usual] * len(run)
    fields: dict[str, Any] = {one.name: one.of_runs([row[i] for row in told]) for i, one in enumerate(TOLD)}
    if blobs is None:
        fields["history"] = np.empty((len(run), 0, criteria.components), dtype=np.float32)
    else:
        parts = [np.frombuffer(zlib.decompress(blob), dtype="<f4") for blob in blobs]
        shape = len(parts), len(criteria.history_t), criteria.components
        fields["history"] = np.stack(parts).astype(np.float32).reshape(shape)
    fields |= {one.name: one.unknown(len(run)) for one in SCORES}
    fields |= {one.name: one.absent(len(run)) for one in SPANS}
    return Records(criteria, **fields | dict(numbers) | {"run": np.array(run, dtype=np.int64)})


def parted(values: Array, fields: Sequence[Field]) -> dict[str, Array]:
    """Return columns (R, c) as fields by name: (R, parts) each, or (R,) for a field without parts."""
    ends = np.cumsum([one.width for one in fields])
    return {
        one.name: np.ascontiguousarray(values[:, end - one.width : end]) if one.parts else values[:, end - 1]
        for one, end in zip(fields, ends, strict=True)
    }
