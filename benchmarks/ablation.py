"""What each part of gsf_imm is there for: the score without it, on the task that needs it.

    python benchmarks/ablation.py --seed 9011                all parts, 40 runs each
    python benchmarks/ablation.py --seed 9011 regimes bank   some parts

A part is switched off by a setting. The told law has none: the solver is then told that the fixes are Gaussian. Errors in Euler
angles are those of a bank without models, ``gsf_ekf``, in closed loop. The ratio is that of the scores without a part and with it,
in the same runs. Errors are capped at the threshold of alignment, or in flights at three times the bound.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from claims import SOLVER, Outcome, outcome
from rich.console import Console
from rich.table import Table

from sins_env.evaluation import evaluate
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.score import exact
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.types import Rng, Task
from sins_env.units import DEG
from solvers.pipeline.bank.gsf_imm import GSFIMM


class WithoutLaw(GSFIMM):
    """The solver without the told law of the fixes."""

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode of the task with Gaussian fixes."""
        gps = dataclasses.replace(task.gps, contamination=0.0, heavy_tail_dof=0.0)
        super().reset(dataclasses.replace(task, gps=gps), rng, num_runs)


@dataclass(frozen=True)
class Part:
    """One part of the solver, with a task that needs it."""

    task: str
    without: Mapping[str, Any] = field(default_factory=dict)  #: settings
    solver: Any = SOLVER  #: the solver without the part
    whole: tuple[str, Mapping[str, Any]] = (SOLVER, {})  #: the solver with it
    score: str = "azimuth"
    at_end: bool = (
        False  #: whether the error at the end is scored, for a start so far off that time means show only that
    )


TOLD = {"imu_factors": [[1, 1]], "fix_factors": [1], "fix_offsets": False}
CLOSED = {"feedback": "closed"}
PARTS = {
    "models of the IMU": Part("sway-told-wrong-v0", {"imu_factors": [[1, 1]]}),
    "regimes": Part("sway-jump-v0", {"fix_factors": [1]}),
    "offset of the fixes": Part("sway-jump-v0", {"fix_offsets": False}),
    "regimes and offset": Part("sway-jump-v0", {"fix_factors": [1], "fix_offsets": False}),
    "bank": Part("sway-anyheading-v0", {"spacing_deg": 360}),
    "told law": Part("flight-lu-mixture-v0", solver=WithoutLaw, score="position"),
    "invariant errors": Part(
        "flight-hotstart90-v0", {**CLOSED, "coordinates": "euler"}, "gsf_ekf", ("gsf_ekf", CLOSED), at_end=True
    ),
    "all of it": Part("sway-white-v0", {**TOLD, "spacing_deg": 360}),
}


def found(part: Part, runs: int, seed: int, known: dict[str, Outcome], bar: Bar) -> dict[str, Any]:
    """Play the solver with and without a part; ``known`` keeps what it does with all parts, by task."""
    task = get_task(part.task)

    def played(solver: Any, settings: Mapping[str, Any]) -> Outcome:
        results = evaluate(
            task, solver, runs, seed, settings=settings, cost=False, workers=1,
            progress=lambda done, total: bar.update(done, total),
        )  # fmt: skip
        return outcome(task, results, part.score, part.at_end)

    if part.task not in known:
        known[part.task] = played(*part.whole)
    off, on = played(part.solver, part.without), known[part.task]
    return {
        "task": part.task,
        "runs": runs,
        "ratio": _flat(exact.ratio_by_flips(off.losses, on.losses)),
        "scores": [math.sqrt(one.losses.mean()) for one in (off, on)],
        "failed": [int(one.lost.sum()) for one in (off, on)],
        "nees": [one.nees for one in (off, on)],
    }


def _flat(estimate: Any) -> list[float]:
    value, (low, high) = estimate
    return [value, low, high]


def summary(rows: Mapping[str, dict[str, Any]], seed: int) -> Table:
    """Return the table of all parts."""
    table = Table(title=f"{SOLVER} without one part, and whole; seed {seed}")
    for heading in ("without", "task", "runs", "score, without and whole", "ratio", "failed", "NEES / n"):
        table.add_column(heading, justify="left" if heading in ("without", "task") else "right")
    for name, row in rows.items():
        unit, size = ("m", 1.0) if PARTS[name].score == "position" else ("deg", DEG)
        off, on = (score / size for score in row["scores"])
        ratio, low, high = row["ratio"]
        table.add_row(
            name,
            row["task"],
            f"{row['runs']}",
            f"{off:.4g}, {on:.4g} {unit}",
            f"{ratio:.3f} [{low:.3f}, {high:.3f}]",
            "{}, {}".format(*row["failed"]),
            "{:.2f}, {:.2f}".format(*row["nees"]),
        )
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="gsf_imm without one part at a time")
    parser.add_argument("parts", nargs="*", metavar="part", help=f"default all: {', '.join(PARTS)}")
    parser.add_argument("--seed", type=int, required=True, help="seed of the suite")
    parser.add_argument("--runs", type=int, default=40, help="default %(default)s")
    parser.add_argument("--json", metavar="FILE", help="also write what was found, a part a line")
    given = parser.parse_args(arguments)
    if unknown := [name for name in given.parts if name not in PARTS]:
        parser.error(f"{', '.join(unknown)}: no such part; allowed: {', '.join(PARTS)}")
    rows: dict[str, dict[str, Any]] = {}
    known: dict[str, Outcome] = {}
    for name in given.parts or PARTS:
        with Bar(name) as bar:
            rows[name] = found(PARTS[name], given.runs, given.seed, known, bar)
        if given.json:
            with open(given.json, "a", encoding="utf-8") as file:
                file.write(json.dumps({"part": name, "seed": given.seed, **rows[name]}) + "\n")
    Console(width=160).print(summary(rows, given.seed))


if __name__ == "__main__":
    main()
