"""What is said of gsf_imm, held against runs that were not used to develop it.

    python benchmarks/claims.py --seed 9001             every claim on one suite seed
    python benchmarks/claims.py --seed 9001 white jump  some claims
    python benchmarks/claims.py --part 0.1              with a tenth of the runs, to see that it works

A claim names a task, a rival and the largest ratio of their scores: at the point, and at the upper end of the interval. A rival
that is told the truth or spared a disturbance plays a twin of the task with the same runs. Errors are capped at the threshold of
alignment, ratios have intervals by sign flips, and ratios to the bound are adjusted by the oracle's luck. The exit code is 1 if a
claim does not hold.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table

from sins_env.arrays import Array, Mask
from sins_env.evaluation import evaluate
from sins_env.evaluation.bound import oracle
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.score import exact, losses
from sins_env.evaluation.score.headline import cap_of
from sins_env.evaluation.score.quantities import run_errors
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.units import DEG

SOLVER = "gsf_imm"
HONEST_NEES = (0.8, 1.25)  #: NEES over its expectation at the end, for a prior that is right


@dataclass(frozen=True)
class Claim:
    """One claim: the solver on ``task`` against ``rival``, who plays with ``spared`` settings of the environment."""

    task: str
    runs: int
    rival: str = ""
    spared: Mapping[str, Any] = field(default_factory=dict)
    score: str = "azimuth"
    at_point: float = math.inf  #: largest ratio
    at_end: float = math.inf  #: largest upper end of its interval
    honest: bool = True  #: whether the told prior is right, so that the NEES can be judged
    all_align: bool = False  #: whether no run may fail
    median_deg: float = math.inf  #: largest median of the heading error at the end
    over_bound: float = math.inf  #: largest ratio of the score to its bound
    settings: Mapping[str, Any] = field(default_factory=dict)  #: settings of the solver
    why: str = ""  #: why these settings are fair


RIGHT_GPS = {"vel_std_mps": 0.01, "rate_hz": 10}
CLAIMS = {
    "white": Claim("sway-white-v0", 200, "two_pass", at_point=1.02, at_end=1.03),
    "jump": Claim("sway-jump-v0", 200, "two_pass", {"gps": "thesis"}, at_point=1.02, at_end=1.04, all_align=True),
    "told-wrong": Claim(
        "sway-told-wrong-v0", 200, "two_pass", {"prior": "matched"}, at_point=1.03, at_end=1.07, honest=False
    ),
    "markov": Claim("sway-markov-v0", 200, "two_pass", at_point=1.05, at_end=1.08),
    "scratch": Claim("sway-scratch-v0", 200, "coarse_oba", at_point=1.0),
    "anyheading": Claim("sway-anyheading-v0", 200, "gsf_ekf", at_point=1.02, at_end=1.04),
    "heavytail": Claim("sway-heavytail-v0", 200, "imm_ekf", all_align=True),
    "contaminated": Claim("sway-contaminated-v0", 200, "gm_ekf"),
    "static8": Claim(
        "static8-v0",
        100,
        "coarse_analytic3",
        at_point=1.05,
        settings={"stillness": True},
        why="the rival is told that the base stands still; the solver has to see it",
    ),
    "vehicle": Claim("vehicle-v0", 30, "coarse_inertial", at_point=1.05, honest=False),
    "mixture": Claim("flight-lu-mixture-v0", 100, "gm_ekf", score="position", over_bound=1.03),
    "lu-gauss": Claim("flight-lu-gauss-v0", 100, "inekf", score="position"),
    "zhao": Claim("flight-zhao2010-v0", 100, "inekf", score="position", honest=False),
    "sun": Claim("flight-sun2012-v0", 40, "inekf"),
    "sun-physical": Claim("flight-sun2012-physical-v0", 40, "inekf"),
    "sun-fixed": Claim("flight-sun2012-fixed-v0", 40, "inekf", honest=False),
    "hotstart30": Claim("flight-hotstart30-v0", 100, all_align=True, median_deg=0.11),
    "hotstart60": Claim("flight-hotstart60-v0", 100, all_align=True, median_deg=0.11),
    "hotstart90": Claim("flight-hotstart90-v0", 100, all_align=True, median_deg=0.11),
}


def twin(task: EvaluationTask, spared: Mapping[str, Any]) -> EvaluationTask:
    """Return the task with other settings and the same run seeds."""
    if not spared:
        return task
    return dataclasses.replace(
        task, name=f"{task.name}-spared", kwargs={**task.kwargs, **spared}, seeds_of=task.seeds_of or task.name
    )


class Outcome(NamedTuple):
    """What a solver made of R runs of a task."""

    losses: Array  #: (R,) squared errors, capped
    final: Array  #: (R,) errors at the end, SI
    lost: Mask  #: (R,)
    nees: float  #: NEES at the end over its expectation; NaN without a covariance
    nees_error: float  #: its standard error if the covariance is right


def outcome(task: EvaluationTask, results: Results, score: str, at_end: bool = False) -> Outcome:
    """Return what counts of the results: losses of time means, or of the errors at the end."""
    cap, records = cap_of(task, results.records, results.bound, score), results.records
    errors, final = run_errors(records, score)
    # the time means of a flight begin at a start that may be far off
    last = final if records.criteria.navigates else errors
    lost = records.failed | ~(last <= 3.0 * cap)
    nees, dof = results.summary.nees_of_all, results.summary.nees_dof
    known = (nees[-1].mean / dof, math.sqrt(2.0 / (dof * nees[-1].runs))) if nees else (math.nan, math.nan)
    return Outcome(losses.capped(final if at_end else errors, cap), final, lost, *known)


def check(claim: Claim, runs: int, seed: int, bar: Bar) -> dict[str, Any]:
    """Play a claim, and return what was found."""
    task = get_task(claim.task)
    begin = time.perf_counter()

    def played(task: EvaluationTask, solver: str, settings: Mapping[str, Any]) -> Results:
        return evaluate(
            task,
            solver,
            runs,
            seed,
            settings=settings,
            cost=False,
            progress=lambda done, total: bar.update(done, total),
        )

    results = played(task, SOLVER, claim.settings)
    mine = outcome(task, results, claim.score)
    loss, lost = mine.losses, mine.lost
    found: dict[str, Any] = {"task": claim.task, "runs": len(loss), "seed": seed, "rival": claim.rival}
    if claim.settings:
        found |= {"settings": dict(claim.settings), "why": claim.why}
    faults = []
    found["failed"] = [int(lost.sum()), *exact.share(int(lost.sum()), len(lost))[1]]
    if claim.all_align and lost.any():
        faults.append(f"{lost.sum()} failed")
    if claim.rival:
        rival = played(twin(task, claim.spared), claim.rival, {})
        # a rival is held to the cap of the task that the solver plays
        its = losses.capped(
            run_errors(rival.records, claim.score)[0], cap_of(task, results.records, results.bound, claim.score)
        )
        ratio, (low, high) = exact.ratio_by_flips(loss, its)
        found["ratio"] = [ratio, low, high]
        if not ratio <= claim.at_point:
            faults.append(f"ratio {ratio:.3f} > {claim.at_point:g}")
        if not high <= claim.at_end:
            faults.append(f"upper end {high:.3f} > {claim.at_end:g}")
    if claim.score == "azimuth" and not results.records.criteria.navigates:
        seen = oracle.compute(task, runs, seed)
        if seen is not None:
            verdict = dataclasses.replace(results, oracle=seen.records).verdict
            found["over_bound"] = [verdict.x_bound, *verdict.x_bound_ci]
    elif claim.score != "azimuth":
        found["over_bound"] = [results.headline_ratio, math.nan, math.nan]
    if not found.get("over_bound", [0.0])[0] <= claim.over_bound:
        faults.append(f"{found['over_bound'][0]:.3f} x bound > {claim.over_bound:g}")
    if claim.median_deg < math.inf:
        value, (low, high) = exact.median(mine.final / DEG)
        found["median_deg"] = [value, low, high]
        if not value <= claim.median_deg:
            faults.append(f"median {value:.3f} deg > {claim.median_deg:g}")
    if not math.isnan(mine.nees):
        found["nees"] = mine.nees
        low, high = HONEST_NEES[0] - 2.0 * mine.nees_error, HONEST_NEES[1] + 2.0 * mine.nees_error
        if claim.honest and not low <= mine.nees <= high:
            faults.append(f"NEES {mine.nees:.2f}")
    return {**found, "faults": faults, "wall_s": time.perf_counter() - begin}


def table_of(rows: Mapping[str, dict[str, Any]]) -> Table:
    """Return the table of what was found."""
    table = Table(title=f"{SOLVER} on fresh runs")
    for heading in (
        "claim",
        "runs",
        "seed",
        "failed",
        "rival",
        "ratio",
        "x bound",
        "median, deg",
        "NEES / n",
        "verdict",
    ):
        table.add_column(heading, justify="left" if heading in ("claim", "rival", "verdict") else "right")
    for name, row in rows.items():
        k, _, high = row["failed"]
        settings = [f"{key} = {value}" for key, value in row.get("settings", {}).items()]
        cells = [" ".join([name, *settings]), f"{row['runs']}", f"{row['seed']}", f"{k} (<= {high:.1%})", row["rival"]]
        cells += [_interval(row.get(key), ".3f") for key in ("ratio", "over_bound", "median_deg")]
        cells.append(f"{row['nees']:.2f}" if "nees" in row else "-")
        verdict = "; ".join(row["faults"]) or "holds"
        table.add_row(*cells, f"{verdict} ({row['why']})" if "why" in row else verdict)
    return table


def _interval(found: Sequence[float] | None, form: str) -> str:
    if found is None:
        return "-"
    value, low, high = found
    return f"{value:{form}}" if math.isnan(low) else f"{value:{form}} [{low:{form}}, {high:{form}}]"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="what is said of gsf_imm, on fresh runs")
    parser.add_argument("claims", nargs="*", metavar="claim", help=f"default all: {' '.join(CLAIMS)}")
    parser.add_argument(
        "--seed", type=int, required=True, help="seed of the suite, one that was not used in development"
    )
    parser.add_argument("--runs", type=int, help="runs of each claim, instead of its own number")
    parser.add_argument("--part", type=float, default=1.0, help="part of the runs, 0 to 1 (default %(default)s)")
    parser.add_argument(
        "--json", metavar="FILE", help="also write what was found, a claim a line, as soon as it is known"
    )
    given = parser.parse_args(arguments)
    names = given.claims or list(CLAIMS)
    if unknown := [name for name in names if name not in CLAIMS]:
        parser.error(f"{', '.join(unknown)}: no such claim; allowed: {', '.join(CLAIMS)}")
    rows: dict[str, dict[str, Any]] = {}
    for name in names:
        claim = CLAIMS[name]
        with Bar(f"{name}, seed {given.seed}") as bar:
            rows[name] = check(claim, given.runs or max(round(given.part * claim.runs), 8), given.seed, bar)
        if given.json:
            with open(given.json, "a", encoding="utf-8") as file:
                file.write(json.dumps({"claim": name, **rows[name]}) + "\n")
    Console(width=160).print(table_of(rows))
    return 1 if any(row["faults"] for row in rows.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
