"""A minute without GPS
====================

How far does an INS drift after a filter has calibrated it? ::

    python examples/gps_outage.py                                      # two flights, 16 runs
    python examples/gps_outage.py --all --runs 50 --solver ckf inekf   # every flight

The outage begins after three fifths of the flight. Position errors are RMS over the runs, just before the outage and at its end.
"""

import argparse
import dataclasses

import numpy as np
from rich.console import Console
from rich.table import Table

from sins_env.evaluation import evaluate
from sins_env.evaluation.play.criteria import COMPONENTS
from sins_env.evaluation.tasks.catalogue import TASKS, get_task

OUTAGE_S = 60.0
EAST, NORTH, UP = (COMPONENTS.index(f"pos_{axis}") for axis in "enu")


def without_gps(name: str):
    """Return the task with an outage, cut off a minute after it, and the time at which the outage begins, s."""
    task = get_task(name)
    env = task.make(1)
    duration = env.unwrapped.task.duration_s
    env.close()
    begin = round(0.6 * duration)
    end = begin + OUTAGE_S
    kwargs = {**task.kwargs, "gps": {"outages_s": [[begin, end]]}, "duration": end + 60.0}
    return dataclasses.replace(task, name=f"{name}-outage", kwargs=kwargs, score_from_s=0.0), begin


def drift(task, begin: float, solver: str, runs: int) -> list[str]:
    """Return horizontal and vertical errors before the outage and at its end, m, and the azimuth error before it, deg."""
    records = evaluate(task, solver, runs, cost=False).records
    before, after = (records.history[:, int(t) - 1] for t in (begin, begin + OUTAGE_S))  # the history is at 1 Hz

    def rms(errors: np.ndarray, *components: int) -> float:
        return float(np.sqrt(np.square(errors[:, components], dtype=float).sum(axis=1).mean()))

    across, up = (f"{rms(before, *parts):.2f} → {rms(after, *parts):.2f}" for parts in ((EAST, NORTH), (UP,)))
    return [across, up, f"{np.degrees(rms(before, 2)):.3f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--all", action="store_true", help="every flight")
    parser.add_argument(
        "--flight", nargs="+", default=["flight-lu-gauss-v0", "flight-hotstart30-v0"], help="default two"
    )
    parser.add_argument("--runs", type=int, default=16, help="default %(default)s")
    parser.add_argument("--solver", nargs="+", default=["ckf"], help="default ckf")
    given = parser.parse_args()
    table = Table(title=f"{OUTAGE_S:.0f} s without GPS, {given.runs} runs", title_justify="left")
    for name in ("flight", "solver"):
        table.add_column(name)
    for name in ("horizontal, m", "vertical, m", "azimuth before, deg"):
        table.add_column(name, justify="right")
    flights = [name for name in TASKS if name.startswith("flight-")]
    for name in flights if given.all else given.flight:
        task, begin = without_gps(name)
        for solver in given.solver:
            table.add_row(name.removeprefix("flight-"), solver, *drift(task, begin, solver, given.runs))
    Console().print(table)


if __name__ == "__main__":
    main()
