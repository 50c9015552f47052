"""The verb ``describe`` for scenarios: every key as a table, and a task as a file to copy."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from sins_env import checks
from sins_env.cli.describe import layout
from sins_env.evaluation.tasks.catalogue import file_of, get_task, load
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.reading.documents import MOST_BYTES, YAML_ENDINGS
from sins_env.reading.files import beginning
from sins_env.scenarios.key import TASK, Key
from sins_env.scenarios.motions import KINDS, MotionKind
from sins_env.scenarios.table import every_key, keys_of
from sins_env.worlds.profiles import is_flight

_MISSING = object()


def is_scenario_file(name: str) -> bool:
    """Return whether this is a file that describes a scenario, and neither a flight nor the mapping of a recording.

    Raises:
        ValueError: a YAML file that is none, or beyond the limits.
    """
    path = Path(name)
    if path.suffix.lower() in YAML_ENDINGS:
        return path.is_file() and not is_flight(name)
    return path.suffix.lower() == ".json" and path.is_file() and b'"motion"' in beginning(path, MOST_BYTES)


def describe_keys(console: Console) -> None:
    """Print every key of a scenario, with what is allowed and its default."""
    kinds = layout.table("kinds of motion", "motion.kind", "what")
    for kind in KINDS.values():
        kinds.add_row(kind.name, escape(kind.what))
    console.print(kinds)
    table = layout.table("keys of a scenario; each has a default", "key", "what; allowed", "default")
    for path, what, allowed, default in key_rows():
        table.add_row(path, escape(f"{what}; {allowed}"), escape(default))
    console.print(table)


def key_rows() -> list[tuple[str, str, str, str]]:
    """Return a row for every key: path, meaning with unit and kinds of motion, what is allowed, and default."""
    rows = []
    for path, (key, kinds) in every_key().items():
        unit = f", {key.unit}" if key.unit else ""
        only = f" ({', '.join(kind.name for kind in kinds)})" if len(kinds) < len(KINDS) else ""
        default = "" if key.to.startswith(TASK) else _defaults(key, kinds)
        rows.append((path, f"{key.what}{unit}{only}", key.allowed, default))
    return rows


def _defaults(key: Key, kinds: Sequence[MotionKind]) -> str:
    """Return the default of a key in words, with the kinds of motion where it is not the same in all."""
    named: dict[str, list[str]] = {}
    for kind in kinds:
        value = kind.default(key)
        named.setdefault("" if value is None or value == () else str(value), []).append(kind.name)
    if len(named) == 1:
        return next(iter(named))
    return "; ".join(f"{value} ({', '.join(names)})" for value, names in named.items() if value)


def as_yaml(name: str) -> str:
    """Return the text of the file of a task, without its digest, which a copy with changes does not have.

    A task that has no file, because Python or a package has made it, is written as the file that it could have.

    Raises:
        ValueError: an unknown name, or a task with settings that no file can hold.
    """
    path = Path(name) if is_scenario_file(name) else file_of(name)
    if path is not None:
        lines = path.read_text("utf-8").splitlines(keepends=True)
        return "".join(line for line in lines if not line.startswith("digest:"))
    import yaml  # slow to import

    scenario = scenario_of(get_task(name))
    return str(yaml.safe_dump(scenario, sort_keys=False, allow_unicode=True, default_flow_style=None, width=120))


def scenario_of(task: EvaluationTask) -> dict[str, Any]:
    """Return the scenario that makes a task, as a dict: the way back from settings to keys.

    Raises:
        ValueError: a task with settings that no key has.
    """
    wanted = _plain(task)
    for kind in (kind for kind in KINDS.values() if kind.env_id == task.env_id):
        scenario: dict[str, Any] = {}
        for path, value in _values_of(task, kind):
            *around, last = path.split(".")
            at = scenario
            for part in around:
                at = at.setdefault(part, {})
            at[last] = value
        with suppress(ValueError, FileNotFoundError):
            if _plain(load(scenario)) == wanted:
                return scenario
    raise ValueError(
        f"{task.name}: settings that no key of a scenario has; allowed: those of sins-env describe scenario"
    )


def _values_of(task: EvaluationTask, kind: MotionKind) -> Iterator[tuple[str, Any]]:
    """Yield the keys of a task that has this kind of motion, with their values."""
    defaults = {
        field.name: field.default for field in fields(task) if field.name != "hold_s"
    }  # which depends on the run
    known = keys_of(kind)
    inner = {
        around for key in known.values() if (around := kind.target(key).rpartition(".")[0])
    }  # dicts with keys of their own
    for path, key in known.items():
        to = kind.target(key)
        if path == "motion.kind":
            yield path, kind.name
        elif to.startswith(TASK):
            value = getattr(task, to.removeprefix(TASK), None)  # the digest is none of a task
            if value not in (None, defaults.get(to.removeprefix(TASK))):
                yield path, _plain(value)
        else:
            at: Any = task.kwargs
            for part in to.split("."):
                at = at.get(part, _MISSING) if isinstance(at, Mapping) else _MISSING
            if at is not _MISSING and not (to in inner and isinstance(at, Mapping)):
                words = [word for word, meant in key.words.items() if meant == at]
                yield path, words[0] if words else _plain(at)


def _plain(value: Any) -> Any:
    """Return a value in the types of YAML."""
    if is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, os.PathLike):
        return str(value)
    parts = checks.items(value)
    if parts is not None:
        return [_plain(one) for one in parts]
    return value.item() if isinstance(value, np.generic) else value
