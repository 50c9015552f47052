"""Cost of every kernel beside a reference loop of the same run, and what fresh processes take until they have them.

    python benchmarks/kernels.py                      all of them, the dearest first
    python benchmarks/kernels.py strapdown feedback   those with these words in their names
    python benchmarks/kernels.py --processes          start-up, compilation and memory of fresh processes; takes minutes

The reference is a kernel too: a sum of 100 numbers, each multiplied once, which no processor can take in parts. A ratio to it
says more than a time, because a busy machine slows both. Inputs are those of tests/test_kernels.py.

The system tells the CPU time of a process, of which the least of five starts counts, and its largest memory. The evaluations have
256 runs over the first ten epochs; more epochs take no more memory than their records.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import solvers
from sins_env.arrays import Array
from sins_env.kernels import Kernel, kernel
from sins_env.kernels.compiling import FOLDER

assert solvers.names(), "imported before the tests, which have a folder of that name"
sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
from test_kernels import drawn, every_kernel  # noqa: E402 - what is tested is what is timed

RUNS = 256
SECONDS = 0.05  #: CPU time of one measurement, of which the least of five counts
STARTS = 5  #: number of starts of a process

CALL = "from solvers.pipeline.feedback import corrected; corrected([1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0])"
COMMAND = "from sins_env.cli.main import main; raise SystemExit(main())"
EVALUATION = """
import dataclasses, sys
from sins_env.evaluation import evaluate, get_task
task = get_task("sway-white-v0")
task = dataclasses.replace(task, name="short", kwargs={**task.kwargs, "duration": 10.0}, hold_s=5.0)
evaluate(task, sys.argv[1], 256, workers=1, cost=False)
"""
#: Starts a program without output and prints its CPU time and memory. It is small, since the system counts its memory too.
LAUNCHER = """
import os, sys
quiet = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
child = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=quiet)
_, status, usage = os.wait4(child, 0)
print(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 2**10)
sys.exit(os.waitstatus_to_exitcode(status))
"""


class Fresh(NamedTuple):
    """A process whose start is measured."""

    what: str
    code: str
    arguments: tuple[str, ...] = ()
    cold: bool = False  #: whether it finds no compiled kernels


PROCESSES = (
    Fresh("python", "pass"),
    Fresh("import numpy", "import numpy"),
    Fresh("import solvers", "import solvers"),
    Fresh("sins-env --help", COMMAND, ("--help",)),
    Fresh("first call of a kernel, compiled before", CALL),
    Fresh("first call of a kernel, not compiled", CALL, cold=True),
    Fresh("sins-env warm, all compiled before", COMMAND, ("warm",)),
    Fresh("sins-env warm, nothing compiled", COMMAND, ("warm",), cold=True),
    *(Fresh(f"evaluation of {name}, 256 runs", EVALUATION, (name,)) for name in ("ckf", "gsf_imm", "pf")),
)


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


def started(one: Fresh) -> tuple[float, float]:
    """Run a process, and return its CPU time in s and its largest memory in MiB.

    Raises:
        SystemExit: it fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", **({FOLDER: folder} if one.cold else {})}
        line = [sys.executable, "-c", LAUNCHER, sys.executable, "-c", one.code, *one.arguments]
        done = subprocess.run(line, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise SystemExit(f"{one.what} ended with {done.returncode}: {done.stderr}")
    cpu, memory = map(float, done.stdout.split())
    return cpu, memory


def processes(which: Sequence[Fresh]) -> None:
    """Print the table of fresh processes."""
    print(f"{'a fresh process':44} {'CPU s':>8} {'MiB':>8}", flush=True)
    for one in which:
        long = one.cold or one.code == EVALUATION
        cpu, memory = (min(each) for each in zip(*(started(one) for _ in range(1 if long else STARTS)), strict=True))
        print(f"{one.what:44} {cpu:8.3f} {memory:8.0f}", flush=True)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table of kernels, or that of processes."""
    parser = argparse.ArgumentParser(description="cost of every kernel beside a reference loop")
    parser.add_argument("word", nargs="*", help="words in the names of kernels, or of processes (default: all)")
    parser.add_argument("--seconds", type=float, default=SECONDS, help=f"of each measurement (default {SECONDS})")
    parser.add_argument("--processes", action="store_true", help="start-up and memory of fresh processes instead")
    given = parser.parse_args(argv)
    names: dict[str, Any] = (
        {one.what: one for one in PROCESSES}
        if given.processes
        else {f"{one.__module__}.{one.__qualname__}": one for one in every_kernel()}
    )
    chosen = {name: one for name, one in names.items() if not given.word or any(word in name for word in given.word)}
    if not chosen:
        kind = "process" if given.processes else "kernel"
        parser.error(f"no {kind} has {' or '.join(given.word)} in its name; there are: {', '.join(names)}")
    if given.processes:
        processes(list(chosen.values()))
        return
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
