"""Robustness: kills, Ctrl-C, full disks and lost files, at random moments, and what must be left afterwards.

    python benchmarks/robustness.py                                  the whole campaign: a quarter of an hour of CPU time
    python benchmarks/robustness.py --kind parent export --times 5   some kinds, some times each
    python benchmarks/robustness.py --seed 7                         other moments

Every trial runs a command of ``sins-env`` in a process of its own and disturbs it at a moment drawn from the seed. Then the same
command runs again, undisturbed. It must give the table, the export or the page of a command that nobody disturbed. No row may be
lost or doubled, the SQLite file must be whole, and no process and no temporary file may be left. A command that ends early says
why in one line, without a traceback. The exit code is 1 if any trial failed.

The trials need Linux (they look for processes in /proc). Full disks are small tmpfs mounts for root, else limits of file size.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.show import plain_tables
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.store.verify import compare_runs

ROOT = Path(__file__).resolve().parents[1]
OLD = ROOT / "tests" / "evaluation" / "store" / "data" / "version010.sql"
#: What root gives up in trials without permission: prctl's PR_CAPBSET_DROP of CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH.
DROP, OVERRIDES = 24, (1, 2)
MARK = "SINS_ENV_CAMPAIGN"  #: environment variable by which the processes of a trial are known
LONG_S = 300.0  #: s, after which a command counts as hanging; the machine may be busy

#: The command line, with a task of 10 s for trials that play runs, and one of 20 s, of which version 0.1.0 made runs.
COMMAND = """
import dataclasses, sys
from sins_env.cli.interrupts import quiet
from sins_env.cli.main import main
if __name__ == "__main__":
    with quiet():
        from sins_env.evaluation.tasks.catalogue import TASKS
    long = TASKS["sway-white-v0"]
    for name, seconds in ("brief-v0", 10.0), ("short-v0", 20.0):
        kwargs = {**long.kwargs, "duration": seconds}
        TASKS[name] = dataclasses.replace(long, name=name, kwargs=kwargs, hold_s=seconds / 4)
    sys.exit(main())
"""
#: A solver of a stranger, ``mine:Mine``, which plays in a process of its own.
STRANGER = """
import numpy as np

class Mine:
    batched = True

    def reset(self, task, rng, num_runs=1):
        self.q = task.start.q_nb

    def step(self, obs):
        return self.q

    def covariance(self):
        return np.broadcast_to(np.eye(3), (*self.q.shape[:-1], 3, 3))
"""
SCRIPT = Path(sys.executable).parent / "sins-env"


@dataclass
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str


@dataclass
class Trials:
    """A folder for the files of trials, with what undisturbed commands gave."""

    folder: Path
    runs: int = 6
    solvers: tuple[str, ...] = ("kf", "ckf")
    workers: int = 2
    copies: int = 3000  #: number of times that the old file holds its runs, so that work on it takes a while
    mark: str = field(default_factory=lambda: uuid.uuid4().hex)

    def __post_init__(self) -> None:
        self.shared = _shared()
        self.keep = self.folder / "kept"
        self.keep.mkdir()
        (self.folder / "tmp").mkdir()
        (self.folder / "tmp").chmod(0o777)
        (self.folder / "mine.py").write_text(STRANGER)
        (self.keep / "sins-env").write_text(COMMAND)
        begin = time.monotonic()
        self.must(self.evaluation("kept/whole.sqlite"))
        self.eval_s = time.monotonic() - begin  #: duration of an undisturbed evaluation, s
        self.table = self.board("kept/whole.sqlite")

    def evaluation(self, db: str, *more: str) -> tuple[str, ...]:
        """Return the words of an evaluation into a file."""
        names = ("--task", "brief-v0", "--solver", *self.solvers, "--runs", str(self.runs))
        return ("eval", *names, "--chunk", "2", "--workers", str(self.workers), "--db", db, *more)

    def start(self, words: Sequence[str], script: bool = False, **settings: Any) -> subprocess.Popen[str]:
        """Start a command in a session of its own, where Ctrl-C is heard."""
        command = [str(SCRIPT)] if script else [sys.executable, str(self.keep / "sins-env")]
        environment = {
            **os.environ, MARK: self.mark, "TMPDIR": str(self.folder / "tmp"), "PYTHONPATH": str(ROOT),
            "OPENBLAS_NUM_THREADS": "1", "MPLCONFIGDIR": str(self.keep / "mpl"), "COLUMNS": "100",
        }  # fmt: skip
        before = settings.pop("before", None)

        def prepare() -> None:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            if before:
                before()

        return subprocess.Popen(
            [*command, *words], cwd=self.folder, env=environment, start_new_session=True, text=True, preexec_fn=prepare,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, **settings,
        )  # fmt: skip

    def end(self, process: subprocess.Popen[str]) -> Ended:
        """Wait for a command.

        Raises:
            AssertionError: it hangs.
        """
        try:
            out, err = process.communicate(timeout=LONG_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise AssertionError("it hangs") from None
        return Ended(process.returncode, out, err)

    def must(self, words: Sequence[str], **settings: Any) -> Ended:
        """Run a command that nothing disturbs.

        Raises:
            AssertionError: it fails.
        """
        ended = self.end(self.start(words, **settings))
        assert ended.code == 0, f"undisturbed, {words[0]} gave {ended.code}: {ended.err[-300:]}"
        return ended

    def board(self, db: str) -> Any:
        """Return the table of a file without costs, which no two measurements have in common."""
        with Store(self.folder / db, read_only=True) as store:
            rows = json.loads(plain_tables.as_json(list(map(store.results, store.keys()))))
        for row in rows:
            assert row.pop("cost_ratio") is not None, f"{db}: no cost of {row['solver']}"
        return rows

    def left(self) -> list[str]:
        """Return the processes of this campaign that still run, after they had some time to end."""
        deadline = time.monotonic() + 20.0
        while (found := _marked(self.mark)) and time.monotonic() < deadline:
            time.sleep(0.05)
        return found

    def check_evaluated(self, db: str) -> None:
        """Check that a file has what an undisturbed evaluation has.

        Raises:
            AssertionError: anything differs.
        """
        check_whole(self.folder / db)
        assert self.board(db) == self.table, "another table"
        with Store(self.folder / db, read_only=True) as now, Store(self.keep / "whole.sqlite", read_only=True) as then:
            for key in sorted(then.keys(), key=str):
                different = compare_runs(then.results(key).records, now.results(key).records)
                assert not different, f"{key.solver}: {different[0]}"

    def check_left(self, *names: str) -> None:
        """Check that no process is left, and no file but these in the folder.

        Raises:
            AssertionError: something is left.
        """
        left = self.left()
        assert not left, f"processes left: {left}"
        found = {str(path.relative_to(self.folder)) for path in self.folder.rglob("*")}
        strays = {name for name in found if not name.startswith(("kept", "__pycache__"))} - {"tmp", "mine.py", *names}
        assert not strays, f"files left: {sorted(strays)}"
        shared = _unused(_shared() - self.shared)
        assert not shared, f"shared memory left: {shared}"

    def clear(self) -> None:
        """Remove what a trial left."""
        for process in _marked(self.mark):
            os.kill(int(process.split()[0]), signal.SIGKILL)
        for path in self.folder.iterdir():
            if path.name not in ("kept", "tmp", "mine.py"):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        for path in (self.folder / "tmp").iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        self.shared |= _shared()


def _marked(mark: str) -> list[str]:
    """Return number and command of the processes whose environment has the mark."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}".encode() in (path / "environ").read_bytes():
                words = (path / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
                if words:  # a zombie has none
                    found.append(f"{path.name} {words[:80]}")
        except OSError:
            pass
    return found


def _shared() -> set[str]:
    """Return the names of shared memory of all processes; semaphores belong to a tracker, which removes them later."""
    names = os.listdir("/dev/shm") if os.path.isdir("/dev/shm") else []
    return {name for name in names if not name.startswith("sem.")}


def _unused(names: set[str]) -> list[str]:
    """Return those of these names of shared memory that no process uses, although they are there for a while."""
    deadline = time.monotonic() + 10.0
    while names := names & _shared():
        used = b""
        for path in Path("/proc").glob("[0-9]*/maps"):
            with suppress(OSError):
                used += path.read_bytes()
        left = sorted(name for name in names if name.encode() not in used)
        if not left or time.monotonic() > deadline:
            return left
        time.sleep(0.5)
    return []


def _workers(pid: int) -> list[int]:
    """Return the worker processes of a command, without the tracker of multiprocessing."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]
    except OSError:
        return []


def check_whole(path: Path) -> None:
    """Check that a results file is a whole SQLite file whose runs have one history each.

    Raises:
        AssertionError: it is not.
    """
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("PRAGMA integrity_check").fetchone() == ("ok",), "SQLite finds it damaged"
        ((runs, distinct),) = db.execute("SELECT count(*), count(DISTINCT id) FROM runs").fetchall()
        key = "task, suite, solver, settings_hash, code, run"
        ((keys,),) = db.execute(f"SELECT count(*) FROM (SELECT DISTINCT {key} FROM runs)").fetchall()
        ((histories,),) = db.execute("SELECT count(*) FROM histories").fetchall()
        assert runs == distinct == keys == histories, f"{runs} runs, {keys} keys, {histories} histories"


def check_line(ended: Ended, code: int, part: str = "") -> None:
    """Check the exit code of a command that ended early, and that it says why in one line.

    Raises:
        AssertionError: it does not.
    """
    assert ended.code == code, f"exit code {ended.code}: {ended.err[-300:]}"
    assert ended.err.startswith("sins-env: "), f"standard error: {ended.err[-600:]}"
    assert ended.err.count("\n") == 1, f"standard error: {ended.err[-600:]}"
    assert part in ended.err, f"standard error without {part!r}: {ended.err}"


def kill_parent(trials: Trials, rng: np.random.Generator) -> None:
    """Kill the evaluation itself; its workers must end, and ``--resume`` must complete the file."""
    process = trials.start(trials.evaluation("r.sqlite"))
    time.sleep(rng.uniform(0.0, trials.eval_s))
    process.kill()
    trials.end(process)
    assert not trials.left(), f"processes left: {trials.left()}"
    trials.must(trials.evaluation("r.sqlite", "--resume"))
    trials.check_evaluated("r.sqlite")
    trials.check_left("r.sqlite")


def kill_worker(trials: Trials, rng: np.random.Generator) -> None:
    """Kill a worker; the evaluation goes on and loses nothing."""
    process = trials.start(trials.evaluation("r.sqlite"))
    time.sleep(rng.uniform(0.0, trials.eval_s))
    while process.poll() is None and not (workers := _workers(process.pid)):
        time.sleep(0.001)
    if process.poll() is None:
        with suppress(ProcessLookupError):
            os.kill(int(rng.choice(workers)), signal.SIGKILL)
    ended = trials.end(process)
    assert (ended.code, ended.err) == (0, ""), f"exit code {ended.code}: {ended.err[-300:]}"
    trials.check_evaluated("r.sqlite")
    trials.check_left("r.sqlite")


def kill_twice(trials: Trials, rng: np.random.Generator) -> None:
    """Kill everything twice in a row, each time at once, as a machine does that loses its power."""
    for more in ((), ("--resume",)):
        process = trials.start(trials.evaluation("r.sqlite", *more))
        time.sleep(rng.uniform(0.0, trials.eval_s))
        os.killpg(process.pid, signal.SIGKILL)
        trials.end(process)
    trials.shared |= _shared()  # what nobody is left to remove
    trials.must(trials.evaluation("r.sqlite", "--resume"))
    trials.check_evaluated("r.sqlite")
    trials.check_left("r.sqlite")


def kill_migration(trials: Trials, rng: np.random.Generator) -> None:
    """Kill the migration of a file of version 0.1.0; the file is the old one or the new one, and its rows are all there."""
    old = _old_file(trials)
    shutil.copy(old, trials.folder / "r.sqlite")
    words = ("eval", "--task", "short-v0", "--solver", "kf", "--runs", "2", "--workers", "1", "--db", "r.sqlite")
    process = trials.start(words)
    while process.poll() is None and not (trials.folder / "r.sqlite-wal").exists():
        time.sleep(0.0005)
    time.sleep(rng.uniform(0.0, 1.0) ** 2)
    process.kill()
    trials.end(process)
    check_whole(trials.folder / "r.sqlite")
    trials.must((*words, "--resume"))
    check_whole(trials.folder / "r.sqlite")
    with Store(trials.folder / "r.sqlite", read_only=True) as now, Store(old, read_only=True) as then:
        for key in sorted(then.keys(), key=str):
            assert now.runs_of(key) == then.runs_of(key), f"{key.solver}: rows of 0.1.0 lost"
            runs = range(trials.copies, trials.copies + 50)
            assert not compare_runs(then.results(key, runs).records, now.results(key, runs).records), "rows changed"
    trials.check_left("r.sqlite")


def _old_file(trials: Trials) -> Path:
    """Make a large file of version 0.1.0 once, and return its path."""
    path = trials.keep / "old.sqlite"
    if not path.exists():
        db = sqlite3.connect(path)
        db.executescript(OLD.read_text())
        names = [name for _, name, *_ in db.execute("PRAGMA table_info(runs)") if name not in ("id", "run")]
        copied = ", ".join(names)
        db.execute(
            "CREATE TEMP TABLE n AS WITH RECURSIVE c(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM c LIMIT ?) SELECT i FROM c",
            (trials.copies,),
        )
        db.execute(f"INSERT INTO runs (id, run, {copied}) SELECT id + 10 * i, run + 10 * i, {copied} FROM runs, n")
        db.execute("INSERT INTO histories SELECT id + 10 * i, history FROM histories, n")
        db.commit()
        db.close()
    return path


def _writing(trials: Trials, rng: np.random.Generator, words: Sequence[str], target: str, ending: bytes) -> None:
    """Kill a command that writes a file anew; the file must be the old or the whole new one."""
    kept = trials.keep / f"new-{target}"
    path = trials.folder / target
    if not kept.exists():
        begin = time.monotonic()
        trials.must(words)
        (trials.keep / f"s-{target}").write_text(str(time.monotonic() - begin))
        path.rename(kept)
    path.write_bytes(b"old")
    process = trials.start(words)
    time.sleep(rng.uniform(0.3, 1.1) * float((trials.keep / f"s-{target}").read_text()))
    process.kill()
    trials.end(process)
    _check_written(path, kept, ending)
    trials.must(words)
    _check_written(path, kept, ending, again=True)
    trials.check_left(target)


def _check_written(path: Path, whole: Path, ending: bytes, again: bool = False) -> None:
    found = path.read_bytes() if path.exists() else b"nothing"
    as_new = found == whole.read_bytes() or bool(ending and found.endswith(ending))
    assert as_new or (found == b"old" and not again), f"half written: {len(found)} of {whole.stat().st_size} bytes"


def kill_export(trials: Trials, rng: np.random.Generator) -> None:
    """Kill an export of many runs, in each format."""
    _old_file(trials)
    form = str(rng.choice(["csv", "json", "parquet"]))
    _writing(trials, rng, ("export", f"--{form}", f"out.{form}", "--db", "kept/old.sqlite"), f"out.{form}", b"")


def kill_report(trials: Trials, rng: np.random.Generator) -> None:
    """Kill the making of a page."""
    _writing(trials, rng, ("report", "--html", "out.html", "--db", "kept/whole.sqlite"), "out.html", b"</html>\n")


def kill_plot(trials: Trials, rng: np.random.Generator) -> None:
    """Kill the drawing of a figure."""
    _writing(trials, rng, ("board", "--plot", "out.svg", "--db", "kept/whole.sqlite"), "out.svg", b"</svg>\n")


def interrupt(trials: Trials, rng: np.random.Generator) -> None:
    """Press Ctrl-C during any verb, from the first millisecond of its process on.

    Before the interpreter hears signals it dies of this one in silence, as every program does. While it prepares itself it
    prints a traceback of its own, in which no file of this package is.
    """
    words, target = _interrupted(trials, rng)
    begin = time.monotonic()
    if not (timed := trials.keep / f"s-{words[0]}").exists():
        trials.must(words, script=words[0] != "eval")
        timed.write_text(str(time.monotonic() - begin))
        trials.clear()
    whole = float(timed.read_text())
    process = trials.start(words, script=words[0] != "eval")
    time.sleep(rng.uniform(0.0, 0.3) if rng.random() < 0.5 else rng.uniform(0.0, whole))
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGINT)
    ended = trials.end(process)
    ours = any(part in ended.err for part in ("sins-env: ", f"{ROOT}/sins_env/", f"{ROOT}/solvers/"))
    if ended.code == 0:
        assert ended.err.count("\n") <= 1, f"exit code 0: {ended.err[-600:]}"
    elif ours or not ((ended.code, ended.err) == (-signal.SIGINT, "") or "KeyboardInterrupt" in ended.err):
        ended.code = 130 if ended.code == -signal.SIGINT else ended.code  # as a shell does
        check_line(ended, 130)
    assert not trials.left(), f"processes left: {trials.left()}"
    if words[0] == "eval":
        trials.must(trials.evaluation("r.sqlite", "--resume"))
        trials.check_evaluated("r.sqlite")
    elif target:
        trials.must(words)
    trials.check_left(*target)


def _interrupted(trials: Trials, rng: np.random.Generator) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the words of a command to interrupt, and the files that it leaves."""
    db = ("--db", "kept/whole.sqlite")
    commands: list[tuple[tuple[str, ...], tuple[str, ...]]] = [
        (("list",), ()),
        (("describe", "ckf"), ()),
        (("board", *db), ()),
        (("report", "--html", "out.html", *db), ("out.html",)),
        (("export", "--csv", "out.csv", *db), ("out.csv",)),
        (("check", "kf"), ()),
        (("run", "sway-white-v0", "kf"), ()),
        (trials.evaluation("r.sqlite"), ("r.sqlite",)),
        (trials.evaluation("r.sqlite"), ("r.sqlite",)),
    ]
    return commands[int(rng.integers(len(commands)))]


def full_disk(trials: Trials, rng: np.random.Generator) -> None:
    """Fill the disk during an evaluation; when there is space again, ``--resume`` completes the file."""
    with _small_disk(trials, int(rng.integers(20, 130)) * 1024) as (limit, grow):
        ended = trials.end(trials.start(trials.evaluation("disk/r.sqlite"), before=limit))
        if ended.code:
            check_line(ended, 2, "disk/r.sqlite: ")
        grow()
        trials.must(trials.evaluation("disk/r.sqlite", "--resume"))
        trials.check_evaluated("disk/r.sqlite")
        trials.check_left("disk", "disk/r.sqlite")


def full_disk_writing(trials: Trials, rng: np.random.Generator) -> None:
    """Fill the disk during an export, a page or a figure; the old file stays, and nothing else."""
    words, target = [
        (("export", "--csv", "disk/out.csv", "--db", "kept/whole.sqlite"), "out.csv"),
        (("export", "--json", "disk/out.json", "--db", "kept/whole.sqlite"), "out.json"),
        (("export", "--parquet", "disk/out.parquet", "--db", "kept/whole.sqlite"), "out.parquet"),
        (("report", "--html", "disk/out.html", "--db", "kept/whole.sqlite"), "out.html"),
        (("board", "--plot", "disk/out.png", "--db", "kept/whole.sqlite"), "out.png"),
    ][int(rng.integers(5))]
    with _small_disk(trials, int(rng.integers(1, 4)) * 4096) as (limit, grow):
        path = trials.folder / "disk" / target
        path.write_bytes(b"old")
        ended = trials.end(trials.start(words, before=limit))
        if ended.code == 0:  # it fits
            assert path.read_bytes() != b"old", "the old file is still there"
        else:
            check_line(ended, 2, f"disk/{target}")
            assert path.read_bytes() == b"old", "the old file is gone"
        trials.check_left("disk", f"disk/{target}")
        grow()
        trials.must(words)
        trials.check_left("disk", f"disk/{target}")


@contextmanager
def _small_disk(trials: Trials, size: int) -> Iterator[tuple[Callable[[], None] | None, Callable[[], None]]]:
    """Yield a function that a new process calls first, and one that makes space, for the folder ``disk``."""
    disk = trials.folder / "disk"
    disk.mkdir()
    if (
        os.geteuid() == 0
        and not subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)], capture_output=True, check=False
        ).returncode
    ):
        try:
            yield None, lambda: subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True) and None
        finally:
            trials_left = trials.left()
            subprocess.run(["umount", "-l", str(disk)], check=True)
            assert not trials_left, f"processes left: {trials_left}"
    else:
        yield lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)), lambda: None


def read_only(trials: Trials, rng: np.random.Generator) -> None:
    """Evaluate into a file or a folder that may not be written, and read from there."""
    sealed = trials.folder / "sealed"
    sealed.mkdir()
    shutil.copy(trials.keep / "whole.sqlite", sealed / "r.sqlite")
    before = (sealed / "r.sqlite").read_bytes()
    folder_too = bool(rng.integers(2))
    (sealed / "r.sqlite").chmod(0o444)
    sealed.chmod(0o555 if folder_too else 0o777)
    trials.folder.chmod(0o755)

    def obeying() -> None:
        """Make root obey the permissions of files."""
        for capability in OVERRIDES if os.geteuid() == 0 else ():
            ctypes.CDLL(None).prctl(DROP, capability, 0, 0, 0)

    try:
        words = trials.evaluation("sealed/r.sqlite", "--resume", "--runs", "40")
        check_line(trials.end(trials.start(words, before=obeying)), 2, "sealed/r.sqlite: cannot be")
        if folder_too:
            words = trials.evaluation("sealed/n.sqlite")
            check_line(trials.end(trials.start(words, before=obeying)), 2, "sealed/n.sqlite: cannot be")
            words = ("export", "--csv", "sealed/out.csv", "--db", "sealed/r.sqlite")
            check_line(trials.end(trials.start(words, before=obeying)), 2, "sealed/out.csv")
        rows = json.loads(trials.must(("board", "--json", "--db", "sealed/r.sqlite"), before=obeying).out)
        assert [{k: v for k, v in row.items() if k != "cost_ratio"} for row in rows] == trials.table
        assert (sealed / "r.sqlite").read_bytes() == before, "it was changed"
        trials.check_left("sealed", "sealed/r.sqlite")
    finally:
        sealed.chmod(0o755)


def gone(trials: Trials, rng: np.random.Generator) -> None:
    """Remove or replace the file during an evaluation; it must say so, and run again completely."""
    path = trials.folder / "r.sqlite"
    process = trials.start(trials.evaluation("r.sqlite"))
    while process.poll() is None and not path.exists():
        time.sleep(0.001)
    time.sleep(rng.uniform(0.0, 0.7 * trials.eval_s))
    complete = _costs(path) == len(trials.solvers)  # costs are written last
    if rng.integers(2):
        path.unlink()
    else:
        os.replace(shutil.copy(trials.keep / "whole.sqlite", trials.folder / "other.sqlite"), path)
    ended = trials.end(process)
    if complete:
        assert ended.code == 0, f"exit code {ended.code}: {ended.err[-300:]}"
    else:
        check_line(ended, 2, "r.sqlite: ")
    trials.must(trials.evaluation("r.sqlite", "--resume"))
    trials.check_evaluated("r.sqlite")
    trials.check_left("r.sqlite")


def _costs(path: Path) -> int:
    """Return how many costs a file has that others write to; it may just be made."""
    with closing(sqlite3.connect(path)) as db, suppress(sqlite3.Error):
        return int(db.execute("SELECT count(*) FROM costs").fetchone()[0])
    return 0


def together(trials: Trials, rng: np.random.Generator) -> None:
    """Evaluate twice at once into one file, the same runs; every other time one of them is killed."""
    both = [trials.start(trials.evaluation("r.sqlite", "--resume"))]
    time.sleep(rng.uniform(0.0, 1.0) ** 2)
    both.append(trials.start(trials.evaluation("r.sqlite", "--resume")))
    if rng.integers(2):
        time.sleep(rng.uniform(0.0, trials.eval_s))
        victim = both.pop(int(rng.integers(2)))
        victim.kill()
        trials.end(victim)
    for process in both:
        ended = trials.end(process)
        assert (ended.code, ended.err) == (0, ""), f"exit code {ended.code}: {ended.err[-300:]}"
    trials.check_evaluated("r.sqlite")
    trials.check_left("r.sqlite")


Trial = Callable[[Trials, np.random.Generator], None]
#: Kinds of trials with how often the whole campaign makes each; those of kill -9 are 100 together.
KINDS: dict[str, tuple[Trial, int]] = {
    "parent": (kill_parent, 25),
    "worker": (kill_worker, 20),
    "twice": (kill_twice, 10),
    "migration": (kill_migration, 15),
    "export": (kill_export, 15),
    "report": (kill_report, 10),
    "plot": (kill_plot, 5),
    "interrupt": (interrupt, 50),
    "full": (full_disk, 15),
    "full-writing": (full_disk_writing, 10),
    "read-only": (read_only, 4),
    "gone": (gone, 10),
    "together": (together, 8),
}


def campaign(trials: Trials, kind: str, times: int, seed: int, tell: Callable[[int], None] | None = None) -> list[str]:
    """Make trials of one kind, and return the faults found, each with the number of its trial."""
    faults = []
    for i in range(times):
        rng = np.random.default_rng([seed, sorted(KINDS).index(kind), i])
        try:
            KINDS[kind][0](trials, rng)
        except AssertionError as error:
            faults.append(f"{kind} {i}: {error}")
        finally:
            trials.clear()
        if tell:
            tell(i + 1)
    return faults


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="kills, Ctrl-C, full disks and lost files, at random moments")
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS), help="kinds of trials, default all")
    parser.add_argument("--times", type=int, help="trials of each kind, default by kind: 100 kills, 50 interrupts")
    parser.add_argument("--solver", nargs="+", default=["kf", "mine:Mine"], help="solvers, default kf and a stranger's")
    parser.add_argument("--seed", type=int, default=0, help="seed of all moments (default %(default)s)")
    given = parser.parse_args(arguments)
    table = Table(title=f"robustness, seed {given.seed}")
    for heading in ("kind", "tried", "failing", "what"):
        table.add_column(heading, justify="right" if heading in ("tried", "failing") else "left")
    failing = 0
    with tempfile.TemporaryDirectory(prefix="robustness-") as folder:
        trials = Trials(Path(folder).resolve(), solvers=tuple(given.solver))
        for kind in given.kind:
            times = given.times or KINDS[kind][1]
            with Bar(kind, times) as bar:
                faults = campaign(trials, kind, times, given.seed, bar.update)
            failing += len(faults)
            print("\n".join([f"{kind}: {times} tried, {len(faults)} failing", *faults]), file=sys.stderr)
            table.add_row(kind, f"{times}", f"{len(faults)}", (KINDS[kind][0].__doc__ or "").splitlines()[0])
    Console().print(table)
    return 1 if failing else 0


if __name__ == "__main__":
    sys.exit(main())
