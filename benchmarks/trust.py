"""How often the board's statistics are wrong, simulated on the product's own path (verdicts.py).

    python benchmarks/trust.py                 both tables of docs/tasks_and_scores.md, 70 s of CPU
    python benchmarks/trust.py --part 0.1      a tenth of the samples, to see that it works

The first table has the misses of the 95 % interval of the score, for errors of several laws. The second has boards of ten solvers
of one law, whose errors share 90 % of their variance: every win, loss and rank above one is false there.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.score import losses
from sins_env.evaluation.score.verdicts import Entry, Measure, Verdict, judge

CAP = 3.18  #: cap in standard deviations of the body, as on sway-white-v0
SAMPLES, BOARDS, SOLVERS, RUNS = 2000, 400, 10, 200
SHARED = 0.9  #: correlation of the errors of two solvers
SEED = 20110607
TOGETHER = 250  #: number of samples that are resampled together, limited by memory

#: How errors of each law come from standard normal ones, with a generator for the rest. That of Student-t has unit variance.
LAWS: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "Gaussian": lambda x, rng: x,
    "Student-t, 3 degrees of freedom": lambda x, rng: x / np.sqrt(rng.chisquare(3, x.shape)),
    "1 % of runs at 20 times": lambda x, rng: x * np.where(rng.random(x.shape) < 0.01, 20.0, 1.0),
    "3 % of runs at 1000 times": lambda x, rng: x * np.where(rng.random(x.shape) < 0.03, 1000.0, 1.0),
}


def misses(law: str, runs: int, samples: int) -> tuple[float, float]:
    """Return how often the interval of the score lies below, and above, the true score of a law."""
    rng = np.random.default_rng([SEED, runs, *law.encode()])
    true = math.sqrt(losses.capped(LAWS[law](rng.normal(size=4_000_000), rng), CAP).mean())
    low = high = 0
    for first in range(0, samples, TOGETHER):
        shape = runs, min(TOGETHER, samples - first)
        for found in losses.scores(losses.capped(LAWS[law](rng.normal(size=shape), rng), CAP)):
            ends = found.interval()
            low, high = low + (ends[1] < true), high + (ends[0] > true)
    return low / samples, high / samples


def boards(law: str, count: int) -> Iterator[list[Verdict]]:
    """Yield the verdicts of boards of equal solvers."""
    rng = np.random.default_rng([SEED, *law.encode()])
    for _ in range(count):
        x = math.sqrt(SHARED) * rng.normal(size=(RUNS, 1)) + math.sqrt(1 - SHARED) * rng.normal(size=(RUNS, SOLVERS))
        errors = np.abs(LAWS[law](x, rng))
        lost = errors > 3.0 * CAP
        times = np.where(lost, math.inf, 100.0)
        entries = [Entry(np.arange(RUNS), e, f, t) for e, f, t in zip(errors.T, lost.T, times.T, strict=True)]
        yield judge(entries, Measure(CAP, 1.0), yardstick=0)


def false_verdicts(law: str, count: int) -> tuple[float, float, float, float]:
    """Return the shares of boards with a false win or loss, by adjusted and by plain p, with a false rank, and without the best.

    Any of equal solvers may stand for the best; it is the second, which is no yardstick.
    """
    found = np.zeros(4)
    for board in boards(law, count):
        words = any(one.word in ("wins", "loses") for one in board)
        plain = any(one.p is not None and one.p <= 0.05 for one in board)
        found += words, plain, any(one.rank != 1 for one in board), board[1].rank != 1
    return tuple(found / count)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="how often the statistics of the board are wrong")
    parser.add_argument("--part", type=float, default=1.0, help="part of the samples, 0 to 1 (default %(default)s)")
    part, begin = parser.parse_args(arguments).part, time.process_time()
    samples, count = round(part * SAMPLES), round(part * BOARDS)
    print("| law | 100 runs, low + high | 200 runs, low + high |\n|---|---|---|")
    for law in LAWS:
        cells = [misses(law, runs, samples) for runs in (100, 200)]
        print(
            f"| {law} | " + " | ".join(f"{100 * (a + b):.1f} = {100 * a:.1f} + {100 * b:.1f}" for a, b in cells) + " |"
        )
    heads = "law", "false win or loss", "without Holm", "a rank above 1", "a given one of the best not in rank 1"
    print(f"\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for law in LAWS:
        print(f"| {law} | " + " | ".join(f"{100 * one:.1f} %" for one in false_verdicts(law, count)) + " |", flush=True)
    print(f"\n{time.process_time() - begin:.0f} s of CPU, {samples} samples, {count} boards")


if __name__ == "__main__":
    main()
