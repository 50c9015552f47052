"""The verb ``describe`` for scenarios: every key as a table, and a task as a file to copy."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from sins_env.checks import unknown
from sins_env.cli.describe import layout
from sins_env.evaluation.tasks.catalogue import file_of, names
from sins_env.reading.documents import MOST_BYTES, YAML_ENDINGS
from sins_env.reading.files import beginning
from sins_env.scenarios.key import TASK, Key
from sins_env.scenarios.motions import KINDS, MotionKind
from sins_env.scenarios.table import every_key
from sins_env.worlds.profiles import is_flight


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

    Raises:
        ValueError: an unknown name, or a task that has no file.
    """
    path = Path(name) if is_scenario_file(name) else file_of(name)
    if path is None:
        raise unknown("task with a file", name, [one for one in names() if file_of(one)])
    lines = path.read_text("utf-8").splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith("digest:"))
