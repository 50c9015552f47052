"""The default suite as data: which solvers play which task, with how many runs of which suite, and in which order.

    python benchmarks/suite.py               the plan, with the CPU time of each task
    python benchmarks/suite.py --measure     measures the CPU time of each solver again, into suite.json

Suite A selects, suite B confirms. Its seed is that of suite A plus one, so that no run of it has been seen before.

1. All solvers but particle filters play 200 runs of suite A on each of their tasks; a recording has no more than its windows.
2. The leader and the yardstick of each task play 200 runs of suite B, from which alone the leader's figures are taken. Particle
   filters, and solvers that cost as much, play 40 runs of suite A, which are preliminary.
3. Pairs that are neither told apart nor equal within 2 % play 400 and then 800 runs of suite A: neighbours among the first three
   of a task, and the leader beside the yardstick.

A task ends before the next one begins, so that whoever stops early has whole tasks; the first tasks tell most. ``ukf`` is ckf by
default and ``hinf_uif`` is ``hinf_ukf``, so near-duplicates play ``sway-white-v0`` alone, as every solver does.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import zoo
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from sins_env.evaluation.estimators.isolation import Here
from sins_env.evaluation.estimators.memory import keep_freed_memory
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.play.queue import extent
from sins_env.evaluation.speed.timing import Probe
from sins_env.evaluation.store.filling import Evaluation
from sins_env.evaluation.tasks.catalogue import TASKS, get_task
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.writing.files import write_text

CPU = Path(__file__).with_name("suite.json")  #: what was measured of CPU times
YARDSTICK = "ckf"
RUNS = 200  #: runs of each suite
FEW = 40  #: runs of solvers that are too slow for more
LOOKS = (RUNS, 400, 800)  #: numbers of runs at which a pair is looked at
LEAST_SHOWN = 20  #: runs below which a table has values alone

PARTICLES = ("gpf", "cgpf", "ugpf", "rqmc_gpf", "pf", "upf", "hepf")
#: Solvers that play few runs, for their cost; those of filterpy, which play one run at a time, are kf, ekf and ukf again.
SLOW = (*PARTICLES, "fgo", "filterpy_kf", "filterpy_ekf", "filterpy_ukf")

USUAL = ("ckf", "ekf", "gsf_imm")
ADAPTIVE = ("imm_ekf", "aukf", "aukf_fading", "aukf_window", "augmented_aukf", "asmugsf", "vb_ckf")
ROBUST = ("imm_ekf", "student_t_ckf", "huber_ckf", "mcc_ckf", "gm_ekf", "vb_ckf")
HINF = ("hinf_kf", "hinf_ukf", "mixed_hinf_ukf")
HEADING = ("inekf", "iekf", "gsf_ekf", "eqf")
COARSE = ("coarse_inertial", "coarse_oba")
AT_REST = ("coarse_analytic1", "coarse_analytic2", "coarse_analytic3")
HOT = (*USUAL, *HEADING)

#: Solvers of each task, the tasks that tell most first.
PLAYED: Mapping[str, tuple[str, ...]] = {
    "sway-white-v0": tuple(name for name in zoo.names() if name not in SLOW),
    "sway-told-wrong-v0": (
        *USUAL, "two_pass", *ADAPTIVE, *HINF, "mpf_ekf", "student_t_ckf", "gm_ekf", "inekf", "eqf",
    ),
    "sway-jump-v0": (*USUAL, *ROBUST, "aukf_window", "two_pass", "inekf"),
    "sway-anyheading-v0": (*USUAL, *HEADING, "two_pass", "ckf5", "ddf2", "imm_ekf", "hinf_ukf"),
    "flight-hotstart60-v0": HOT,
    "sway-heavytail-v0": ("ckf", "gsf_imm", *ROBUST, "two_pass"),
    "flight-lu-mixture-v0": (*USUAL, *ROBUST, "inekf", "aukf_window"),
    "sway-scratch-v0": ("ckf", "gsf_imm", "gsf_ekf", "two_pass", *COARSE),
    "sway-markov-v0": (*USUAL, "two_pass", "imm_ekf", "inekf"),
    "sway-contaminated-v0": ("ckf", "gsf_imm", "gm_ekf", "imm_ekf", "student_t_ckf", "vb_ckf"),
    "vehicle-v0": (
        *USUAL, "imm_ekf", "aukf_window", "asmugsf", "mixed_hinf_ukf", "mpf_ekf", "huber_ckf", "student_t_ckf", "vb_ckf",
        *COARSE, *AT_REST,
    ),
    "static8-v0": ("ckf", "gsf_imm", "imm_ekf", *COARSE, *AT_REST),
    "rlg-car-v0": ("ckf", "gsf_imm", "imm_ekf", "huber_ckf", "mixed_hinf_ukf", "mpf", *COARSE, *AT_REST),
    "navgrade-car-v0": (*USUAL, "inekf", "student_t_ckf"),
    "flight-hotstart90-v0": HOT,
    "flight-hotstart30-v0": HOT,
    "flight-sun2012-v0": (*USUAL, "inekf", "eqf"),
    "flight-lu-gauss-v0": (*USUAL, "gm_ekf", "imm_ekf", "inekf", "eqf"),
    "flight-zhao2010-v0": (*USUAL, "aukf_window", "imm_ekf", "student_t_ckf", "inekf", "vb_ckf"),
    "flight-sun2012-physical-v0": (*USUAL, "inekf"),
    "flight-sun2012-fixed-v0": (*USUAL, "inekf"),
    **dict.fromkeys(
        ("inmotion-car-v0", "inmotion-flight-v0", "car-odometer-v0", "ship-dvl-v0", "dualantenna-mems-v0", "gpsdr-v0", "tight-v0"),
        (*USUAL, "inekf", "gsf_ekf"),
    ),
}  # fmt: skip
#: Slow solvers that play besides, after all other tasks.
PRELIMINARY: Mapping[str, tuple[str, ...]] = {
    "sway-white-v0": SLOW,
    "sway-heavytail-v0": ("gpf", "cgpf"),
    "sway-anyheading-v0": ("pf", "cgpf", "fgo"),
    "flight-hotstart60-v0": ("fgo",),
}
#: Tasks on which the cost of a step is measured beside that of ckf: one with ten states, one with fifteen.
COSTED = ("sway-white-v0", "flight-hotstart60-v0")


class Portion(NamedTuple):
    """A task, and the solvers that play the same runs of one of its suites."""

    task: str
    runs: int
    solvers: tuple[str, ...]
    suite: str = "A"

    @property
    def seed(self) -> int | None:
        """Seed of the suite; None is that of the task, which is suite A."""
        return None if self.suite == "A" else get_task(self.task).suite_seed + 1

    def evaluations(self, most: int | None = None) -> list[Evaluation]:
        """Return what is to be run, with ``most`` runs at most; a recording has no more than its windows."""
        task = get_task(self.task)
        runs = min(self.runs, most or self.runs, task.max_runs or self.runs)
        return [Evaluation.of(task, solver, {}, range(runs), self.seed) for solver in self.solvers]

    def cpu_s(self, cpu: Cpu) -> float:
        """Return the CPU time that it takes, as far as it has been measured, s."""
        return sum(cpu_s(cpu, self.task, one.solver, len(one.runs)) for one in self.evaluations())


def first() -> list[Portion]:
    """Return the portions of stage 1, of the tasks whose recordings are there."""
    return [Portion(name, RUNS, solvers) for name, solvers in PLAYED.items() if _there(name)]


def confirming(task: str, leader: str) -> Portion | None:
    """Return the portion of stage 2 for the leader of a task; None for a recording, which has no other runs."""
    return None if get_task(task).windows else Portion(task, RUNS, tuple(dict.fromkeys((leader, YARDSTICK))), "B")


def preliminary() -> list[Portion]:
    """Return the portions of slow solvers, of the tasks that are played."""
    return [Portion(name, FEW, solvers) for name, solvers in PRELIMINARY.items() if name in PLAYED]


def costed_for(task: str) -> str:
    """Return the task of COSTED on which the costs for this task are measured."""
    navigates = [_navigates(get_task(name)) for name in COSTED]
    wanted = _navigates(get_task(task))
    return COSTED[navigates.index(wanted)] if wanted in navigates else COSTED[0]


def _navigates(task: EvaluationTask) -> bool:
    return task.rank_by != "azimuth" or bool(task.score_from_s) or task.env_id == "SINS/NavFlight-v0"


def short(task: str) -> str:
    """Return the name of a task for tables: without version and family."""
    return task.removesuffix("-v0").removeprefix("sway-").removeprefix("flight-")


def tasks() -> list[EvaluationTask]:
    """Return the tasks of the suite in the catalogue's order; those of a missing recording are left out."""
    return [task for name, task in TASKS.items() if name in PLAYED and _there(name)]


@cache
def _there(name: str) -> bool:
    task = get_task(name)
    if not task.windows:
        return True
    try:
        task.make(1).close()
    except FileNotFoundError:
        return False
    return True


# ---- what it costs ----

BATCH, EPOCHS = 64, 60  #: runs of a batch whose CPU time is measured, and epochs of the fine phase that are timed
#: Solvers whose epochs do not cost the same all along, as hypotheses die or windows fill; a few of their runs are played whole.
VARYING, WHOLE = ("gsf_imm", "gsf_ekf", "fgo", "two_pass"), 16

Cpu = Mapping[str, Mapping[str, float]]  #: CPU microseconds of an epoch of a run, by task of COSTED and solver


@cache
def epochs_of(task: str) -> int:
    """Return the number of epochs of a run."""
    epoch_s, total_s = extent(get_task(task), 1)
    return round(total_s / epoch_s)


def known_cpu() -> dict[str, dict[str, float]]:
    """Return what was measured; empty if nothing was."""
    return dict(json.loads(CPU.read_text())) if CPU.exists() else {}


def cpu_s(cpu: Cpu, task: str, solver: str, runs: int) -> float:
    """Return the CPU time of so many runs, s, as if an epoch cost the same on all tasks of its kind; 0 if it is not known."""
    return 1e-6 * cpu.get(costed_for(task), {}).get(solver, 0.0) * epochs_of(task) * runs


def measure(task: EvaluationTask, solver: str) -> float:
    """Return the CPU microseconds of an epoch of a run, those of the environment with it."""
    host = Here(solver)
    runs = (WHOLE if solver in VARYING else BATCH) if host.batched else 1
    probe = Probe(task, host, runs, warm_up=10, clock=time.process_time)
    estimator_s, env_s, _ = probe.advance(probe.left if solver in VARYING else EPOCHS)
    probe.close()
    return 1e6 * float((estimator_s + env_s).mean()) / runs


def measure_all() -> None:
    """Measure every solver on the tasks of COSTED, and write suite.json."""
    portions = (*first(), *preliminary())
    pairs = list(dict.fromkeys((costed_for(one.task), solver) for one in portions for solver in one.solvers))
    found: dict[str, dict[str, float]] = {}
    keep_freed_memory()
    with threadpool_limits(1), Bar("CPU time of an epoch") as bar:
        for done, (task, solver) in enumerate(pairs):
            bar.update(done, len(pairs), f"{solver} on {short(task)}")
            found.setdefault(task, {})[solver] = float(f"{measure(get_task(task), solver):.3g}")
    rows = [f"{json.dumps(task)}: {json.dumps(solvers)}" for task, solvers in found.items()]
    write_text(CPU, "{\n" + ",\n".join(rows) + "\n}\n")


def plan(known: Cpu) -> Table:
    """Return the plan as a table: portions in order, with their CPU time."""
    table = Table(title="the default suite; CPU minutes with one thread, without stage 3")
    for name in ("stage", "task", "runs", "suite", "solvers", "CPU, min"):
        table.add_column(name, justify="left" if name in ("task", "suite", "solvers") else "right")
    total = 0.0
    for portion in first():
        dearest = max(portion.solvers, key=lambda name, task=portion.task: cpu_s(known, task, name, 1))
        for stage, one in ((1, portion), (2, confirming(portion.task, dearest))):
            if one:
                total += _add(table, stage, one, known)
    for portion in preliminary():
        total += _add(table, 2, portion, known)
    table.add_row("", "all", "", "", "", f"{total / 60:.1f}", style="bold")
    return table


def _add(table: Table, stage: int, portion: Portion, known: Cpu) -> float:
    total = portion.cpu_s(known)
    named = ", ".join(portion.solvers) if len(portion.solvers) < 10 else f"{len(portion.solvers)} solvers"
    runs = len(portion.evaluations()[0].runs)
    table.add_row(f"{stage}", short(portion.task), f"{runs}", portion.suite, named, f"{total / 60:.1f}")
    return total


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="the plan of the default suite")
    parser.add_argument("--measure", action="store_true", help="measure the CPU time of each solver again")
    given = parser.parse_args(arguments)
    if given.measure:
        measure_all()
    Console().print(plan(known_cpu()))


if __name__ == "__main__":
    main()
