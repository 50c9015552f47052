"""Cost of every kernel, alone and in a batch, beside a reference loop of the same run.

    python benchmarks/kernels.py                      all of them, the dearest first
    python benchmarks/kernels.py strapdown feedback   those with these words in their names

The reference is a kernel too: a sum of 100 numbers, each multiplied once, which no processor can take in parts. A ratio to it
says more than a time, because a busy machine slows both. Inputs are those of tests/test_kernels.py.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import solvers
from sins_env.arrays import Array
from sins_env.kernels import Kernel, kernel

assert solvers.names(), "imported before the tests, which have a folder of that name"
sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from test_kernels import drawn, every_kernel  # noqa: E402 - what is tested is what is timed

RUNS = 256
SECONDS = 0.05  #: CPU time of one measurement, of which the least of five counts


@kernel("(n)->()")
def reference(x: Array, out: Array) -> None:
    """Return a sum in which every step waits for the one before."""
    total = 0.0
    for i in range(len(x)):
        total = 0.5 * total + x[i]
    out[0] = total


def cost(one: Kernel, inputs: Sequence[Any], seconds: float) -> float:
    """Return the least CPU time of a call, s."""
    one(*inputs)
    calls, spent, least = 1, 0.0, np.inf
    for _ in range(5):
        while True:
            begin = time.process_time()
            for _ in range(calls):
                one(*inputs)
            spent = time.process_time() - begin
            if spent > 0.5 * seconds:
                break
            calls *= 2
        least = min(least, spent / calls)
    return float(least)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="cost of every kernel beside a reference loop")
    parser.add_argument("word", nargs="*", help="words in the names of kernels (default: all)")
    parser.add_argument("--seconds", type=float, default=SECONDS, help=f"of each measurement (default {SECONDS})")
    given = parser.parse_args(argv)
    names = {f"{one.__module__}.{one.__qualname__}": one for one in every_kernel()}
    chosen = {name: one for name, one in names.items() if not given.word or any(word in name for word in given.word)}
    if not chosen:
        parser.error(f"no kernel has {' or '.join(given.word)} in its name; there are: {', '.join(names)}")
    lines = []
    with np.errstate(all="ignore"):
        for name, one in chosen.items():
            batch = list(drawn(one, RUNS))
            alone = [a[0] for a in batch]
            unit = cost(reference, [np.ones((RUNS, 100))], given.seconds) / RUNS  # beside each, as the machine changes
            lines.append((cost(one, batch, given.seconds) / RUNS / unit, cost(one, alone, given.seconds), unit, name))
    print(f"{'kernel':52} {'1 run us':>9} {f'{RUNS} runs us':>13} {'/ reference':>12}")
    for ratio, once, unit, name in sorted(lines, reverse=True):
        print(f"{name:52} {1e6 * once:9.2f} {1e6 * ratio * unit:13.3f} {ratio:12.2f}")


if __name__ == "__main__":
    main()
