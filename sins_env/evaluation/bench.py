"""Speed of the whole chain and its parts, per core: how many times faster than real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.evaluation import registry
from sins_env.evaluation.episode import Job, _Guard
from sins_env.evaluation.tasks import EvaluationTask, get_task

BATCHES = (256, 1)
WARM_UP, BLOCK = 20, 20  #: epochs
SECONDS = 4.0  #: spent on each batch size


class Speed(NamedTuple):
    """CPU time of one part at one batch size; the median over blocks of epochs."""

    part: str  #: "whole chain", "environment" or "estimator"
    runs: int
    real_time: float  #: simulated seconds of all runs per CPU second
    epoch_us: float  #: CPU time per run and epoch, microseconds


def measure(
    solver: registry.Solver,
    task: str | EvaluationTask = "sway-white-v0",
    settings: Mapping[str, Any] | None = None,
    batches: tuple[int, ...] = BATCHES,
    seconds: float = SECONDS,
    progress: Callable[[float, float], None] | None = None,
) -> list[Speed]:
    """Speed of environment and estimator, on one thread, in CPU time (a busy machine disturbs it little).

    Raises:
        ValueError: names or settings that do not fit. EstimatorError: the estimator fails.
    """
    out: list[Speed] = []
    for i, runs in enumerate(batches):

        def report(part: float, done: int = i) -> None:
            if progress:
                progress(done + part, len(batches))

        with threadpool_limits(1):
            parts = _blocks(get_task(task), solver, dict(settings or {}), runs, seconds, report)
        env_s, estimator_s, epoch = parts
        for part, times in (
            ("whole chain", env_s + estimator_s),
            ("environment", env_s),
            ("estimator", estimator_s),
        ):
            each = float(np.median(times)) / BLOCK
            out.append(Speed(part, runs, runs * epoch / each, 1e6 * each / runs))
    return out


def _blocks(
    task: EvaluationTask,
    solver: registry.Solver,
    settings: dict[str, Any],
    runs: int,
    seconds: float,
    report: Callable[[float], None],
) -> tuple[np.ndarray, np.ndarray, float]:
    """CPU seconds of environment and estimator per block of the fine phase, and the length of an epoch."""
    env = task.make(runs)
    obs, _ = task.reset(env, range(runs))
    public = env.unwrapped.task  # type: ignore[attr-defined]
    guard = _Guard(registry.make(solver, settings), runs)
    if not guard.batched and runs > 1:
        raise ValueError(f"{registry.solver_name(solver)} is not batched; allowed: bench of batched solvers")
    guard.reset(public, Job(task, solver, tuple(range(runs))).rngs())
    skip = round(public.coarse_s / public.epoch_s) + WARM_UP
    for _ in range(skip):
        obs = env.step(guard.step(obs))[0]
    env_s, estimator_s = [], []
    begin = time.perf_counter()
    for _ in range((public.num_epochs - skip) // BLOCK):
        spent = [0.0, 0.0]
        for _ in range(BLOCK):
            t0 = time.process_time()
            action = guard.step(obs)
            t1 = time.process_time()
            obs = env.step(action)[0]
            spent[0] += t1 - t0
            spent[1] += time.process_time() - t1
        estimator_s.append(spent[0])
        env_s.append(spent[1])
        passed = time.perf_counter() - begin
        report(min(passed / seconds, 1.0))
        if passed > seconds:
            break
    env.close()
    return np.array(env_s), np.array(estimator_s), public.epoch_s
