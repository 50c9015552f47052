"""What right-invariant coordinates in closed loop gain a filter over what it has by default.

    python benchmarks/coordinates.py                                    every filter but those of particles, on two tasks
    python benchmarks/coordinates.py ckf imm_ekf --task sway-markov-v0  some filters on one task

The ratio is that of the azimuth's RMS in the steady state, in the same runs, with its 95 % interval by sign flips. For it, errors
are capped at the threshold of alignment.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from sins_env.evaluation import evaluate
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.score import exact, losses
from sins_env.evaluation.score.quantities import run_errors
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.units import ARCSEC, DEG
from solvers.filters import names

TASKS = ("sway-white-v0", "sway-markov-v0")
#: Filters that are left out: those of particles, which only cost more, filterpy's, and those that have these coordinates.
LEFT_OUT = ("pf", "gpf", "rqmc_gpf", "cgpf", "ugpf", "upf", "hepf", "filterpy", "inekf", "eqf")
INVARIANT = {"coordinates": "invariant", "feedback": "closed"}


def found(name: str, task: str, runs: int, seed: int, bar: Bar) -> dict[str, Any]:
    """Play a filter in both coordinates."""
    cap = get_task(task).delta_azimuth_deg * DEG
    errors = []
    for settings in ({}, INVARIANT):
        results = evaluate(
            task, name, runs, seed, settings=settings, cost=False, workers=1,
            progress=lambda done, total: bar.update(done, total),
        )  # fmt: skip
        errors.append(run_errors(results.records, "azimuth")[0])
    ratio, (low, high) = exact.ratio_by_flips(*(losses.capped(e, cap) for e in reversed(errors)))
    rms = [math.sqrt(float((e * e).mean())) / ARCSEC for e in errors]
    return {"filter": name, "task": task, "runs": runs, "seed": seed, "rms": rms, "ratio": [ratio, low, high]}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="what invariant coordinates in closed loop gain a filter")
    parser.add_argument("filters", nargs="*", metavar="filter", help="default all but those of particles")
    parser.add_argument("--task", nargs="+", default=TASKS, help="default %(default)s")
    parser.add_argument("--runs", type=int, default=40, help="default %(default)s")
    parser.add_argument("--seed", type=int, default=1919, help="seed of the suite (default %(default)s)")
    parser.add_argument("--json", metavar="FILE", help="also write what was found, a filter a line")
    given = parser.parse_args(arguments)
    table = Table(title=f"azimuth RMS, arcsec, default and invariant; {given.runs} runs, seed {given.seed}")
    for heading in ("filter", "task", "default", "invariant", "ratio"):
        table.add_column(heading, justify="left" if heading in ("filter", "task") else "right")
    for name in given.filters or [name for name in names() if not name.startswith(LEFT_OUT)]:
        for task in given.task:
            with Bar(f"{name}, {task}") as bar:
                row = found(name, task, given.runs, given.seed, bar)
            rms, (ratio, low, high) = row["rms"], row["ratio"]
            table.add_row(name, task, *(f"{one:,.0f}" for one in rms), f"{ratio:.3f} [{low:.3f}, {high:.3f}]")
            if given.json:
                with open(given.json, "a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
