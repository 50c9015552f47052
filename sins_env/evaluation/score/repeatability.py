"""Repeatability of the heading: the scatter of runs at the same heading, without an error that all of them share.

000 tables 6.4 to 6.8 give the standard deviation of the final heading over ten records, for each of three headings. Here
it is that of the heading error, because people move the car and the true headings of simulated records differ. If errors
are not scored, it is that of the heading itself. Each simulated run draws new sensor biases, so they contribute, too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.score.metrics import heading_deviations
from sins_env.evaluation.score.resampling import NO_INTERVAL, Interval, rms_interval
from sins_env.evaluation.tasks.task import EvaluationTask


class Repeatability(NamedTuple):
    """Standard deviation of the heading within a group of runs, or within all groups."""

    group: str  #: name of the group, such as "149.4°", or "all"
    runs: int  #: number of runs with a final heading, in groups of at least two
    deg: float  #: standard deviation, deg; NaN if there is no such group
    interval: Interval  #: 95 % BCa interval over runs, deg


def shares_headings(task: EvaluationTask) -> bool:
    """Return whether several runs of the task share a heading, so that they have a repeatability."""
    return task.windows > 1 or task.records > 1


def repeatability(records: Records, task: EvaluationTask) -> list[Repeatability]:
    """Return the repeatability at each heading of the task, in the order of its records, and last that of all together.

    The last is the root of the mean variance. A recording is one group, and so is a simulation without records.
    """
    there = np.isfinite(records.heading) & ~records.unfinished
    values = records.final[there, 2] if records.criteria.scored else records.heading[there]
    names, group = _groups(task, records.run[there])
    away = [heading_deviations(values[group == i]) for i in range(len(names))]
    out = [_spread(name, one) for name, one in zip(names, away, strict=True)]
    return [*out, _spread("all", np.concatenate(away))] if len(out) > 1 else out


def _groups(task: EvaluationTask, run: NDArray[np.int64]) -> tuple[list[str], NDArray[np.int64]]:
    """Return the names of the groups, and for each run the index of its group."""
    headings = task.kwargs.get("heading_deg")
    if not task.records or not isinstance(headings, (list, tuple)):
        return ["all"], np.zeros(len(run), dtype=np.int64)
    own = list(dict.fromkeys(headings))
    group = np.array([own.index(headings[i]) for i in run % task.records], dtype=np.int64)
    return [f"{heading:g}°" for heading in own], group


def _spread(group: str, deviations: Array) -> Repeatability:
    if not len(deviations):
        return Repeatability(group, 0, math.nan, NO_INTERVAL)
    value, interval = rms_interval(np.degrees(deviations))
    return Repeatability(group, len(deviations), value, interval)
