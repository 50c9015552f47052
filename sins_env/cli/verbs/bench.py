"""The verb ``bench``: speed of the whole chain and of its parts."""

from __future__ import annotations

import importlib.metadata
import json
import platform
from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from rich.console import Console

from sins_env.cli.output import RunFailed, remark
from sins_env.evaluation.estimators import isolation
from sins_env.evaluation.estimators.guard import EstimatorError, Refusal
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.show.rich_tables import titled
from sins_env.evaluation.speed import bench as speed


def bench(given: Namespace, console: Console) -> int:
    """Print the speed of a solver on a task, in CPU time on one thread.

    Raises:
        RunFailed: the estimator failed.
    """
    apart = isolation.limits(given.solver, given.timeout) is not None
    try:
        with isolation.hosted(given.solver, {}, given.timeout) as host, Bar(f"bench of {given.solver}") as bar:
            batches, remarks = speed.fitting(host, given.task, given.runs)
            speeds = speed.measure(host, given.task, batches, progress=bar.update)
    except Refusal:
        raise
    except EstimatorError as error:
        raise RunFailed(f"{given.solver} on {given.task}: {error}") from error
    for text in remarks:
        remark(text)
    if given.json:
        print(json.dumps(_figures(given, speeds), indent=2))
        return 0
    table = titled(f"{given.solver} on {given.task}")
    table.add_column("part")
    for name in ("runs", "x real time\nper core", "us per run\nand epoch"):
        table.add_column(name, justify="right")
    for i, one in enumerate(speeds):
        bold = "bold" if one.part == "whole chain" else ""
        cells = (one.part, str(one.runs), f"{one.real_time:,.0f}", f"{one.epoch_us:.2f}")
        table.add_row(*cells, style=bold, end_section=i % 3 == 2)
    table.caption, table.caption_justify = _measured(apart), "left"
    console.print(table)
    return 0


def _figures(given: Namespace, speeds: Sequence[speed.Speed]) -> dict[str, Any]:
    """Return the figures of the table, with what they were measured with."""
    versions = {name: importlib.metadata.version(name) for name in ("sins-env", "numpy", "numba")}
    return {
        "solver": given.solver,
        "task": given.task,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "versions": versions,
        "cpu_time": [one._asdict() for one in speeds],
    }


def _measured(apart: bool) -> str:
    """Return the caption, which tells what the times measure."""
    text = "CPU time, one thread, fine phase; median over blocks of epochs"
    return f"{text}; the estimator's in a process of its own, with the way there and back" if apart else text
