"""What a step of an estimator costs at one run, on one thread, and its ratio to ckf in the same process."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import ExitStack, closing
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.guard import Clock, EstimatorError
from sins_env.evaluation.estimators.isolation import Here, hosted
from sins_env.evaluation.play.executors import Processes, Runner
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.speed.timing import Probe
from sins_env.evaluation.tasks.task import EvaluationTask

YARDSTICK = "ckf"
WARM_UP, BLOCK, BLOCKS = 30, 20, 15  #: epochs, epochs, number of blocks timed
MOST_S = 3.0  #: a slow estimator is timed for no longer, but for one block at least


class Cost(NamedTuple):
    """Time of ``step`` per epoch of the fine phase, microseconds."""

    median_us: float
    p95_us: float
    ratio: float | None  #: of the median to that of ckf; None where ckf is not installed


def measure_cost(
    task: EvaluationTask,
    solver: finding.Solver,
    settings: Mapping[str, Any] | None = None,
    timeout_s: float | None = None,
    clock: Clock = time.perf_counter,
) -> Cost | None:
    """Cost of a solver; blocks alternate with ckf's, so that a busy machine slows both. None if it raises.

    Args:
        timeout_s: of a call; the solver then has a process of its own, and its time is taken there.
        clock: ``time.process_time`` counts CPU time, which a machine that is busy with other things changes little.
    """
    given = dict(settings or {})
    same = solver == YARDSTICK and not given
    compared = not same and YARDSTICK in finding.names()
    own: list[float] = []
    other: list[float] = []
    with threadpool_limits(1), hosted(solver, given, timeout_s) as host, ExitStack() as stack:
        try:
            timed: list[tuple[Probe, list[float]]] = []
            for one, times in ((host, own), *([(Here(YARDSTICK), other)] if compared else [])):
                probe = Probe(task, one, warm_up=WARM_UP, clock=clock)
                timed.append((stack.enter_context(closing(probe)), times))
            spent = 0.0
            for _ in range(BLOCKS):
                for probe, times in timed:
                    estimator_s, env_s = probe.advance(BLOCK)
                    times += estimator_s.tolist()
                    spent += float(estimator_s.sum() + env_s.sum())
                if spent > MOST_S:
                    break
        except EstimatorError:
            return None
    if not own:
        return None
    median, p95 = np.percentile(own, [50, 95]) * 1e6
    ratio = 1.0 if same else float(median / (np.median(other) * 1e6)) if other else None
    return Cost(float(median), float(p95), ratio)


def cost_of(job: Job, where: Runner) -> Cost | None:
    """Cost of a job's solver, measured in a worker where there are some; None if it raises or ends that."""
    what = job.task, job.solver, job.settings, job.epoch_timeout_s
    return where.call(measure_cost, *what) if isinstance(where, Processes) else measure_cost(*what)
