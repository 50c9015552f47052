"""What a step of an estimator costs at one run, on one thread, and its ratio to ckf in the same process."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.guard import EstimatorError
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
    clock: Callable[[], float] = time.perf_counter,
) -> Cost | None:
    """Cost of a solver; blocks alternate with ckf's, so that a busy machine slows both. None if it raises.

    Args:
        timeout_s: a call of the solver that takes longer ends this process.
        clock: ``time.process_time`` counts CPU time, which a machine that is busy with other things changes little.
    """
    given = dict(settings or {})
    with threadpool_limits(1):
        try:
            probe = Probe(task, solver, given, warm_up=WARM_UP, clock=clock, timeout_s=timeout_s)
            same = solver == YARDSTICK and not given
            installed = YARDSTICK in finding.names()
            yardstick = None if same or not installed else Probe(task, YARDSTICK, {}, warm_up=WARM_UP, clock=clock)
            own: list[float] = []
            other: list[float] = []
            begin = clock()
            for _ in range(BLOCKS):
                own += probe.advance(BLOCK)[0].tolist()
                if yardstick:
                    other += yardstick.advance(BLOCK)[0].tolist()
                if clock() - begin > MOST_S:
                    break
        except EstimatorError:
            return None
    if not own:
        return None
    median, p95 = np.percentile(own, [50, 95]) * 1e6
    ratio = 1.0 if same else float(median / (np.median(other) * 1e6)) if other else None
    return Cost(float(median), float(p95), ratio)
