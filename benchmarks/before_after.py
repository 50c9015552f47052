"""Speed of this checkout beside that of another revision, interleaved in one run.

    python benchmarks/before_after.py defac41                       the rows of the table of goals
    python benchmarks/before_after.py main~3 --row ckf --repeats 9  some rows, by a part of their names

Each revision has a process of its own in one environment, a worktree of Git on its path. The processes take turns, block by
block, so that both see the same machine. Times are CPU times. A ratio is the median over the repeats of before / after, with the
smallest and the largest. Only public names are used that every
revision has: ``get_task``, ``evaluate`` and ``solvers.make``.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
REPEATS = 7
SECONDS = 0.4  #: CPU time of a block in the slower revision, about


class Row(NamedTuple):
    """One line of the table: what is timed, and the ratio that is wanted."""

    name: str
    part: str  #: "chain", "estimator" or "eval"
    solver: str
    runs: int
    goal: float
    task: str = "sway-white-v0"


ROWS = (
    Row("chain ckf, 1 run", "chain", "ckf", 1, 3.5),
    Row("chain ckf, 256 runs", "chain", "ckf", 256, 2.1),
    Row("estimator ckf, 1 run", "estimator", "ckf", 1, 4.5),
    Row("estimator ckf, 256 runs", "estimator", "ckf", 256, 3.0),
    Row("chain kf, 1 run", "chain", "kf", 1, 2.5),
    Row("chain kf, 256 runs", "chain", "kf", 256, 2.0),
    *(Row(f"chain {name}, 1 run", "chain", name, 1, 2.0) for name in ("gpf", "pf", "upf", "hepf")),
    *(Row(f"chain {name}, 64 runs", "chain", name, 64, 2.0) for name in ("gpf", "pf", "upf", "hepf")),
    Row("ekf flight, 64 runs", "chain", "ekf", 64, 2.0, "flight-lu-gauss-v0"),
    Row("inekf flight, 64 runs", "chain", "inekf", 64, 2.0, "flight-lu-gauss-v0"),
    Row("gsf_ekf hot start, 64 runs", "chain", "gsf_ekf", 64, 2.0, "flight-hotstart30-v0"),
    Row("eval of 4 filters, 100 runs", "eval", "kf ekf ukf ckf", 100, 2.2),
)

#: Program of a process. It reads a row and a number of epochs as a line of JSON, and writes CPU seconds per epoch.
_WORKER = """
import json, sys, time
import numpy as np
import sins_env, solvers
from sins_env.evaluation import evaluate, get_task
from sins_env.memory import keep_freed_memory  # as every revision knows it
keep_freed_memory()  # as in an evaluation
assert sins_env.__file__.startswith(sys.argv[1]), sins_env.__file__

def start(row):
    task, runs = get_task(row["task"]), row["runs"]
    env = task.make(runs)
    obs, _ = task.reset(env, tuple(range(runs)))
    solver, told = solvers.make(row["solver"]), env.unwrapped.task
    solver.reset(told, [np.random.default_rng([7, i]) for i in range(runs)], runs)
    state = [env, solver, obs, told.num_epochs]
    play(state, round(told.coarse_s / told.epoch_s) + 5)
    return state

def made(name):
    "A function of this program: entry points of an installed package would be those of another revision."
    def solver(**settings):
        return solvers.make(name, **settings)
    solver.__qualname__ = solver.__name__ = name
    globals()[name] = solver
    return solver

def play(state, epochs):
    env, solver, obs, left = state
    spent = 0.0
    for _ in range(epochs):
        before = time.process_time()
        action = solver.step(obs)
        spent += time.process_time() - before
        obs = env.step(action)[0]
    state[2], state[3] = obs, left - epochs
    return spent

key = None
for line in sys.stdin:
    row, epochs = json.loads(line)
    if row["part"] == "eval":
        before = time.process_time()
        for name in row["solver"].split():
            evaluate(row["task"], made(name), epochs, workers=1, cost=False)
        print((time.process_time() - before) / epochs, flush=True)
        continue
    if key != row or state[3] < epochs:
        state, key = start(row), row
    epochs = min(epochs, state[3])
    before = time.process_time()
    spent = play(state, epochs)
    whole = time.process_time() - before
    print((whole if row["part"] == "chain" else spent) / epochs, flush=True)
"""


class Revision:
    """A process that times the code of one folder."""

    def __init__(self, folder: Path) -> None:
        paths = {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
        self._process = subprocess.Popen(
            [sys.executable, "-c", _WORKER, str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, **paths},
        )

    def time(self, row: Row, epochs: int) -> float:
        """Return CPU seconds per epoch, or of an evaluation per run.

        Raises:
            RuntimeError: the process has ended, and has told why on standard error.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps([row._asdict(), epochs]), file=self._process.stdin, flush=True)
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"{row.name}: the process of a revision ended with code {self._process.wait()}")
        return float(line)

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


@contextmanager
def worktree(revision: str) -> Iterator[Path]:
    """Yield a folder with the code of a revision, which goes with the context.

    Raises:
        ValueError: no such revision.
    """
    git = ["git", "-C", str(ROOT), "worktree"]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "before"
        done = subprocess.run(
            [*git, "add", "--detach", str(folder), revision], capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise ValueError(f"revision {revision}: {done.stderr.strip().splitlines()[-1]}")
        try:
            yield folder
        finally:
            subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def measure(row: Row, before: Revision, after: Revision, repeats: int) -> tuple[list[float], list[float]]:
    """Return the times of both revisions, taken in turns, s."""
    if row.part == "eval":
        epochs = row.runs
    else:
        once = before.time(row, 3)
        after.time(row, 3)
        epochs = min(max(round(SECONDS / once), 5), 300)
    pairs = []
    for i in range(min(repeats, 3) if row.part == "eval" else repeats):  # an evaluation takes a minute
        first, second = (before, after) if i % 2 else (after, before)
        one, other = first.time(row, epochs), second.time(row, epochs)
        pairs.append((one, other) if first is before else (other, one))
    old, new = zip(*pairs, strict=True)
    return list(old), list(new)


def line(row: Row, old: Sequence[float], new: Sequence[float]) -> str:
    """Return a line of the table, with times in microseconds per run and epoch; of an evaluation in ms per run."""
    per = 1e3 if row.part == "eval" else 1e6 / row.runs
    ratios = sorted(a / b for a, b in zip(old, new, strict=True))
    times = f"{per * statistics.median(old):10.2f} {per * statistics.median(new):9.2f}"
    return f"{row.name:28}{times}   {statistics.median(ratios):5.2f}  {ratios[0]:5.2f} - {ratios[-1]:5.2f}   {row.goal:5.1f}"


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="speed of this checkout beside that of another revision")
    parser.add_argument("revision", help="of Git, such as defac41")
    parser.add_argument("--row", nargs="+", default=[""], help="parts of the names of rows (default: all)")
    parser.add_argument("--repeats", type=int, default=REPEATS)
    given = parser.parse_args(argv)
    rows = [row for row in ROWS if any(part in row.name for part in given.row)]
    if not rows:
        names = "; ".join(row.name for row in ROWS)
        parser.error(f"no row has {' or '.join(given.row)} in its name; there are: {names}")
    with ExitStack() as stack:
        folder = stack.enter_context(worktree(given.revision))
        before, after = (stack.enter_context(closing(Revision(place))) for place in (folder, ROOT))
        print(f"{given.revision} and {ROOT}: CPU time, one thread, {given.repeats} repeats in turns")
        print(f"{'':28}{'before us':>10} {'after us':>9}   ratio  least - most    goal", flush=True)
        for row in rows:
            print(line(row, *measure(row, before, after, given.repeats)), flush=True)


if __name__ == "__main__":
    main()
