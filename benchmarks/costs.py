"""Cost of a step of every filter, beside that of ckf, on the alignment problem: one process, one thread.

    python benchmarks/costs.py                                  every filter, at 1 and 256 runs
    python benchmarks/costs.py ckf ckf5 ddf2 --runs 1 64 1024   some, at other batch sizes
    python benchmarks/costs.py --chain gsf_imm imm_ekf          whole estimators from switch-on: INS, filter and feedback

Epochs of the swaying base, with 10 states and a fix of two velocities each, are recorded once and played to every filter. Only
the step is timed, without simulator and strapdown. Blocks of the filter alternate with blocks of ckf. The ratio is the median
over such pairs of CPU times, so that a busy machine changes it little. Each filter gets the same time, and at least one block.

Whole estimators play the task instead, from its first epoch on. A bank costs most there, so the first 30 s and the next 90 s
stand apart from the 60 s after them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from contextlib import closing
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

import solvers
from sins_env.checks import unknown
from sins_env.evaluation.estimators.isolation import Here
from sins_env.evaluation.estimators.memory import keep_freed_memory
from sins_env.evaluation.speed.timing import Probe
from sins_env.evaluation.tasks.catalogue import get_task
from solvers.filters import FILTERS, make_filter, names
from solvers.pipeline.estimator import Aligner
from solvers.types import Gaussian, Measurement, Transition

YARDSTICK = "ckf"
EPOCHS = 100  #: number of recorded epochs, after which a filter starts again
BLOCK_S = 5e-3  #: s, CPU time that a block should take
CHAIN_S, CHAIN_BLOCK = (30.0, 90.0, 60.0), 20  #: parts of the time for whole estimators, and epochs in a block


class Recorder:
    """A filter that keeps the transitions and fixes that it is given, and estimates nothing."""

    def __init__(self, runs: int) -> None:
        self.runs, self.batched = runs, runs > 1
        self.epochs: list[tuple[Transition, Measurement | None]] = []
        self._filter = make_filter(YARDSTICK)

    def init(self, prior: Gaussian, rng: Any) -> Any:
        self.prior = prior
        return self._filter.init(prior, rng)

    def step(self, b: Any, tr: Transition, me: Measurement | None) -> tuple[Any, None]:
        self.epochs.append((tr, me))
        return b, None

    def estimate(self, b: Any) -> Gaussian:
        return self._filter.estimate(b)


def record(task: str, runs: int) -> Recorder:
    """Record the transitions and fixes of the first epochs of a task, with the INS open loop; one run has no run axis."""
    recorder = Recorder(runs)
    probe = Probe(get_task(task), Here(lambda: Aligner(recorder, feedback="open")), runs, warm_up=EPOCHS)
    probe.close()
    return recorder


class Player:
    """A filter that goes through the recorded epochs again and again, each time from the prior."""

    def __init__(self, name: str, recorded: Recorder) -> None:
        self.filter, self.recorded, self.k = make_filter(name), recorded, 0
        self.advance(3)  # caches fill
        self.block = max(1, min(EPOCHS, round(BLOCK_S / self.advance(1))))

    def advance(self, epochs: int) -> float:
        """Take some steps, and return the CPU seconds per step."""
        spent = 0.0
        for _ in range(epochs):
            if self.k % len(self.recorded.epochs) == 0:
                rng, runs = np.random.default_rng(0), self.recorded.runs
                self.belief = self.filter.init(self.recorded.prior, rng.spawn(runs) if runs > 1 else rng)
            transition, fix = self.recorded.epochs[self.k % len(self.recorded.epochs)]
            begin = time.process_time()
            self.belief, _ = self.filter.step(self.belief, transition, fix)
            spent += time.process_time() - begin
            self.k += 1
        return spent / epochs


class Cost(NamedTuple):
    """Cost of one filter at one batch size."""

    step_us: float  #: CPU time of a step, per run
    ratio: float  #: this time over that of ckf
    pairs: int  #: number of pairs of blocks


def cost(name: str, recorded: Recorder, seconds: float) -> Cost:
    """Measure a filter for about ``seconds``; the first steps and one pair of blocks are always taken."""
    begin = time.perf_counter()
    own, yardstick = Player(name, recorded), Player(YARDSTICK, recorded)
    pairs = []
    while not pairs or time.perf_counter() - begin < seconds:
        pairs.append((own.advance(own.block), yardstick.advance(yardstick.block)))
    each = np.array(pairs)
    return Cost(
        1e6 * float(np.median(each[:, 0])) / recorded.runs, float(np.median(each[:, 0] / each[:, 1])), len(each)
    )


def cell(name: str, recorded: Recorder, seconds: float) -> tuple[str, str]:
    """Return time and ratio as text, or why there are none."""
    if recorded.runs > 1 and not FILTERS[name].batched:
        return "one run only", ""
    try:
        found = cost(name, recorded, seconds)
    except Exception as error:  # one filter that fails must not hide the others
        return f"[red]{type(error).__name__}: {str(error)[:40]}[/]", ""
    few = " *" if found.pairs < 5 else ""
    return f"{found.step_us:.4g}", f"{found.ratio:.3g}{few}"


def chain(name: str, task: str, runs: int) -> list[Cost]:
    """Measure a whole estimator in each of the parts CHAIN_S of the time from switch-on."""

    def probe(name: str) -> Probe:
        return Probe(get_task(task), Here(lambda: solvers.make(name)), runs, 0, time.process_time)

    for first in (name, YARDSTICK):
        with closing(probe(first)) as warm:
            warm.advance(CHAIN_BLOCK)  # kernels are loaded
    with closing(probe(name)) as own, closing(probe(YARDSTICK)) as yardstick:
        found = []
        for seconds in CHAIN_S:
            blocks = range(round(seconds / own.epoch_s) // CHAIN_BLOCK)
            each = np.array([[one.advance(CHAIN_BLOCK)[0].mean() for one in (own, yardstick)] for _ in blocks])
            own_s, yardstick_s = each.mean(axis=0)  # the bank shrinks on the way, so that means count, and not medians
            found.append(Cost(1e6 * float(own_s) / runs, float(own_s / yardstick_s), len(each)))
    return found


def chains(names: Sequence[str], task: str, batches: Sequence[int]) -> Table:
    """Return the table of whole estimators."""
    parts = ", ".join(f"{seconds:g}" for seconds in CHAIN_S)
    title = f"CPU time of a step of the whole estimator on {task}, us per run and over ckf, in successive {parts} s"
    table = Table("estimator", title=title)
    for runs in batches:
        table.add_column(f"{runs} run{'s' * (runs > 1)}", justify="right")
    for name in names:
        costs = [chain(name, task, runs) for runs in batches]
        table.add_row(name, *(", ".join(f"{one.step_us:.3g} ({one.ratio:.2g})" for one in row) for row in costs))
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="cost of a step of every filter, beside that of ckf")
    parser.add_argument("filters", nargs="*", help="names, default all")
    parser.add_argument("--runs", nargs="+", type=int, default=[1, 256], help="batch sizes")
    parser.add_argument("--seconds", type=float, default=1.0, help="time for each filter and batch size")
    parser.add_argument("--task", default="sway-white-v0", help="task that is recorded, default %(default)s")
    parser.add_argument("--chain", action="store_true", help="whole estimators, by names of solvers.make")
    given = parser.parse_args(arguments)
    keep_freed_memory()
    if given.chain:
        with threadpool_limits(1):
            Console(width=160).print(chains(given.filters or solvers.names(), given.task, given.runs))
        return
    for name in given.filters:
        if name not in FILTERS:
            parser.error(str(unknown("filter", name, FILTERS)))
    table = Table(title=f"CPU time of a step on {given.task}, one thread; * fewer than five pairs of blocks")
    table.add_column("filter")
    with threadpool_limits(1):
        recordings = [record(given.task, runs) for runs in given.runs]
        for recorded in recordings:
            table.add_column(f"{recorded.runs} run{'s' * (recorded.runs > 1)}, us per run", justify="right")
            table.add_column("/ ckf", justify="right")
        for name in given.filters or names():
            table.add_row(name, *(text for recorded in recordings for text in cell(name, recorded, given.seconds)))
    Console().print(table)


if __name__ == "__main__":
    main()
