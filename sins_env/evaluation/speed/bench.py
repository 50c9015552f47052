"""Speed of the whole chain and its parts, per core: how many times faster than real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.isolation import Host
from sins_env.evaluation.estimators.memory import keep_freed_memory
from sins_env.evaluation.speed.timing import Probe
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask

BATCHES = (256, 1)
WARM_UP, BLOCK = 20, 20  #: number of epochs before the measurement, and in a block
SECONDS = 4.0  #: duration of the measurement of each batch size


class Speed(NamedTuple):
    """CPU time of one part at one batch size, the median over blocks of epochs."""

    part: str  #: "whole chain", "environment" or "estimator"
    runs: int
    real_time: float  #: simulated seconds of all runs per CPU second
    epoch_us: float  #: CPU time per run and epoch, microseconds


def fitting(host: Host, task: str | EvaluationTask, batches: Sequence[int]) -> tuple[tuple[int, ...], list[str]]:
    """Return the batch sizes that solver and task allow, each once, and a remark on each that was changed."""
    task, remarks = get_task(task), []
    sizes = []
    for runs in batches:
        if runs > 1 and not host.batched:
            remarks.append(f"{finding.solver_name(host.solver)} takes one run at a time: 1 run instead of {runs}")
            runs = 1
        elif task.max_runs is not None and runs > task.max_runs:
            remarks.append(f"{task.name}: {task.max_runs} runs instead of {runs}, the windows of its recording")
            runs = task.max_runs
        sizes.append(runs)
    return tuple(dict.fromkeys(sizes)), remarks


def measure(
    host: Host,
    task: str | EvaluationTask = "sway-white-v0",
    batches: Sequence[int] = BATCHES,
    seconds: float | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> list[Speed]:
    """Measure the speed of environment and estimator on one thread, in CPU time, which a busy machine disturbs little.

    Args:
        host: solver. If it has a process of its own, the estimator's time is the CPU time of both processes, by the kernel's
            clock, and so has that of the way there and back in it.
        task: a task or its name.
        batches: numbers of runs, as :func:`fitting` gives them.
        seconds: duration of the measurement of each; None takes SECONDS.
        progress: function called with the batches done and with their number.

    Raises:
        ValueError: names or numbers of runs that do not fit.
        EstimatorError: the estimator fails.
    """
    keep_freed_memory()
    task, most = get_task(task), SECONDS if seconds is None else seconds
    out: list[Speed] = []
    for i, runs in enumerate(batches):

        def report(part: float, done: int = i) -> None:
            if progress:
                progress(done + part, len(batches))

        host.renew()
        with threadpool_limits(1), closing(Probe(task, host, runs, WARM_UP, time.process_time)) as probe:
            estimator_s, env_s = _blocks(probe, most, report)
        if not len(env_s):
            raise ValueError(f"{task.name} is too short to be timed; allowed: {WARM_UP + BLOCK} fine epochs or more")
        for part, times in (
            ("whole chain", env_s + estimator_s),
            ("environment", env_s),
            ("estimator", estimator_s),
        ):
            each = float(np.median(times)) / BLOCK
            out.append(Speed(part, runs, runs * probe.epoch_s / each, 1e6 * each / runs))
    return out


def _blocks(probe: Probe, seconds: float, report: Callable[[float], None]) -> tuple[np.ndarray, np.ndarray]:
    """Return CPU seconds of estimator and of environment in each block of epochs."""
    spent = []
    begin = time.perf_counter()
    while probe.left >= BLOCK:
        spent.append([part.sum() for part in probe.advance(BLOCK)[:2]])
        passed = time.perf_counter() - begin
        report(min(passed / seconds, 1.0))
        if passed > seconds:
            break
    estimator_s, env_s = np.array(spent).reshape(-1, 2).T
    return estimator_s, env_s
