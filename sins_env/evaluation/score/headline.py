"""The score that a task is about: azimuth in alignment, and in navigation the quantity that the task names.

In alignment the error of a run is its RMS over the steady state, and in navigation over the scored span. A task that ranks by
failures is about the error at the end.
"""

from __future__ import annotations

import math

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.criteria import AZIMUTH
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.score.navigation import bound_means
from sins_env.evaluation.score.quantities import quantity, run_errors
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.units import ARCSEC, DEG

FAILURES = "failures"
BOUNDS = (
    3.0  #: cap of an error of navigation, over its bound; that of an azimuth in alignment is its threshold, 3.2 bounds
)
CAPS = 3.0  #: error beyond which a run has failed, over the cap; a level also fails beyond so many thresholds


def by_failures(task: EvaluationTask) -> bool:
    """Return whether the task is about the share of failed runs and the error at the end."""
    return task.rank_by == FAILURES


def headline(task: EvaluationTask) -> str:
    """Return the name of the quantity that a task is about; azimuth for a task that ranks by failures."""
    return "azimuth" if by_failures(task) else task.rank_by


def shown_headline(task: EvaluationTask) -> str:
    """Return the name of the headline quantity in tables, which show horizontal and vertical parts separately."""
    main = headline(task)
    return {"position": "position_h", "velocity": "velocity_h"}.get(main, main)


def error_of_run(task: EvaluationTask, records: Records) -> Array:
    """Return the error (R,) of each run that is scored, in rad, m/s or m, not negative."""
    over_time, at_end = run_errors(records, headline(task))
    return at_end if by_failures(task) else over_time


def cap_of(task: EvaluationTask, records: Records, bound: Bound | None, score: str | None = None) -> float:
    """Return the error at which losses are capped; NaN if it is one of navigation without a bound.

    It is the threshold of azimuth or level, the error at which a hot start has failed, or in navigation three bounds. ``score``
    is the name of a quantity; None takes the score of the task.
    """
    if by_failures(task) and score is None:
        return (task.fail_azimuth_deg or task.delta_azimuth_deg) * DEG
    name = score or headline(task)
    if records.criteria.navigates and bound:
        return BOUNDS * bound_means(records, bound)[name]
    if name == "azimuth":
        return task.delta_azimuth_deg * DEG
    return math.nan if records.criteria.navigates else task.delta_level_arcsec * ARCSEC


def bound_of(task: EvaluationTask, records: Records, bound: Bound | None) -> float:
    """Return the bound of the score, the RMS over the epochs that are scored; NaN if there is none."""
    criteria = records.criteria
    parts = list(quantity(headline(task), criteria.navigates).bounded)
    if bound is None or not parts or max(parts) >= len(bound.steady):
        return math.nan
    sigma = bound.sigma[criteria.span] if criteria.navigates else bound.steady[None]
    sigma = bound.final[None] if by_failures(task) else sigma
    return math.sqrt(float(np.square(sigma[:, parts]).sum(axis=1).mean())) if len(sigma) else math.nan


def failed_runs(task: EvaluationTask, records: Records, cap: float) -> Mask:
    """Return which runs have failed, (R,): by their status, or with an error or a level beyond CAPS times cap or threshold.

    Errors of navigation are those at the end, for its means over time begin at a start that may be far off.
    """
    criteria = records.criteria
    if not criteria.scored:
        return records.failed
    error = run_errors(records, headline(task))[1] if criteria.navigates else error_of_run(task, records)
    phi = np.abs(records.final if criteria.navigates else records.steady_rms)
    limit = cap if by_failures(task) else CAPS * cap
    level = (phi[:, :AZIMUTH] / criteria.delta[:AZIMUTH]).max(axis=1)
    return records.failed | _beyond(error, limit) | _beyond(level, CAPS)


def _beyond(values: Array, limit: float) -> Mask:
    """Return which values (R,) are beyond a limit or not finite; none if the limit or all values are unknown."""
    if math.isnan(limit) or np.isnan(values).all():
        return np.zeros(len(values), dtype=bool)
    return ~(values <= limit)
