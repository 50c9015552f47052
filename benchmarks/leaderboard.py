"""The leaderboard of the default suite (suite.py): makes missing runs, then writes leaderboard.json and README's figures.

    python benchmarks/leaderboard.py                            everything; takes hours, mostly for the particle filters
    python benchmarks/leaderboard.py --at-most 4 --db try.sqlite --out /tmp    a few runs each, elsewhere

The results file is one of ``sins-env eval`` and may begin as a copy of one that has some of the runs. After an interruption the
same command continues. ``readme.py`` makes the tables of README from the JSON.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import story
import suite

from sins_env.cli.output import remark
from sins_env.evaluation.estimators import version
from sins_env.evaluation.estimators.memory import keep_freed_memory
from sins_env.evaluation.score.headline import by_failures, headline
from sins_env.evaluation.score.paired import apart, common, difference_of_rates, ratio_of_rms
from sins_env.evaluation.score.quantities import QUANTITIES, run_errors
from sins_env.evaluation.score.ranking import failure_rate, ranked
from sins_env.evaluation.score.resampling import NO_INTERVAL, Estimate, Interval
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.speed.cost import measure_cost
from sins_env.evaluation.store.filling import fill
from sins_env.evaluation.store.store import Store
from sins_env.units import ARCSEC, DEG

ROOT = Path(__file__).resolve().parents[1]
JSON = ROOT / "benchmarks" / "leaderboard.json"
DIGITS = 5  #: digits of the numbers in the JSON
CHUNK = 128  #: number of runs that are played as one batch, which makes each of them cheaper


def run(store: Store, most: int | None = None, workers: int | None = None, only: Sequence[str] = ()) -> None:
    """Make the runs of the suite that the file lacks, for the tasks ``only`` or for all."""
    chosen = [task for task in suite.tasks() if not only or task.name in only]
    for task in chosen:
        store.add_task(task)
    names = {task.name for task in chosen}
    for part in suite.SUITE:
        wanted = part.evaluations(most) if part.task in names else []
        fill(store, wanted, workers=workers, chunk=CHUNK)


def measure(store: Store, anew: bool = False) -> None:
    """Measure the CPU time of a step of each solver, all in one go; known ones only with ``anew``."""
    keep_freed_memory()
    for part in suite.SUITE:
        for one in part.evaluations() if part.task in suite.COSTED else ():
            if store.runs_of(one.key) and (anew or store.results(one.key, whole=False).cost is None):
                cost = measure_cost(one.task, one.solver, clock=time.process_time)
                if cost:
                    store.add_cost(one.key, cost)


def results(store: Store, whole: bool = False) -> dict[str, list[Results]]:
    """Return the results of the suite in the file, by task; solvers without runs are left out."""
    out: dict[str, list[Results]] = {task.name: [] for task in suite.tasks()}
    for part in suite.SUITE:
        for one in part.evaluations() if part.task in out else ():
            if store.runs_of(one.key):
                out[part.task].append(store.results(one.key, one.runs, whole))
    return {name: found for name, found in out.items() if found}


class Score(NamedTuple):
    """The score by which the solvers of a task are ranked, in a unit for readers."""

    name: str
    unit: str
    value: float
    interval: Interval  #: 95 % interval of the value
    bound: float = math.nan  #: the Cramer-Rao bound of the score; NaN: none


def score(one: Results) -> Score:
    """Return the score of a solver's results.

    It is the RMS error that ranks. If failures rank, it is the median heading error at the end. If no truth is known, it is
    the spread of the heading.
    """
    s = one.summary
    if not s.scored:
        return Score("spread of the heading", "deg", one.spread.deg, NO_INTERVAL)
    if s.navigation is None:
        limit = one.bound.steady[2] / ARCSEC if one.bound else math.nan
        return Score("azimuth RMS", "arcsec", s.rms["U"], s.rms_ci["U"], limit)
    if by_failures(one.task):
        value, ends = s.navigation.median_azimuth
        return Score("median heading error at the end", "deg", value / DEG, (ends[0] / DEG, ends[1] / DEG))
    quantity = QUANTITIES[headline(one.task)]
    value, ends = s.navigation.armse[headline(one.task)]
    limit = one.bound_means.get(headline(one.task), math.nan) / quantity.unit
    ends = ends[0] / quantity.unit, ends[1] / quantity.unit
    return Score(f"{quantity.name} RMS", quantity.unit_name, value / quantity.unit, ends, limit)


def as_data(store: Store) -> dict[str, Any]:
    """Return the board of the suite and its provenance; values that are unknown or infinite are null."""
    tasks: list[dict[str, Any]] = []
    entries: list[dict[str, Any]] = []
    for name, group in results(store).items():
        yardstick = next(one for one in group if one.solver == suite.YARDSTICK)
        told = score(yardstick)
        tasks.append(
            {
                "task": name,
                "what": yardstick.task.what,
                "score": told.name,
                "unit": told.unit,
                "bound": told.bound,
                "bound_holds": bool(yardstick.bound.holds) if yardstick.bound else None,
                "ranked_by": "failures"
                if by_failures(yardstick.task)
                else "score"
                if yardstick.summary.scored
                else None,
                "seed": yardstick.task.suite_seed,
            }
        )
        entries += [_entry(rank, one, yardstick) for rank, one in ranked(group)]
    return {"provenance": _provenance(store), "tasks": _plain(tasks), "results": _plain(entries)}


def _entry(rank: int, one: Results, yardstick: Results) -> dict[str, Any]:
    s, told = one.summary, score(one)
    nees, dof = s.nees_of_all, s.nees_dof
    return {
        "task": one.task.name,
        "solver": one.solver,
        "rank": rank if s.scored else None,
        "runs": s.runs,
        "success": s.success,
        "median_s": s.t_conv_median_s,
        "score": told.value,
        "interval": told.interval,
        "bound_ratio": one.headline_ratio if s.scored else None,
        "nees": nees[-1].mean / dof if nees else None,
        "nees_right": nees[-1].inside if nees else None,
        "failed": round(failure_rate(one) * s.runs),
        "cost": one.cost.ratio if one.cost else None,
        "paired": _paired(one, yardstick),
    }


def _paired(one: Results, yardstick: Results) -> dict[str, Any] | None:
    """Compare with the yardstick over common runs: the ratio of the errors that rank, and the difference of failed runs."""
    if one.label == yardstick.label or not one.summary.scored:
        return None
    a, b = one.records, yardstick.records
    mine, its = common(a, b)
    errors = run_errors(a, headline(one.task))[0][mine], run_errors(b, headline(one.task))[0][its]
    ratio = ratio_of_rms(*errors)
    failures = difference_of_rates(a.failed[mine], b.failed[its])
    decided = apart(len(mine), ratio[1])
    return {"runs": len(mine), **_estimate("ratio", ratio), "apart": decided, **_estimate("failures", failures)}


def _estimate(name: str, estimate: Estimate) -> dict[str, Any]:
    return {name: estimate[0], f"{name}_interval": estimate[1]}


def _provenance(store: Store) -> dict[str, Any]:
    """Return which code made the runs, when, on which machines and with which packages."""
    keys = (one.key for part in suite.SUITE for one in part.evaluations())
    sessions = {one.id: one for key in keys for one in store.sessions(key)}
    started = sorted(one.started for one in sessions.values())
    return {
        "code": version.code_version(suite.YARDSTICK),
        "started": [started[0], started[-1]],
        "machines": sorted({one.machine for one in sessions.values()}),
        "versions": sessions[max(sessions)].versions,
    }


def _plain(value: Any) -> Any:
    """Return a value with its numbers in the form of JSON, to a few digits."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    if isinstance(value, (bool, str, int)) or value is None:
        return value
    return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None


def as_text(data: dict[str, Any]) -> str:
    """Return JSON with one line for each task and each result, so that differences between versions are readable."""
    parts = ['"provenance": ' + json.dumps(data["provenance"])]
    parts += [f'"{name}": [\n' + ",\n".join(map(json.dumps, data[name])) + "\n]" for name in ("tasks", "results")]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="the leaderboard of the default suite")
    parser.add_argument("--db", type=Path, default=ROOT / "leaderboard.sqlite", help="results file")
    parser.add_argument(
        "--task", nargs="+", default=[], choices=[task.name for task in suite.tasks()], help="run only these tasks"
    )
    parser.add_argument("--at-most", type=int, metavar="N", help="largest number of runs of each solver and task")
    parser.add_argument("--workers", type=int, metavar="N", help="number of processes, default one per core")
    parser.add_argument("--no-runs", action="store_true", help="make no runs, take the file as it is")
    parser.add_argument("--costs", action="store_true", help="measure all costs again")
    parser.add_argument("--out", type=Path, metavar="DIRECTORY", help="where JSON and figures go, default this project")
    given = parser.parse_args(arguments)
    with Store(given.db) as store:
        if not given.no_runs:
            run(store, given.at_most, given.workers, given.task)
        measure(store, given.costs)
        target = given.out / JSON.name if given.out else JSON
        target.write_text(as_text(as_data(store)))
        remark(f"leaderboard: {target}")
        story.draw(results(store, whole=True), given.out or ROOT / "docs")


if __name__ == "__main__":
    main()
