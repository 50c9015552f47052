"""Cost of a step of an estimator with one run, on one thread, and its ratio to that of ckf."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import ExitStack, closing
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.guard import Clock, EstimatorError
from sins_env.evaluation.estimators.isolation import hosted, limits
from sins_env.evaluation.play.executors import Processes, Runner
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.speed.timing import Probe
from sins_env.evaluation.tasks.task import EvaluationTask

YARDSTICK = "ckf"
WARM_UP, BLOCK, BLOCKS = 30, 20, 15  #: epochs before the measurement, epochs of a block, number of blocks
MOST_S = 3.0  #: longest measurement of a slow estimator, which is at least one block


class Cost(NamedTuple):
    """Time of ``step`` per epoch of the fine phase, microseconds."""

    median_us: float
    p95_us: float
    ratio: float | None  #: median over the median of ckf; None if ckf is not installed


def measure_cost(
    task: EvaluationTask,
    solver: finding.Solver,
    settings: Mapping[str, Any] | None = None,
    timeout_s: float | None = None,
    clock: Clock = time.perf_counter,
) -> Cost | None:
    """Measure the cost of a solver; its blocks alternate with those of ckf, so that a busy machine slows both.

    Args:
        task: task to play.
        solver: a name, ``module:Factory``, or a class or function.
        settings: settings of the solver.
        timeout_s: longest time of a call; None is the usual. If the solver has a process of its own, so has ckf. The time
            from request to answer is taken here, where a solver cannot change the clock. Without the way there and back, as
            measured with ckf, it is the least that the solver's own figure may be.
        clock: clock of the measurement; ``time.process_time`` counts CPU time, which a busy machine disturbs little.

    Returns:
        the cost, or None if the solver raises an exception or no epoch is left after the warm-up.
    """
    given = dict(settings or {})
    same = solver == YARDSTICK and not given
    own: list[tuple[float, float]] = []  # seconds by the clock here, and as told
    other: list[tuple[float, float]] = []
    apart = limits(solver, timeout_s) is not None
    played = [(solver, given, timeout_s, own)]
    if not same and finding.is_own(YARDSTICK):
        played.append((YARDSTICK, {}, math.inf if apart else None, other))
    with threadpool_limits(1), ExitStack() as stack:
        try:
            timed: list[tuple[Probe, list[tuple[float, float]]]] = []
            for name, settings, limit_s, times in played:
                host = stack.enter_context(hosted(name, settings, limit_s))
                timed.append((stack.enter_context(closing(Probe(task, host, warm_up=WARM_UP, clock=clock))), times))
            spent = 0.0
            for _ in range(BLOCKS):
                for probe, times in timed:
                    estimator_s, env_s, told_s = probe.advance(BLOCK)
                    times += zip(estimator_s.tolist(), told_s.tolist(), strict=True)
                    spent += float(estimator_s.sum() + env_s.sum())
                if spent > MOST_S:
                    break
        except EstimatorError:
            return None
    if not own:
        return None
    here_s, told_s = np.array(own).T
    yardstick_s, yardstick_told_s = np.array(own if same else other or [(0.0, 0.0)]).T
    way_s = np.median(yardstick_s - yardstick_told_s)
    median, p95 = np.maximum(np.percentile(here_s, [50, 95]) - way_s, np.percentile(told_s, [50, 95])) * 1e6
    ratio = 1.0 if same else float(median / (np.median(yardstick_told_s) * 1e6)) if other else None
    return Cost(float(median), float(p95), ratio)


def cost_of(job: Job, where: Runner) -> Cost | None:
    """Measure the cost of a job's solver, in a worker if there are any; None if the solver raises or ends the worker."""
    what = job.task, job.solver, job.settings, job.epoch_timeout_s
    return where.call(measure_cost, *what) if isinstance(where, Processes) else measure_cost(*what)
