"""Endurance: one day of data at epochs of a second, and what must hold all day long.

    python benchmarks/endurance.py                                   a day, the solvers that guides recommend
    python benchmarks/endurance.py ckf two_pass --hours 2 --runs 8   some solvers, for a shorter time

Sixteen runs of a swaying base are played in lockstep. At every epoch the quaternions of the answer and of the truth must have
unit length to 1e-12. The time must be the number of the epoch times its length, to the last bit. Every ten minutes of a day the
covariance of the filter must be finite, symmetric and positive definite. The NEES of the attitude, a mean over runs, must lie
in its 99.9 % band every hour. From the second hour on the process must not grow. A shorter time is divided in the same way.
A fixed-lag smoother, ``smoother``, takes the steps of ckf and is held against the truth of its lag. The exit code is 1 if
anything does not hold.
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import math
import resource
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.special import gammaincinv
from threadpoolctl import threadpool_limits

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.guard import Guard
from sins_env.evaluation.play.errors import nees
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask, solver_rng
from solvers.filters import make_filter
from solvers.pipeline.errors.alignment import PHI
from solvers.pipeline.estimator import Aligner
from solvers.smoothing import fixed_lag
from solvers.types import Filter, Gaussian, Measurement, Transition

SOLVERS = ("ckf", "ekf", "inekf", "gsf_ekf", "two_pass", "smoother")
N_SUB = 6  #: IMU samples per second of an epoch, a multiple of three
SMOOTHER, LAG = "smoother", 10  #: name of the smoother, and its lag in epochs
NORM = 1e-12  #: largest difference of a quaternion's length from 1
ROUNDING = 1e-12  #: largest asymmetry of a covariance, over its standard deviations
GROWTH_MIB = 8.0  #: most memory that a process may gain once it has settled
OUTSIDE = 1e-3  #: probability that a NEES lies outside its band
HOURS, LOOKS = 24, 144  #: number of times that the NEES is taken, and that a covariance is looked at


def task_of(hours: float, epoch_s: float = 1.0) -> EvaluationTask:
    """Return a task of so many hours: sway-white with longer epochs, and a fix at the end of each."""
    task = get_task("sway-white-v0")
    settings = {
        "duration": hours * 3600.0,
        "epoch": epoch_s,
        "n_sub": N_SUB * max(round(epoch_s), 1),
        "gps": {"rate_hz": 1.0 / epoch_s},
    }
    return dataclasses.replace(task, name="endurance", kwargs={**task.kwargs, **settings})


def band(runs: int) -> tuple[float, float]:
    """Return the band of the mean over runs of NEES / 3, which is chi-square with 3 degrees of freedom a run."""
    dof = 3 * runs
    low, high = (2.0 * float(gammaincinv(0.5 * dof, p)) / dof for p in (0.5 * OUTSIDE, 1.0 - 0.5 * OUTSIDE))
    return low, high


@dataclass
class Endured:
    """What was seen of one solver; the largest and least values are over runs and epochs."""

    runs: int
    epochs: int = 0
    norm: float = 0.0  #: largest difference from 1 of the length of an answered quaternion
    true_norm: float = 0.0  #: the same of the true ones
    late_s: float = 0.0  #: largest difference of the time from the number of the epoch times its length, s
    asymmetry: float = 0.0  #: largest asymmetry of a covariance, over its standard deviations
    least: float = math.inf  #: least eigenvalue of a covariance scaled to a unit diagonal; NaN if one was not finite
    nees: list[float] = field(default_factory=list)  #: mean over runs of NEES / 3, HOURS times
    repairs: int = 0  #: number of covariance repairs
    lost: int = 0  #: number of runs that the solver gave up
    grown_mib: float = 0.0  #: memory gained since it had settled, MiB
    cpu_s: float = 0.0

    def faults(self) -> list[str]:
        """Return in words what does not hold."""
        low, high = band(self.runs)
        outside = sum(not low <= value <= high for value in self.nees)
        found = {
            f"|q| off by {self.norm:.1e}": not self.norm < NORM,
            f"true |q| off by {self.true_norm:.1e}": not self.true_norm < NORM,
            f"time off by {self.late_s:.1e} s": self.late_s != 0.0,
            f"P asymmetric by {self.asymmetry:.1e}": not self.asymmetry < ROUNDING,
            f"P not positive definite, {self.least:.1e}": not self.least > 0.0,
            f"NEES outside its band {outside} times": outside > 0,
            f"{self.lost} runs lost": self.lost > 0,
            f"memory grew by {self.grown_mib:.1f} MiB": self.grown_mib > GROWTH_MIB,
        }
        return [text for text, wrong in found.items() if wrong]

    def look_at(self, P: Array) -> None:
        """Note the asymmetry and the least eigenvalue of covariances (..., n, n)."""
        scale = np.sqrt(np.abs(np.diagonal(P, axis1=-2, axis2=-1)))
        unit = P / (scale[..., :, None] * scale[..., None, :])
        if not np.isfinite(unit).all():
            self.least = self.asymmetry = math.nan
            return
        self.asymmetry = np.fmax(self.asymmetry, np.abs(unit - unit.mT).max())
        self.least = min(self.least, float(np.linalg.eigvalsh(0.5 * (unit + unit.mT)).min()))


class Spied:
    """A filter that another one feeds on: it keeps its last prior, and its last transition and fix."""

    batched = True

    def __init__(self, inner: Filter[Any]) -> None:
        self.inner = inner
        self.last: tuple[Transition, Measurement | None] | None = None

    def init(self, prior: Gaussian, rng: Any) -> Any:
        self.prior = prior
        return self.inner.init(prior, rng)

    def step(self, b: Any, tr: Transition, me: Measurement | None) -> Any:
        self.last = tr, me
        return self.inner.step(b, tr, me)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


def endure(
    solver: finding.Solver, task: EvaluationTask, runs: int, tell: Callable[[float, float], None] | None = None
) -> Endured:
    """Play a solver for the whole task, and return what was seen; ``tell`` is called with epochs done and their total."""
    spied, smooths, name = Spied(make_filter("ckf")), solver == SMOOTHER, finding.solver_name(solver)
    estimator = Aligner(spied, feedback="open") if smooths else finding.make(solver, {})
    env = task.make(runs, reveal_truth=True)
    obs, _ = task.reset(env, range(runs))
    loop = Loop(env, Guard(estimator, runs), obs, [solver_rng(task, name, run) for run in range(runs)])
    seen, begin = Endured(runs), time.process_time()
    lagged: deque[tuple[Array, Array]] = deque(maxlen=LAG + 1)

    def watched() -> Iterator[tuple[Transition, Measurement | None] | None]:
        second = loop.task.epoch_s
        before = math.nan
        for k, action, info, _, _ in loop:
            seen.epochs = k
            seen.norm = np.fmax(seen.norm, _off(action[:, :4]))
            seen.true_norm = np.fmax(seen.true_norm, _off(info["truth"]["q_nb"]))
            due = min(k + 1, loop.task.num_epochs) * second  # the observation after the last one repeats its time
            seen.late_s = np.fmax(seen.late_s, np.abs(loop.obs["t"] - due).max())
            if smooths:
                lagged.append((estimator.ins.nav.q_nb, info["truth"]["q_nb"]))
            elif _due(loop, LOOKS):
                seen.look_at(_covariance(estimator))
                if _due(loop, HOURS):
                    seen.nees.append(float(nees(info["errors"]["phi"], estimator.covariance()).mean()) / 3.0)
            if math.isnan(before) and _due(loop, HOURS):
                before = resident_mib()
            if tell and k % 60 == 0:
                tell(k, loop.task.num_epochs)
            yield spied.last
        seen.grown_mib = resident_mib() - before

    if smooths:
        _smooth(seen, watched(), spied, lagged, loop)
    else:
        deque(watched(), maxlen=0)
    repairs, _, frozen = loop.guard.health()
    seen.repairs, seen.lost = int(repairs.sum()), int((frozen >= 0).sum())
    seen.cpu_s = time.process_time() - begin
    loop.close()
    return seen


def _smooth(seen: Endured, steps: Any, spied: Spied, lagged: deque[tuple[Array, Array]], loop: Loop) -> None:
    """Smooth the steps, which carry the loop on, with a lag; look at the estimates as at those of a filter."""
    first = next(steps)  # the prior is known from the first epoch on
    chained = (step for part in ([first], steps) for step in part)
    for x in fixed_lag(spied.inner, spied.prior, chained, LAG):
        if not _due(loop, LOOKS):
            continue
        seen.look_at(x.cov)
        if _due(loop, HOURS):
            ins, true = lagged[0]
            phi = attitude.misalignment(ins, true)
            seen.nees.append(float(nees(attitude.wrap(phi - x.mean[:, PHI]), x.cov[:, PHI, PHI]).mean()) / 3.0)


def _covariance(estimator: Any) -> Array:
    """Return the covariance of all states of a pipeline; of another estimator, what it reports."""
    pipeline = getattr(estimator, "running", estimator)
    if getattr(pipeline, "belief", None) is None:
        return np.asarray(estimator.covariance())
    return np.asarray(pipeline.filter.estimate(pipeline.belief).cov)


def _off(q: Array) -> float:
    return float(np.abs(np.sqrt(np.square(q).sum(axis=-1)) - 1.0).max())


def _due(loop: Loop, times: int) -> bool:
    """Return whether the last epoch is one of so many that divide the task evenly."""
    return loop.k * times // loop.task.num_epochs != (loop.k - 1) * times // loop.task.num_epochs


def resident_mib() -> float:
    """Return the memory that this process holds now, MiB; on systems without /proc the most it has held."""
    gc.collect()
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * resource.getpagesize() / 2**20
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="a day of data at epochs of a second, and what must hold all day long")
    parser.add_argument("solvers", nargs="*", default=SOLVERS, help=f"names, default {' '.join(SOLVERS)}")
    parser.add_argument("--hours", type=float, default=24.0, help="length of a run (default %(default)s)")
    parser.add_argument("--runs", type=int, default=16, help="runs in lockstep (default %(default)s)")
    parser.add_argument("--epoch", type=float, default=1.0, help="length of an epoch, s (default %(default)s)")
    given = parser.parse_args(arguments)
    low, high = band(given.runs)
    title = (
        f"{given.hours:g} h at epochs of {given.epoch:g} s, {given.runs} runs; band of NEES / 3 {low:.2f} to {high:.2f}"
    )
    table = Table(title=title)
    headings = ("epochs", "||q| - 1|", "true", "least of P", "asymmetry", "NEES / 3", "repairs", "MiB", "CPU s")
    table.add_column("solver")
    for heading in headings:
        table.add_column(heading, justify="right")
    table.add_column("")
    failed = 0
    with threadpool_limits(1):
        for name in given.solvers:
            with Bar(f"{name}, {given.hours:g} h") as bar:
                seen = endure(name, task_of(given.hours, given.epoch), given.runs, lambda k, n: bar.update(k, n))
            faults = seen.faults()
            failed += bool(faults)
            spread = f"{min(seen.nees):.2f} to {max(seen.nees):.2f}" if seen.nees else "none"
            row = [f"{seen.epochs:,}", f"{seen.norm:.1e}", f"{seen.true_norm:.1e}", f"{seen.least:.1e}"]
            row += [f"{seen.asymmetry:.1e}", spread, f"{seen.repairs}", f"{seen.grown_mib:+.1f}", f"{seen.cpu_s:.0f}"]
            verdict = "; ".join(faults) or "holds"
            table.add_row(name, *row, verdict)
            told = ", ".join(f"{heading} {cell}" for heading, cell in zip(headings, row, strict=True))
            print(f"{name}: {verdict} ({told})", file=sys.stderr)
    Console().print(table)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
