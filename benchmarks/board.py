"""Time of ``sins-env board`` on a large results file: 40 solvers on 5 tasks, 1000 runs each.

    python benchmarks/board.py                        makes the file in a temporary directory, then three boards
    python benchmarks/board.py --keep large.sqlite    keeps it, for profiles

Scores are random numbers and not played. What is timed is reading, statistics and printing, which should take less than 2 s
on a quiet core.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.rows import criteria_json
from sins_env.evaluation.store.schema import RUN_COLUMNS
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import get_task

TASKS = ("sway-white-v0", "sway-markov-v0", "sway-told-wrong-v0", "sway-jump-v0", "sway-heavytail-v0")
BOARD = [sys.executable, "-c", "from sins_env.cli.main import main; raise SystemExit(main())", "board", "--db"]


def make_file(path: Path, tasks: Sequence[str] = TASKS, solvers: int = 40, runs: int = 1000) -> None:
    """Write a results file whose solvers differ by a per cent each, on common runs."""
    rng = np.random.default_rng(0)
    sql = f"INSERT INTO runs ({', '.join(RUN_COLUMNS)}) VALUES ({', '.join('?' * len(RUN_COLUMNS))})"
    with Store(path) as store:
        db = store.connection
        db.execute("BEGIN")
        for name in tasks:
            task = get_task(name)
            criteria = criteria_json(Criteria.of(task, task.make(1).unwrapped.task))  # type: ignore[attr-defined]
            db.execute("INSERT INTO tasks (task, criteria) VALUES (?, ?)", (name, criteria))
            shared = rng.normal(0, 4e-3, (runs, 1))
            for i in range(solvers):
                key = Key.of(name, "s", f"solver{i}", {}, "1")
                errors = (1 + 0.01 * i) * shared * (1 + 0.1 * rng.normal(size=(runs, 1))) * np.array([0.03, 0.03, 1.0])
                times = rng.uniform(50, 250, (runs, 3))
                rest = [np.abs(errors)] * 4 + [errors, np.zeros((runs, 2)), rng.chisquare(3, (runs, 4))]
                rows = np.hstack([times, *rest]).tolist()
                head = (*key.values,)
                db.executemany(sql, [(*head, r, "{}", 1, "ok", "", "", 0, 0, *row) for r, row in enumerate(rows)])
        db.execute("COMMIT")
        db.execute("INSERT INTO histories SELECT id, randomblob(100) FROM runs")
        for name in tasks:
            store.add_task(get_task(name))


def time_board(path: Path) -> tuple[str, float, float]:
    """Run ``sins-env board``, and return what it prints with the wall time and CPU time of the whole process, s."""
    environment = {**os.environ, "COLUMNS": "120", "OPENBLAS_NUM_THREADS": "1"}
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([*BOARD, str(path)], capture_output=True, text=True, env=environment, check=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.stdout, wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description="speed of the board")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="the results file, made if it does not exist")
    parser.add_argument("--times", type=int, default=3, metavar="N", help="number of boards, default 3")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        path = given.keep or Path(directory) / "large.sqlite"
        if not path.exists():
            make_file(path)
        for _ in range(given.times):
            _, wall, cpu = time_board(path)
            print(f"wall {wall:.2f} s, CPU {cpu:.2f} s")


if __name__ == "__main__":
    main()
