"""The verb ``list``: all names on one screen, or the names of one kind with a description of each."""

from __future__ import annotations

import inspect
from argparse import Namespace
from collections.abc import Callable, Iterable
from importlib.metadata import EntryPoint
from typing import Any, NamedTuple

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sins_env.checks import choice
from sins_env.cli.describe import layout
from sins_env.envs import ENV_IDS, PLAYING
from sins_env.envs.environments import ENVIRONMENTS
from sins_env.evaluation import reproduction
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.tasks.catalogue import TASKS
from sins_env.sensors import aids
from sins_env.specs import GPS_PRESETS, IMU_PRESETS
from sins_env.worlds.profiles import PROFILES

SOURCES = "Sources: 000 is Wang Junhou's thesis (2011); 001, 002 and 003 are the papers of the flights sun2012, zhao2010 and lu."
HINT = """
sins-env list KIND     what each of a kind is
sins-env describe NAME all about one; of a table, sins-env reproduce NUMBER"""
NO_SOLVERS = "none installed: pip install . in the project's directory, or use module:Factory"


Rows = Iterable[tuple[str, ...]]


def environments() -> dict[str, type[Any]]:
    """Return every environment by its id, in its single form."""
    playing = {env_id: EntryPoint("", single, "").load() for env_id, (single, _) in PLAYING.items()}
    return {env_id: vector.single for env_id, vector in ENVIRONMENTS.items()} | playing


def _environments() -> Rows:
    return ((env_id, layout.summary(cls.__doc__)) for env_id, cls in environments().items())


def _tasks() -> Rows:
    for task in TASKS.values():
        yield task.name, task.what, f'{task.delta_azimuth_deg:g} deg, {task.delta_level_arcsec:g}"'


def _solvers() -> Rows:
    """Yield the description of each solver, or the error of one that cannot be loaded, which must not end the list."""
    for one in finding.listing():
        yield one.name, (one.error or layout.summary(one.about.text)) + (f" [{one.package}]" if one.package else "")


def _flights() -> Rows:
    return ((name, profile.what) for name, profile in PROFILES.items())


def _published() -> Rows:
    return ((number, f"{table.title} ({table.source})") for number, table in reproduction.TABLES.items())


def _presets() -> Rows:
    for name in dict.fromkeys([*IMU_PRESETS, *GPS_PRESETS]):
        sensors = (sensor for sensor, there in (("IMU", IMU_PRESETS), ("GPS", GPS_PRESETS)) if name in there)
        yield name, " and ".join(sensors)


def _aids() -> Rows:
    for name, sensor in aids.known().items():
        yield name, layout.summary(inspect.getmodule(sensor).__doc__), ", ".join(sensor.specification.presets)


class Kind(NamedTuple):
    """Kind of things that ``list`` can list."""

    names: Callable[[], Iterable[str]]
    columns: tuple[str, ...]
    rows: Callable[[], Rows]  #: each name with the cells beside it
    cites: bool = True  #: whether the descriptions cite the source documents


KINDS = {
    "environments": Kind(lambda: (*ENV_IDS, *PLAYING), ("id", "what"), _environments),
    "tasks": Kind(lambda: TASKS, ("name", "what", "aligned within"), _tasks),
    "solvers": Kind(finding.names, ("name", "what"), _solvers),
    "flights": Kind(lambda: PROFILES, ("name", "what"), _flights),
    "tables": Kind(lambda: reproduction.TABLES, ("number", "what is printed"), _published),
    "aids": Kind(aids.known, ("name", "what", "presets"), _aids, cites=False),
    "presets": Kind(lambda: dict.fromkeys([*IMU_PRESETS, *GPS_PRESETS]), ("name", "sensor"), _presets, cites=False),
}


def list_kinds(given: Namespace, console: Console) -> int:
    """Print one kind, or the names of all kinds, and return the exit code."""
    if given.kind is None:
        console.print(_all_names())
        console.print(HINT, highlight=False)
    else:
        kind = choice("kind", given.kind, KINDS)
        console.print(_one_kind(kind))
        if KINDS[kind].cites:
            console.print(SOURCES, highlight=False)
    return 0


def _all_names() -> Table:
    """Return a table with a row per kind: the number of names, and the names."""
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True, style="bold")
    table.add_column(no_wrap=True, justify="right")
    table.add_column(overflow="fold")
    for kind, one in KINDS.items():
        names = list(one.names())
        table.add_row(kind, str(len(names)), escape(", ".join(names)) or NO_SOLVERS)
    return table


def _one_kind(kind: str) -> Table:
    one = KINDS[kind]
    table = layout.table(kind, *one.columns)
    for row in one.rows():
        table.add_row(*map(escape, row))
    if kind == "solvers":
        _add_to_solvers(table)
    return table


def _add_to_solvers(table: Table) -> None:
    """Add a row if no solver is installed, and a caption with the solvers that are hidden by others of the same name."""
    if not table.row_count:
        table.add_row("-", NO_SOLVERS)
    if hidden := finding.shadowed():
        table.caption = f"not shown, for their names are taken: {', '.join(map(escape, hidden))}; use module:Factory"
        table.caption_justify = "left"
