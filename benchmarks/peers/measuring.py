"""Times every entry of every package on the same problem, in one process on one core.

A block runs a filter over all steps of some runs, repeatedly for some hundredths of a second. Every round times each block
once, so that a busy machine slows all of them alike. The result is the median over the rounds of the CPU time. The first call
of a block, which compiles it in JAX, is timed separately.
"""

from __future__ import annotations

import contextlib
import datetime
import gc
import importlib
import os
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from rich.progress import Progress, track

from peers import by_hand, flight, ours, tables
from peers.contest import Entry
from peers.environment import PEERS
from peers.problem import Problem, record
from sins_env.evaluation.estimators.memory import keep_freed_memory
from solvers.types import Gaussian

TASK = "sway-white-v0"
BLOCK_S = 0.03  #: s, least time of a block in a round
NOISIER = 1e4  #: factor of Q in a second comparison of the estimates, which shows a filter that leaves out Q
FEW = 4  #: number of runs for a package that takes one at a time; more runs take equally long each
LONG_S = 2.0  #: s, time of the first calls of a filter from which on it is told
BEGAN = time.perf_counter()


@dataclass
class Timed:
    """A block, and the cost of its calls."""

    label: str
    call: Callable[[], Any]
    steps: int  #: number of steps that a call filters, over all its runs
    first_s: float = 0.0  #: wall time of the first call
    end: Any = None  #: result of the first call
    repeat: int = 1  #: number of calls in a round
    seconds: list[float] = field(default_factory=list)  #: CPU time of a call, in each round

    def begin(self) -> None:
        """Make the first call, and choose the number of calls in a round."""
        begin = time.perf_counter()
        self.end = self.call()
        self.first_s = time.perf_counter() - begin
        self.repeat = max(1, round(BLOCK_S / self.timed()))

    def again(self) -> None:
        """Time the block in one more round."""
        self.seconds.append(self.timed())

    def timed(self) -> float:
        """Return the CPU seconds of a call."""
        begin = time.process_time()
        for _ in range(self.repeat):
            self.call()
        return (time.process_time() - begin) / self.repeat

    @property
    def step_s(self) -> float:
        """CPU seconds of a step of one run."""
        return statistics.median(self.seconds) / self.steps


@dataclass
class Entered:
    """An entry of a package, with its blocks by the number of runs."""

    peer: str
    entry: Entry
    blocks: dict[int, Timed]

    def row(self, sizes: Sequence[int], reference: Gaussian, noisier: dict[str, Any]) -> dict[str, Any]:
        """Return the row of the result.

        ``reference`` is the estimate of our filter of the same kind; ``noisier`` holds the noisier problem and our estimates there.
        """
        looped = not self.entry.batched
        mean, cov = differences(reference, self.blocks[FEW if looped else sizes[0]].end)
        loud = None
        if not self.entry.compiled:  # compiling once more would cost more than it is worth
            loud = max(differences(noisier[self.entry.filter], self.entry.make(noisier["problem"], FEW)()))
        return {
            "peer": self.peer,
            "filter": self.entry.filter,
            "numbers": self.entry.numbers,
            "how": self.entry.how,
            "stepped": self.entry.stepped,
            "us_per_step": 1e6 * self.blocks[1].step_s,
            "steps_per_s": {str(runs): 1 / self.blocks[FEW if looped else runs].step_s for runs in sizes},
            "looped": looped,
            "first_call_s": self.blocks[1].first_s if self.entry.compiled else None,
            "mean_differs": mean,
            "cov_differs": cov,
            "noisier_differs": loud,
            "remark": self.entry.remark,
        }


def differences(reference: Gaussian, end: Gaussian) -> tuple[float, float]:
    """Return the largest |x - x'| in standard deviations, and the largest |P - P'| in products of two, over common runs."""
    runs = min(len(reference.mean), len(end.mean))
    std = np.sqrt(np.diagonal(reference.cov[:runs], axis1=1, axis2=2))
    mean = np.abs(end.mean[:runs] - reference.mean[:runs]) / std
    cov = np.abs(end.cov[:runs] - reference.cov[:runs]) / (std[:, :, None] * std[:, None])
    return float(mean.max()), float(cov.max())


def say(text: str) -> None:
    """Print a line with the time since the beginning, for what takes long."""
    print(f"{time.perf_counter() - BEGAN:6.1f} s  {text}", flush=True)


def load(name: str, absent: dict[str, str]) -> Any:
    """Import the module with a package's entries; if that fails return None, and put the reason into ``absent``."""
    try:
        return importlib.import_module(f"peers.{PEERS[name].module}")
    except ImportError as error:
        absent[name] = f"cannot be imported: {error}"
        return None


def entered(problem: Problem, peers: dict[str, Any], sizes: Sequence[int], absent: dict[str, str]) -> list[Entered]:
    """Return the filters whose first calls succeed, and put the others with their error into ``absent``."""
    found = []
    every = [(peer, entry) for peer, module in peers.items() for entry in module.entries()]
    for peer, entry in track(every, "first calls"):
        label = f"{peer} {entry.filter}"
        try:
            numbers = [1, *sizes] if entry.batched else [1, FEW]
            blocks = {n: Timed(label, entry.make(problem, n), n * problem.steps) for n in numbers}
            for timed in blocks.values():
                timed.begin()
        except Exception as error:  # one filter that fails must not hide the others
            absent[f"{label} ({entry.numbers})"] = f"{type(error).__name__}: {error}"
        else:
            found.append(Entered(peer, entry, blocks))
            if (spent := sum(timed.first_s for timed in blocks.values())) > LONG_S:
                say(f"{label}, {entry.how}: {spent:.1f} s for the first calls")
    return found


def flown(steps: int, navigator: Any) -> dict[str, Timed]:
    """Make the first calls of our INS and that of pyins; ``navigator`` is its module, or None if it is absent."""
    tape = flight.record(steps)
    found = {"sins_env": Timed("sins_env INS", flight.ours(tape, steps), steps)}
    if navigator is not None:
        found["pyins"] = Timed("pyins INS", navigator.feedback_filter(tape, steps), steps)
    for timed in found.values():
        timed.begin()
    return found


def play(every: Sequence[Timed], rounds: int) -> float | None:
    """Time every block in every round.

    Return the number of cores that other processes kept busy meanwhile; None if the system does not tell.
    """
    begin, before = time.perf_counter(), others_s()
    with Progress() as progress:
        bar = progress.add_task("", total=len(every) * rounds)
        for turn in range(rounds):
            for timed in every:
                progress.update(bar, description=f"round {turn + 1}: {timed.label:<16}")
                timed.again()
                progress.advance(bar)
            gc.collect()
    after = others_s()
    return None if before is None or after is None else (after - before) / (time.perf_counter() - begin)


def measured(steps: int, rounds: int, sizes: Sequence[int]) -> dict[str, Any]:
    """Measure everything, and return the result as it is written to the JSON."""
    keep_freed_memory()
    absent = {name: peer.absent for name, peer in PEERS.items() if peer.absent}
    modules = {name: load(name, absent) for name in PEERS if name not in absent}
    there = {name: module for name, module in modules.items() if module is not None}
    navigator = there.pop("pyins", None)
    say(f"recording {steps} epochs of {TASK} with {max(FEW, *sizes):,} runs")
    problem = record(TASK, max(FEW, *sizes), steps)
    say("first calls, which compile")
    entries = entered(problem, {"sins_env": ours, tables.HAND: by_hand, **there}, sizes, absent)
    flights = flown(steps, navigator)
    loads = [os.getloadavg()[0]]
    say(f"{rounds} rounds")
    others = play([*(t for e in entries for t in e.blocks.values()), *flights.values()], rounds)
    loads.append(os.getloadavg()[0])
    reference = {e.entry.filter: e.blocks[sizes[0]].end for e in entries if e.peer == "sins_env"}
    say("the filters with more noise, to compare")
    loud = replace(problem, Q=NOISIER * problem.Q)
    noisier = {"problem": loud} | {e.filter: e.make(loud, FEW)() for e in ours.entries()}
    return {
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "machine": machine(),
        "load": loads,
        "others_busy_cores": others,
        "versions": versions([name for name, module in modules.items() if module is not None]),
        "absent": absent,
        "task": TASK,
        "steps": steps,
        "rounds": rounds,
        "looped_runs": FEW,
        "noisier": NOISIER,
        "rows": [e.row(sizes, reference[e.entry.filter], noisier) for e in entries],
        "flight": {
            "task": flight.TASK,
            "us_per_step": {name: 1e6 * timed.step_s for name, timed in flights.items()},
            "differs": {n: flight.apart(flights["sins_env"].end, t.end) for n, t in flights.items() if n != "sins_env"},
        },
    }


def versions(names: Sequence[str]) -> dict[str, str]:
    """Return the versions of the packages, and of numpy, scipy and jax."""
    found = {name: version(PEERS[name].distribution) for name in names}
    for name in ("numpy", "scipy", "jax"):
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def others_s() -> float | None:
    """Return the CPU seconds of other processes so far, over all cores; None if the system does not tell."""
    try:
        with open("/proc/stat") as lines:
            user, nice, system, _, _, irq, softirq, steal = (int(ticks) for ticks in lines.readline().split()[1:9])
    except OSError:
        return None
    busy = (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")
    return busy - time.process_time()


def machine() -> dict[str, Any]:
    """Return what machine this is."""
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }


def processor() -> str:
    """Return the name of the processor."""
    try:
        with open("/proc/cpuinfo") as lines:
            return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()
