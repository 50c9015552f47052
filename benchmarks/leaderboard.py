"""The leaderboard of the default suite (suite.py): makes missing runs, then writes leaderboard.json and the figures of docs.

    python benchmarks/leaderboard.py                            everything; suite.py prints how long it takes
    python benchmarks/leaderboard.py --at-most 4 --db try.sqlite --out /tmp    a few runs each, elsewhere
    python benchmarks/leaderboard.py --no-runs                  writes what the results file has

The results file is one of ``sins-env eval`` and may begin as a copy of one that has some of the runs. After an interruption the
same command continues. Rows of an older version of the code count again after ``sins-env verify --adopt``, if they are equal.
``pages.py`` makes the tables of docs from the JSON.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from datetime import timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import story
import suite
from suite import Portion

from sins_env.arrays import Array
from sins_env.cli.output import remark
from sins_env.evaluation.estimators import version
from sins_env.evaluation.estimators.memory import keep_freed_memory
from sins_env.evaluation.play.executors import available_cores
from sins_env.evaluation.score import exact, losses
from sins_env.evaluation.score.headline import by_failures, headline
from sins_env.evaluation.score.paired import common
from sins_env.evaluation.score.quantities import quantity
from sins_env.evaluation.score.ranking import verdicts
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.score.verdicts import EQUAL, LOOK_LEVEL, LOOKS, Verdict
from sins_env.evaluation.speed.cost import measure_cost
from sins_env.evaluation.store.adopting import adoptions
from sins_env.evaluation.store.filling import fill
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask, suite_hash
from sins_env.writing.files import write_text
from sins_env.writing.visible import in_json

ROOT = Path(__file__).resolve().parents[1]
JSON = ROOT / "benchmarks" / "leaderboard.json"
SCORING = 2
DIGITS = 5  #: digits of the numbers in the JSON
CHUNK = 128  #: number of runs that are played as one batch, which makes each of them cheaper
FIRST = 3  #: number of first solvers of a task whose neighbours are looked at again


# ---- playing ----


class Play:
    """One call of the script: plays portions of the suite, and tells how long the others will take.

    The time left is that of the missing runs, as suite.json has it, times what the runs of this call took over theirs.
    """

    def __init__(self, store: Store, most: int | None, workers: int | None) -> None:
        self.store, self.most, self.workers = store, most, workers
        self.cpu, self.begin = suite.known_cpu(), time.monotonic()
        self.planned_s, self.took_s = 0.0, 0.0

    def missing_s(self, portions: Sequence[Portion]) -> float:
        """Return the CPU time of the runs that the file lacks, as measured before, s."""
        return sum(
            suite.cpu_s(self.cpu, portion.task, one.solver, len(one.missing(self.store)))
            for portion in portions
            for one in portion.evaluations(self.most)
        )

    def left(self, portions: Sequence[Portion]) -> str:
        """Return the time left for portions in words."""
        pace = self.took_s / self.planned_s if self.planned_s else 1.0 / (self.workers or available_cores())
        return f"about {timedelta(seconds=round(pace * self.missing_s(portions)))} left"

    def play(self, portion: Portion, later: Sequence[Portion] = ()) -> None:
        """Make the missing runs of a portion; ``later`` are those that follow, for the time left."""
        planned_s, begin = self.missing_s([portion]), time.monotonic()
        runs = len(portion.evaluations(self.most)[0].runs)
        title = f"{suite.short(portion.task)}, suite {portion.suite}"
        left = self.left([portion, *later])
        gone = timedelta(seconds=round(begin - self.begin))
        if any(one.missing(self.store) for one in portion.evaluations(self.most)):
            remark(f"{gone} {title}: {len(portion.solvers)} solvers, {runs} runs; {left}")
        fill(
            self.store,
            portion.evaluations(self.most),
            portion.seed,
            workers=self.workers,
            chunk=CHUNK,
            title=f"{title}; {left}",
        )
        self.planned_s, self.took_s = self.planned_s + planned_s, self.took_s + time.monotonic() - begin


def run(
    store: Store, most: int | None = None, workers: int | None = None, only: Sequence[str] = (), stages: int = 3
) -> None:
    """Make the runs of the suite that the file lacks and measure costs, a whole task at a time, for ``only`` or for all."""
    play = Play(store, most, workers)
    portions = [one for one in suite.first() if not only or one.task in only]
    slow = [one for one in suite.preliminary() if not only or one.task in only]
    for portion in portions:
        store.add_task(get_task(portion.task))
    for i, portion in enumerate(portions):
        # the leader is not known before; it costs about as much as the recommended solver
        follow = [] if stages < 2 else [p for one in portions[i + 1 :] if (p := suite.confirming(one.task, "gsf_imm"))]
        play.play(portion, [*portions[i + 1 :], *follow, *slow])
        leader = leader_of(standing(store, portion.task)) if stages >= 2 else None
        confirming = leader and suite.confirming(portion.task, leader)
        if confirming:
            play.play(confirming, [*portions[i + 1 :], *follow, *slow])
        measure(store, portion.task)
    for i, portion in enumerate(slow if stages >= 2 else []):
        play.play(portion, slow[i + 1 :])
        measure(store, portion.task)
    for runs in LOOKS[1:] if stages >= 3 and (most or LOOKS[-1]) > LOOKS[0] else ():
        undecided = [(one.task, still_open(looks(store, one.task, standing(store, one.task)))) for one in portions]
        further = [Portion(task, runs, solvers) for task, solvers in undecided if solvers]
        for i, portion in enumerate(further):
            play.play(portion, further[i + 1 :])


def measure(store: Store, task: str, anew: bool = False) -> None:
    """Measure the CPU time of a step of each solver on a task of COSTED; known ones only with ``anew``."""
    keep_freed_memory()
    for part in (*suite.first(), *suite.preliminary()) if task in suite.COSTED else ():
        for one in part.evaluations() if part.task == task else ():
            if store.runs_of(one.key) and (anew or store.results(one.key, whole=False).cost is None):
                cost = measure_cost(one.task, one.solver, clock=time.process_time)
                if cost:
                    store.add_cost(one.key, cost)


# ---- results ----


def results(store: Store, portions: Sequence[Portion], whole: bool = False) -> list[Results]:
    """Return what the file has of these portions; solvers without runs are left out."""
    return [
        store.results(one.key, one.runs, whole)
        for portion in portions
        for one in portion.evaluations()
        if store.runs_of(one.key)
    ]


Standing = Sequence[tuple[Results, Verdict]]  #: solvers of a task, the best first


def judged(group: Sequence[Results]) -> Standing:
    """Return solvers of one task and suite with their verdicts, the best first."""
    return sorted(zip(group, verdicts(group) if group else (), strict=True), key=lambda pair: _order(pair[1]))


def _order(verdict: Verdict) -> tuple[bool, int, float]:
    """Return the key that sorts solvers, the best first; those without a rank come last."""
    return verdict.rank is None, verdict.rank or 0, verdict.score


def standing(store: Store, task: str) -> Standing:
    """Return the solvers of a task on suite A with their verdicts, the best first."""
    return judged(of_task(store, task))


def of_task(store: Store, task: str, whole: bool = False) -> list[Results]:
    """Return the results of a task on suite A, with those of slow solvers."""
    return results(store, [one for one in (*suite.first(), *suite.preliminary()) if one.task == task], whole)


def leader_of(ranked: Standing) -> str | None:
    """Return the solver with the smallest score; slow ones, which have fewer runs, never lead."""
    names = [one.solver for one, verdict in ranked if math.isfinite(verdict.score)]
    return next((name for name in names if name not in suite.SLOW), None)


def still_open(pairs: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """Return the solvers of the pairs that are neither told apart nor equal at their last look."""
    return tuple(dict.fromkeys(name for one in pairs if one["verdict"] == "open" for name in (one["a"], one["b"])))


def looks(store: Store, task: str, ranked: Standing) -> list[dict[str, Any]]:
    """Return the pairs of a task that matter, each with its last look: neighbours of the first three, leader and yardstick.

    Looks are at 200, 400 and 800 runs of suite A, each at a third of the level, with Holm's adjustment inside a look.
    """
    names = [one.solver for one, verdict in ranked if verdict.rank is not None]
    pairs = list(dict.fromkeys([*pairwise(names[:FIRST]), *([(names[0], suite.YARDSTICK)] if names else [])]))
    undecided = [pair for pair in pairs if pair[0] != pair[1]]
    last: dict[tuple[str, str], dict[str, Any]] = {}
    for runs in LOOKS:
        found = [(pair, look) for pair in undecided if (look := _look(store, task, pair, runs))]
        adjusted = exact.holm([look["p"] for _, look in found])
        for (pair, look), p in zip(found, adjusted, strict=True):
            low, high = look["ratio_ci"]
            equal = EQUAL[0] <= low and high <= EQUAL[1]
            look["verdict"] = "apart" if p <= LOOK_LEVEL else "equal" if equal else "open"
            last[pair] = look | {"p_adjusted": float(p)}
        undecided = [pair for pair, look in found if look["verdict"] == "open"]
    return list(last.values())


def _look(store: Store, task: str, pair: tuple[str, str], runs: int) -> dict[str, Any] | None:
    """Compare two solvers over the first ``runs`` runs of suite A; None if either has fewer."""
    one, other = results(store, [Portion(task, runs, pair)])
    if min(len(one.records), len(other.records)) < runs:
        return None
    mine, its = common(one.records, other.records)
    cap = one.measure.cap
    a, b = (losses.capped(r.entry.error[rows], cap) for r, rows in ((one, mine), (other, its)))
    return compared(task, pair, a, b)


def compared(task: str, pair: tuple[str, str], a: Array, b: Array) -> dict[str, Any]:
    """Return the ratio of two scores with its interval and its p value, from losses (R,) in the same runs."""
    ratio, ends = exact.ratio_by_flips(a, b, LOOK_LEVEL)
    names = {"task": task, "a": pair[0], "b": pair[1], "runs": len(a)}
    return {**names, "ratio": ratio, "ratio_ci": ends, "p": exact.sign_flips(a, b)}


# ---- the JSON ----


def as_data(store: Store) -> dict[str, Any]:
    """Return the board of the suite and its provenance; values that are unknown or infinite are null."""
    tasks: list[dict[str, Any]] = []
    entries: list[dict[str, Any]] = []
    pairs: list[dict[str, Any]] = []
    played: list[Portion] = []
    for task in suite.tasks():
        ranked = standing(store, task.name)
        if not ranked:
            continue
        leader = leader_of(ranked)
        confirming = suite.confirming(task.name, leader) if leader else None
        fresh = judged(results(store, [confirming])) if confirming else []
        played += [one for one in (*suite.first(), *suite.preliminary(), confirming) if one and one.task == task.name]
        tasks.append(_task(task, [one for one, _ in ranked], leader))
        entries += [
            _entry(one, verdict, name) for name, group in (("A", ranked), ("B", fresh)) for one, verdict in group
        ]
        pairs += looks(store, task.name, ranked)
    parts = {"tasks": tasks, "results": entries, "pairs": pairs}
    return {
        "scoring": SCORING,
        "provenance": _provenance(store, played),
        **{name: _plain(part) for name, part in parts.items()},
    }


def _task(task: EvaluationTask, group: Sequence[Results], leader: str | None) -> dict[str, Any]:
    first = next((one for one in group if one.bound), group[0])
    measure = first.measure
    return {
        "task": task.name,
        "what": task.what,
        "score": f"{quantity(headline(task), first.records.criteria.navigates).name} error"
        + (" at the end" if by_failures(task) else ""),
        "unit": "rad" if headline(task) == "azimuth" else "m/s" if headline(task).startswith("velocity") else "m",
        "cap": measure.cap,
        "bound": measure.bound,
        "bound_holds": measure.holds if math.isfinite(measure.bound) else None,
        "scored": first.summary.scored,
        "suites": {"A": suite_hash(task), "B": suite_hash(task, task.suite_seed + 1)},
        "leader": leader,
    }


def _entry(one: Results, verdict: Verdict, name: str) -> dict[str, Any]:
    s = one.summary
    nees = s.nees_of_all
    return {
        "task": one.task.name,
        "suite": name,
        "solver": one.solver,
        **vars(verdict),
        "nees": nees[-1].mean / s.nees_dof if nees else None,
        "cost": one.cost.ratio if one.cost else None,
    }


def _provenance(store: Store, played: Sequence[Portion]) -> dict[str, Any]:
    """Return which code made the runs, when, on which machines and with which packages, and what was adopted."""
    keys = [one.key for part in played for one in part.evaluations()]
    sessions = {one.id: one for key in keys for one in store.sessions(key)}
    started = sorted(one.started for one in sessions.values())
    adopted = sorted({(one.before, one.code, one.compared) for key in keys for one in adoptions(store, key)})
    return {
        "code": version.code_version(suite.YARDSTICK),
        "started": [started[0], started[-1]],
        "machines": sorted({one.machine for one in sessions.values()}),
        "versions": sessions[max(sessions)].versions,
        "adopted": [
            {"before": before, "compared": sum(n for b, c, n in adopted if (b, c) == (before, code))}
            for before, code in sorted({one[:2] for one in adopted})
        ],
    }


def _plain(value: Any) -> Any:
    """Return a value with its numbers in the form of JSON, to a few digits."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    if isinstance(value, (float, np.floating)) and math.isfinite(value):
        return float(f"{value:.{DIGITS}g}")
    return in_json(value)


def as_text(data: dict[str, Any]) -> str:
    """Return JSON with one line for each task, result and pair, so that differences between versions are readable."""
    parts = [f'"{name}": ' + json.dumps(data[name]) for name in ("scoring", "provenance")]
    parts += [
        f'"{name}": [\n' + ",\n".join(map(json.dumps, data[name])) + "\n]" for name in ("tasks", "results", "pairs")
    ]
    return "{\n" + ",\n".join(parts) + "\n}\n"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="the leaderboard of the default suite")
    parser.add_argument("--db", type=Path, default=ROOT / "leaderboard.sqlite", help="results file")
    parser.add_argument(
        "--task", nargs="+", default=[], choices=[task.name for task in suite.tasks()], help="run only these tasks"
    )
    parser.add_argument("--at-most", type=int, metavar="N", help="largest number of runs of each solver and task")
    parser.add_argument("--stages", type=int, choices=(1, 2, 3), default=3, help="last stage to play (default 3)")
    parser.add_argument("--workers", type=int, metavar="N", help="number of processes, default one per core")
    parser.add_argument("--no-runs", action="store_true", help="make no runs, take the file as it is")
    parser.add_argument("--costs", action="store_true", help="measure all costs again")
    parser.add_argument("--out", type=Path, metavar="DIRECTORY", help="where JSON and figures go, default this project")
    given = parser.parse_args(arguments)
    with Store(given.db) as store:
        if not given.no_runs:
            run(store, given.at_most, given.workers, given.task, given.stages)
        for task in suite.COSTED if given.costs else ():
            measure(store, task, anew=True)
        target = given.out / JSON.name if given.out else JSON
        data = as_data(store)
        write_text(target, as_text(data))
        remark(f"leaderboard: {target}")
        drawn = {name: of_task(store, name, whole=True) for name in story.TIMES}
        story.draw(data, drawn, given.out or ROOT / "docs")


if __name__ == "__main__":
    main()
