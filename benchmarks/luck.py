"""How far a published figure depends on the suite seed: the old one, the RMS over the bound, beside the score over the bound.

    python benchmarks/luck.py                               ckf on sway-jump-v0, five suites of 200 runs
    python benchmarks/luck.py --task sway-white-v0 --solver ekf --seeds 1 2 3 --runs 100

A few runs in a hundred are lost for good on sway-jump-v0. The RMS is what the worst of them is, so that its interval holds for no
other suite. The score counts no run beyond the threshold of alignment. The exit code is 1 if a score's interval misses the score
of all suites together. On the five suites of 200 runs, the RMS of ckf is 8 to 61 times the bound. Its score is 1.79 to 1.99
times, and every interval holds the common 1.87.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from sins_env.evaluation import evaluate
from sins_env.evaluation.bound import oracle
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.score import exact
from sins_env.evaluation.score.resampling import Estimate, rms_interval
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.tasks.catalogue import get_task

SEEDS = (0, 1, 2, 70001, 81001)


class Suite(NamedTuple):
    """Figures of a solver on one suite."""

    seed: int
    failed: int
    runs: int
    old: Estimate  #: RMS over the bound with its BCa interval
    new: Estimate  #: score over the bound, adjusted by the oracle


def figures(results: Results, seed: int) -> Suite:
    """Return the figures of a solver with the runs of a suite."""
    seen = oracle.compute(results.task, len(results.records), seed)
    assert seen is not None
    results = replace(results, oracle=seen.records)
    entry, bound, verdict = results.entry, results.measure.bound, results.verdict
    value, ends = rms_interval(entry.error)
    old = value / bound, (ends[0] / bound, ends[1] / bound)
    return Suite(seed, verdict.failures, verdict.runs, old, (verdict.x_bound, verdict.x_bound_ci))


def table_of(suites: Sequence[Suite], together: float) -> Table:
    """Return the table with a row for each suite."""
    table = Table(title=f"all suites together: score {together:.3f} x bound")
    for name in ("suite seed", "failed", "RMS x bound [BCa]", "score x bound", "agrees"):
        table.add_column(name, justify="right")
    for one in suites:
        low, high = exact.share(one.failed, one.runs)[1]
        failed = f"{one.failed} of {one.runs} [{100 * low:.1f}, {100 * high:.1f} %]"
        table.add_row(f"{one.seed}", failed, _told(one.old), _told(one.new), "yes" if _holds(one, together) else "no")
    return table


def _told(estimate: Estimate) -> str:
    value, (low, high) = estimate
    return f"{value:.3g} [{low:.3g}, {high:.3g}]"


def _holds(one: Suite, together: float) -> bool:
    low, high = one.new[1]
    return low <= together <= high


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="how far a figure depends on the suite seed")
    parser.add_argument("--task", default="sway-jump-v0", help="an alignment task with a bound (default %(default)s)")
    parser.add_argument("--solver", default="ckf", help="default %(default)s")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS, help="suite seeds (default %(default)s)")
    parser.add_argument("--runs", type=int, default=200, help="runs of each suite (default %(default)s)")
    given = parser.parse_args(arguments)
    suites = []
    for seed in given.seeds:
        with Bar(f"{given.solver} on {given.task}, seed {seed}") as bar:
            task = get_task(given.task)
            results = evaluate(task, given.solver, given.runs, seed, cost=False, progress=bar.update)
        suites.append(figures(results, seed))
    together = math.sqrt(float(np.mean([one.new[0] ** 2 for one in suites])))
    Console().print(table_of(suites, together))
    return 0 if all(_holds(one, together) for one in suites) else 1


if __name__ == "__main__":
    sys.exit(main())
