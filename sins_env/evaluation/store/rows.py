"""Conversion of runs, criteria, definitions and bounds to values of the results file, and back.

What is read back may come from a stranger's file: each value is checked, and none is imported, made or computed.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import flag, number, refused, unknown
from sins_env.envs.environments import ENVIRONMENTS
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.criteria import MAX_HISTORY, Criteria
from sins_env.evaluation.play.fields import Field
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.score.headline import FAILURES
from sins_env.evaluation.score.quantities import QUANTITIES
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.schema import SCORES, SPANS, TOLD
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.reading.documents import parse_json

MOST_TEXT = 4096  #: most bytes of a message or traceback; the rest is cut off
MOST_EPOCHS = 10**9  #: most epochs of a run
MOST_NUMBER = 1e50  #: largest finite number of a run: even the cube of its square is finite; a larger one is inf
_SIZES = f"of size {1 / MOST_NUMBER:.0e} to {MOST_NUMBER:.0e}"
LEAST_EPOCH_S = 1e-6  #: shortest epoch, s
T = TypeVar("T")


def object_of(text: str) -> dict[str, Any]:
    """Return a JSON object, bounded in depth and size.

    Raises:
        ValueError: anything else.
    """
    given = parse_json(text)
    if not isinstance(given, dict):
        raise ValueError(f"a JSON {type(given).__name__}; allowed: an object")
    return given


def versions_of(text: str) -> dict[str, str]:
    """Return the versions of a session by package, from their JSON."""
    return {name: _text(name, value) for name, value in object_of(text).items()}


def _text(name: str, given: Any) -> str:
    if not isinstance(given, str):
        raise refused(name, given, "text")
    return given


def _object(name: str, given: Any) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise refused(name, given, "an object")
    return given


def _whole(name: str, given: Any, least: int = 0, most: int | None = None) -> int:
    """Check a whole number of any size."""
    if type(given) is not int or given < least or (most is not None and given > most):
        raise refused(name, given, f"a whole number >= {least}" + (f" and <= {most}" if most is not None else ""))
    return given


def _finite(name: str, given: Any) -> Array:
    """Return nested lists of numbers as an array; each is 0, or its size is from 1 / MOST_NUMBER to MOST_NUMBER."""
    found = np.array(given, dtype=object) if isinstance(given, list) else np.array(None)
    kinds = set(map(type, found.flat))
    try:
        out: Array = found.astype(np.int64 if kinds == {int} else float)
        small = (np.abs(out) < 1 / MOST_NUMBER) & (out != 0)
        usable = kinds <= {int, float} and bool((np.abs(out) <= MOST_NUMBER).all()) and not small.any()
    except (TypeError, ValueError, OverflowError):
        usable = False
    if not usable:
        raise ValueError(f"{name}; allowed: lists of finite numbers, all of one length, each 0 or {_SIZES}")
    return out


#: Check of a field of a dataclass in JSON, by its annotation: (name, given) -> value.
_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "bool": flag,
    "int": _whole,
    "float": lambda name, given: number(name, given, least=0.0, infinite=True),
    "float | None": lambda name, given: None if given is None else number(name, given, above=0.0),
    "str": _text,
    "Mapping[str, Any]": _object,
    "Array": _finite,
    "NDArray[np.int64]": _finite,
    "Mask": lambda name, given: np.array(flag(name, given)),
}


def _fields_of(cls: type[T], given: Mapping[str, Any]) -> T:
    """Make a dataclass from those of its fields that are given; each is checked by its type.

    Raises:
        ValueError: a field that is missing, or of another type.
    """
    known = [one for one in fields(cls) if one.name in given]  # type: ignore[arg-type]
    try:
        return cls(**{one.name: _CHECKS[str(one.type)](one.name, given[one.name]) for one in known})
    except TypeError as error:  # fields that are missing
        raise ValueError(str(error)) from None


def criteria_json(criteria: Criteria) -> str:
    """Return criteria as JSON."""
    return json.dumps({n: v.tolist() if isinstance(v, np.ndarray) else v for n, v in vars(criteria).items()})


def changed(before: T, now: T, tolerance: float) -> str:
    """Return the name of the first field of numbers that differs by more than a relative tolerance; empty if none does."""
    for name, held in vars(before).items():
        value = getattr(now, name)
        if np.shape(held) != np.shape(value) or not np.allclose(held, value, rtol=tolerance, atol=0.0):
            return name
    return ""


STORED_NOW = ("stored", "now")  #: words behind two values that are compared


def criteria_change(before: Criteria, now: Criteria, words: tuple[str, str] = STORED_NOW) -> str:
    """Return the first of the criteria that differs, with both values; empty if all are equal but for rounding."""
    name = changed(before, now, 1e-9)
    held, value = (getattr(one, name, None) for one in (before, now))
    held, value = (one.tolist() if isinstance(one, np.ndarray) else one for one in (held, value))
    return name and f"{name} = {held} {words[0]}, {value} {words[1]}"


def criteria_of(text: str) -> Criteria:
    """Return criteria from their JSON; the inverse of :func:`criteria_json`.

    Raises:
        ValueError: values that no task can have.
    """
    found = _fields_of(Criteria, object_of(text))
    number("epoch_s", found.epoch_s, least=LEAST_EPOCH_S)
    _whole("num_epochs", found.num_epochs, 1, MOST_EPOCHS)
    _whole("coarse_epochs", found.coarse_epochs, 0, found.num_epochs - 1)
    _whole("span_from", found.span_from, 1, found.num_epochs)
    number("hold_s", found.hold_s)
    if found.num_epochs // found.history_stride > MAX_HISTORY + 1:
        raise refused("epoch_s", found.epoch_s, f"a history of at most {MAX_HISTORY} samples")
    if found.delta.shape != (3,) or not (found.delta > 0).all():
        raise refused("delta", found.delta.tolist(), "three positive numbers")
    if found.limit.shape != ((9,) if found.navigates else (3,)):
        raise refused("limit", found.limit.tolist(), "nine numbers in navigation, else three")
    return found


def definition_json(task: EvaluationTask) -> str:
    """Return the definition of a task as JSON, without fields that have their default, so that a new one changes nothing."""
    given = {f.name: getattr(task, f.name) for f in fields(task) if getattr(task, f.name) != f.default}
    return json.dumps(given | {"kwargs": dict(task.kwargs)})


def definition_of(text: str) -> EvaluationTask:
    """Return the task of a definition; fields that the present code does not have are left out.

    Raises:
        ValueError: an environment that is not of this package, or values that no task can have.
    """
    found = _fields_of(EvaluationTask, object_of(text))
    if found.env_id not in ENVIRONMENTS:
        raise unknown("env_id", found.env_id, ENVIRONMENTS)
    if found.rank_by not in (*QUANTITIES, FAILURES):
        raise unknown("rank_by", found.rank_by, (*QUANTITIES, FAILURES))
    for name in ("delta_azimuth_deg", "delta_level_arcsec", "hold_s", "score_from_s"):
        number(name, getattr(found, name), least=0.0)
    headings = found.kwargs.get("heading_deg")
    if found.records and isinstance(headings, list):
        one_each = len(headings) == found.records
        if not one_each or not all(isinstance(one, (int, float)) for one in headings):
            raise refused("heading_deg", headings, f"a number for each of the {found.records} records")
    return found


def binding(text: str) -> dict[str, Any]:
    """Return the part of a definition that may not change within a version: all fields but the descriptions.

    Settings of the environment that have their default are left out.
    """
    task = definition_of(text)
    defaults = {one.name: one.default for one in fields(ENVIRONMENTS[task.env_id].single.settings)}
    kwargs = {name: value for name, value in task.kwargs.items() if name not in defaults or value != defaults[name]}
    return {n: v for n, v in vars(task).items() if n not in ("what", "source")} | {"kwargs": kwargs}


def bound_json(bound: Bound | None) -> str:
    """Return a bound as JSON; null if there is none."""
    return json.dumps(bound and {name: value.tolist() for name, value in vars(bound).items()})


def bound_of(text: str) -> Bound | None:
    """Return a bound from its JSON; the inverse of :func:`bound_json`.

    Raises:
        ValueError: arrays that do not fit each other.
    """
    try:
        given = json.loads(text)  # of more numbers than other documents
    except RecursionError:
        raise ValueError("nested too deep; allowed: lists in lists") from None
    if given is None:
        return None
    found = _fields_of(Bound, _object("bound", given))
    width = found.steady.shape
    shapes = {"t": (len(found.t),), "sigma": (len(found.t), *width), "final": width, "epochs": (2,)}
    if width not in ((3,), (9,)) or any(getattr(found, name).shape != shape for name, shape in shapes.items()):
        raise ValueError("arrays of other shapes; allowed: those of a bound")
    return found


def to_row(key: Key, session: int, run: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the values of RUN_COLUMNS for a run, as :meth:`Records.row` gives it."""
    told = [int(run[one.name]) if one.kind == "count" else cut(str(run[one.name])) for one in TOLD]
    return (*key.values, int(run["run"]), key.settings, session, *told, *_numbers(SCORES, run))


def cut(text: str) -> str:
    """Return the first MOST_TEXT bytes of a text, which may come from a solver; what UTF-8 does not have is escaped."""
    return text[:MOST_TEXT].encode("utf-8", "backslashreplace")[:MOST_TEXT].decode("utf-8", "ignore")


def to_span(run: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the values of SPAN_COLUMNS for a run of a navigation task."""
    return tuple(_numbers(SPANS, run))


def _numbers(fields: Sequence[Field], run: Mapping[str, Any]) -> list[float]:
    """Return every part of these fields; SQLite keeps NaN as NULL, and what is larger than MOST_NUMBER is inf."""
    values = np.concatenate([np.atleast_1d(run[one.name]) for one in fields])
    found: list[float] = np.where(np.abs(values) > MOST_NUMBER, np.copysign(np.inf, values), values).tolist()
    return found


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
        parts = [history_of(blob, criteria, number) for number, blob in zip(run, blobs, strict=True)]
        fields["history"] = np.stack(parts).astype(np.float32)
    fields |= {one.name: one.unknown(len(run)) for one in SCORES}
    fields |= {one.name: one.absent(len(run)) for one in SPANS}
    return Records(criteria, **fields | dict(numbers) | {"run": np.array(run, dtype=np.int64)})


def history_of(blob: Any, criteria: Criteria, run: int) -> Array:
    """Return a history (S, components) from its blob, of which no more is inflated than the criteria say.

    Raises:
        ValueError: another size, or no such blob.
    """
    shape = len(criteria.history_t), criteria.components
    wanted = 4 * math.prod(shape)
    try:
        found = zlib.decompressobj().decompress(blob, wanted + 1)
    except (zlib.error, TypeError) as error:
        raise ValueError(f"the history of run {run} is damaged: {error}") from None
    if len(found) != wanted:
        size = f"more than {wanted}" if len(found) > wanted else f"{len(found)}"
        raise ValueError(f"the history of run {run} has {size} bytes; allowed: {wanted}")
    return np.frombuffer(found, dtype="<f4").reshape(shape)


def parted(values: Array, fields: Sequence[Field]) -> dict[str, Array]:
    """Return columns (R, c) as fields by name: (R, parts) each, or (R,) for a field without parts."""
    ends = np.cumsum([one.width for one in fields])
    return {
        one.name: np.ascontiguousarray(values[:, end - one.width : end]) if one.parts else values[:, end - 1]
        for one, end in zip(fields, ends, strict=True)
    }
