"""Verbs of speed: bench measures the whole chain and its parts, warm compiles the kernels beforehand."""

from __future__ import annotations

import importlib.metadata
import json
import platform
from argparse import Namespace
from collections.abc import Sequence
from typing import Any

from rich.console import Console

from sins_env.cli.failing import failing
from sins_env.cli.output import remark
from sins_env.evaluation.estimators import isolation, offers
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.show.rich_tables import titled
from sins_env.evaluation.speed import bench as speed
from sins_env.kernels.compiling import Kernel, cache_folder
from sins_env.kernels.warming import compile_all, import_kernels


def bench(given: Namespace, console: Console) -> int:
    """Print the speed of a solver on a task, in CPU time on one thread.

    Raises:
        RunFailed: the estimator failed.
    """
    apart = isolation.limits(given.solver, given.timeout) is not None
    with (
        failing(f"{given.solver} on {given.task}"),
        isolation.hosted(given.solver, {}, given.timeout) as host,
        Bar(f"bench of {given.solver}") as bar,
    ):
        batches, remarks = speed.fitting(host, given.task, given.runs)
        speeds = speed.measure(host, given.task, batches, progress=bar.update)
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


def warm(given: Namespace, console: Console) -> int:
    """Compile every kernel of this project that is not in the cache, and say where the cache is and how long it took."""
    packages = {"sins_env", *(offers.package_of(point) for point in offers.points()[0])}
    kernels = import_kernels(sorted(packages))
    waiting = [one for one in kernels if one.cold]

    def show(done: int, total: int, one: Kernel) -> None:
        remark(f"{done + 1} of {total}: {one.__module__}.{one.__qualname__}")

    seconds = compile_all(waiting, show)
    where = f"{len(kernels)} kernels in {cache_folder()}"
    console.print(
        f"{where}, {len(waiting)} of them compiled in {seconds:.1f} s of CPU time", soft_wrap=True, highlight=False
    )
    return 0
