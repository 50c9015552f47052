"""Cost of isolation: ckf as a stranger's solver, in a process of its own, against ckf in the process of the evaluation.

    python benchmarks/isolation.py [RUNS ...]

Both play the same runs in blocks that alternate. An epoch of the whole chain is a step of the environment and one of the
estimator for all runs together. Its time is CPU time, user and system: of this process, and for the stranger also of its
solver's process, by the kernel's clock. The keeper and the starter sleep meanwhile and are not counted, neither is the start.
While the two processes run one after the other on one core, the elapsed time grows by as much. What is printed is the median
over blocks. Most of the cost is not work: after each change of the process its pages are looked up anew. A virtual machine
therefore pays more than a real one, and a busy machine more than a quiet one.
"""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack, closing

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.evaluation.estimators.child import Child
from sins_env.evaluation.estimators.isolation import hosted
from sins_env.evaluation.estimators.memory import keep_freed_memory
from sins_env.evaluation.speed.timing import Probe
from sins_env.evaluation.tasks.catalogue import get_task

TASK, BLOCK, BLOCKS = "sway-white-v0", 20, 40
SOLVERS = ("ckf", "solvers.zoo:ckf")  #: the second is a stranger's by its name


def measure(runs: int) -> tuple[float, float]:
    """Return the CPU time of the whole chain per epoch, s, for the own solver and for the stranger's: medians over blocks."""
    task, spent = get_task(TASK), np.empty((BLOCKS, len(SOLVERS)))
    keep_freed_memory()
    with threadpool_limits(1), ExitStack() as stack:
        probes = []
        for solver in SOLVERS:
            host = stack.enter_context(hosted(solver, {}))
            probes.append((stack.enter_context(closing(Probe(task, host, runs))), getattr(host, "child", None)))
        for block in spent:
            for i, (probe, child) in enumerate(probes):
                before = _cpu_s(child)
                probe.advance(BLOCK)
                block[i] = (_cpu_s(child) - before) / BLOCK
    here, apart = np.median(spent, axis=0)
    return float(here), float(apart)


def _cpu_s(child: Child | None) -> float:
    return time.process_time() + (child.cpu_s() if child else 0.0)


def main() -> None:
    """Print a line for each number of runs."""
    for runs in [int(text) for text in sys.argv[1:]] or [1, 64, 256]:
        here, apart = measure(runs)
        print(f"{runs:4d} runs: {here * 1e6:6.0f} us an epoch here, {apart * 1e6:6.0f} apart: {apart / here - 1:+.1%}")


if __name__ == "__main__":
    main()
