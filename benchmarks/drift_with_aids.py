"""Figure of docs/mathematics/aiding.md: how far a car and a ship drift without GPS, with each aid and without any.

    python benchmarks/drift_with_aids.py                 # docs/drift_with_aids.svg, by the bound and 20 runs of ekf
    python benchmarks/drift_with_aids.py --runs 50 --solver inekf

The runs of all lines have the same motion, IMU and fixes. A table of the errors at the end of the outage is printed.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.lines import Line2D
from rich.console import Console
from rich.table import Table

from sins_env.arrays import Array
from sins_env.evaluation import evaluate, get_task
from sins_env.evaluation.bound import bounds
from sins_env.evaluation.play.criteria import COMPONENTS
from sins_env.evaluation.show.style import COLOURS, finish, new_figure
from sins_env.evaluation.tasks.task import EvaluationTask

AWAY: list[list[float]] = [[0.0, 1e6]]
HORIZONTAL = [COMPONENTS.index(name) for name in ("pos_e", "pos_n")]
VERTICAL = [COMPONENTS.index("pos_u")]
#: Six satellites without fixes, of which three are left in the outage.
THREE = {
    "gps": {"outages_s": AWAY},
    "aids": {"ranges": {"rate_hz": 1.0, "few_s": [[100.0, 220.0]]}},
}


class Case(NamedTuple):
    """A vehicle of a task, the times of its outage in s, and by its label what changes the settings of the task."""

    task: str
    begin: float
    end: float
    lines: Mapping[str, Mapping[str, Any]]


CASES = {
    "car": Case(
        "car-odometer-v0",
        100.0,
        220.0,
        {
            "nothing": {"aids": {}},
            "heading": {"aids": {"heading": "novatel-1m"}},
            "barometer": {"aids": {"height": "bmp388"}},
            "odometer": {"aids": {"odometer": {"nhc": False}}},
            "odometer and constraint": {"aids": {"odometer": {}}},
            "ranges, three satellites": THREE,
        },
    ),
    "ship": Case(
        "ship-dvl-v0",
        60.0,
        180.0,
        {
            "nothing": {"aids": {}},
            "log, water": {"aids": {"dvl": "water"}},
            "log, bottom": {"aids": {"dvl": "bottom"}},
        },
    ),
}
PANELS = (
    ("car", "car, horizontal", HORIZONTAL),
    ("car", "car, vertical", VERTICAL),
    ("ship", "ship, horizontal", HORIZONTAL),
)


class Drift(NamedTuple):
    """Mean squared errors E, N, U of position at the times t, s, by the bound and in runs, (times, 9) each."""

    t: Array
    bound: Array
    runs: Array


def cut(case: Case, change: Mapping[str, Any]) -> EvaluationTask:
    """Return the task of a line, which ends with its outage."""
    task = get_task(case.task)
    gps = {**task.kwargs["gps"], "outages_s": [[case.begin, case.end]], **change.get("gps", {})}
    kwargs = {**task.kwargs, "gps": gps, "aids": change["aids"], "duration": case.end}
    return dataclasses.replace(task, name=f"{case.task}-drift", kwargs=kwargs, seeds_of=case.task)


def drift(task: EvaluationTask, solver: str, runs: int) -> Drift:
    """Return the drift of a task."""
    bound, records = bounds.compute(task), evaluate(task, solver, runs, cost=False).records
    assert bound is not None
    t = np.asarray(records.criteria.history_t, dtype=float)
    return Drift(t, np.square(bound.sigma), np.square(records.history, dtype=float).mean(axis=0))


def draw(found: Mapping[str, Mapping[str, Drift]], colours: Mapping[str, str], solver: str, path: Path) -> None:
    """Draw the panels, with one legend for all, and write them to ``path``."""
    figure = new_figure(10.0, 4.2)
    for axes, (name, title, components) in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
        case = CASES[name]
        for label, line in found[name].items():
            here = line.t >= case.begin - 5.0
            t = line.t[here] - case.begin
            for squares, look in ((line.bound, {"lw": 1.1, "ls": (0, (4, 2))}), (line.runs, {"lw": 1.6})):
                axes.plot(t, np.sqrt(squares[here][:, components].sum(axis=1)), color=colours[label], **look)
        finish(axes, title, xlabel="time without GPS, s", yscale="log", xlim=(-5.0, case.end - case.begin))
        axes.set_ylim(0.2)
    figure.axes[0].set_ylabel("position error, RMS, m")
    handles = [Line2D([], [], color=colour, lw=1.6, label=label) for label, colour in colours.items()]
    handles += [
        Line2D([], [], color="0.3", lw=look[0], ls=look[1], label=label)
        for label, look in ((f"runs of {solver}", (1.6, "-")), ("bound", (1.1, (0, (4, 2)))))
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    with matplotlib.rc_context({"svg.hashsalt": path.stem}):  # equal runs give an equal file
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=20, help="default %(default)s")
    parser.add_argument("--solver", default="ekf", help="default %(default)s")
    docs = Path(__file__).parents[1] / "docs"
    parser.add_argument("--plot", type=Path, default=docs / "drift_with_aids.svg", help="default %(default)s")
    given = parser.parse_args()
    labels = dict.fromkeys(label for case in CASES.values() for label in case.lines)
    colours = dict(zip(labels, (COLOURS[-1], *COLOURS[:-1], "#7F7F7F"), strict=True))
    table = Table(title=f"position error at the end of the outage, m: {given.solver} in {given.runs} runs (bound)")
    for name in ("vehicle", "aid", "horizontal", "vertical"):
        table.add_column(name)
    found: dict[str, dict[str, Drift]] = {}
    for name, case in CASES.items():
        found[name] = {}
        for label, change in case.lines.items():
            line = found[name][label] = drift(cut(case, change), given.solver, given.runs)
            ends = [
                [np.sqrt(part[-1, components].sum()) for part in (line.runs, line.bound)]
                for components in (HORIZONTAL, VERTICAL)
            ]
            table.add_row(name, label, *(f"{runs:.2f} ({bound:.2f})" for runs, bound in ends))
    draw(found, colours, given.solver, given.plot)
    Console().print(table)


if __name__ == "__main__":
    main()
