"""Computation of a forecast: one pass over the true motion of a task, with the covariances of all that is asked."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.bound.bounds import RUNS
from sins_env.evaluation.bound.error_dynamics import ErrorDynamics, simulated, true_motion
from sins_env.evaluation.planning import beyond
from sins_env.evaluation.planning.beyond import Course, Recorder
from sins_env.evaluation.planning.curves import Reached
from sins_env.evaluation.planning.forecast import Forecast
from sins_env.evaluation.planning.quantities import QUANTITIES, Wanted, wanted
from sins_env.evaluation.planning.recursion import advanced, stack
from sins_env.evaluation.planning.sources import Source, sources
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.specs import ImuSpec
from sins_env.states import Layout
from sins_env.types import Task

BUDGET_RUNS = 4  #: runs over which shares are averaged; they differ from those of all runs in the third digit
#: Errors of the IMU that count as known, so that they are in no budget.
KNOWN = ("scale_ppm", "misalignment_arcsec", "gyro_lsb_arcsec", "accel_lsb_mps")


def forecast(
    task: str | EvaluationTask,
    until: str | Iterable[str] | Mapping[str, str] = (),
    budget: bool = True,
    runs: int = RUNS,
) -> Forecast:
    """Return the bound of a task over time; it takes seconds, and plays no run.

    Args:
        task: a task or its name.
        until: wanted accuracies, such as "0.1deg" or "level=20arcsec".
        budget: whether to find the share of each source of error, and the bound without it.
        runs: number of runs of the suite to average over; only their motion enters, and a flight takes one.

    Raises:
        ValueError: a task without a bound, settings that it refuses, or an accuracy that is none.
    """
    task, asked = get_task(task), wanted(until)
    found = simulated(task)
    if found is None:
        why = "a recording has no simulated truth" if task.windows else "fixes that say that the car stands have no law"
        raise ValueError(f"{task.name} has no bound: {why}; allowed: a simulated task with a receiver")
    public, world = found
    model = ErrorDynamics(world)
    states, there = model.states, [name for name, q in QUANTITIES.items() if q.places(model.states)]
    for one in asked:
        if one.quantity not in there:
            raise ValueError(f"until = {one.text!r} of {one.quantity}; {task.name} has {', '.join(there)}")
    parts = sources(model) if budget else []
    way = _walk(task, public, model, 1 if public.navigate else runs, parts)
    later = {name: QUANTITIES[name].size(np.array(list(map(_variances, way.course.P))), states) for name in there}
    t = np.asarray(public.epoch_s * np.arange(1, public.num_epochs + 1), dtype=float)
    out = Forecast(
        task=task,
        t=t,
        sigma={name: QUANTITIES[name].size(way.variances, states) for name in there},
        sources=tuple(one.name for one in parts),
        budget_t=t[way.budget_at],
        shares={},
        without={},
        limit={name: float(sizes[-1]) for name, sizes in later.items()},
        settled={name: bool(abs(sizes[-1] - sizes[-2]) < beyond.SETTLED * sizes[-2]) for name, sizes in later.items()},
        repeated_s=way.course.span_s,
        reached=(),
        holds=bool(world.settings.gaussian_start and all(term.holds for _, term in model.aids.values())),
        known=_known(world.imu.spec),
    )
    if parts:
        out = dataclasses.replace(out, **_budget(out, way, states))
    return dataclasses.replace(out, reached=tuple(_reached(out, one, way.course, states) for one in asked))


class _Way(NamedTuple):
    """What is kept of one pass over the true motion."""

    variances: Array  #: (K, n) of the states at the end of each epoch
    in_parts: Array  #: (B, members, n) of the members of the budget's stack
    budget_at: list[int]  #: indices of their epochs
    course: Course  #: how it goes on if the last part of the motion is repeated


def _walk(task: EvaluationTask, public: Task, model: ErrorDynamics, runs: int, parts: list[Source]) -> _Way:
    few = min(runs, BUDGET_RUNS)
    whole, members = stack(model, runs), stack(model, few, parts)
    R = {name: all_of_them[0] for name, all_of_them in whole.R.items()}
    repeated = max(1, min(round(beyond.REPEATED_S / public.epoch_s), public.num_epochs // 2))
    recorder, every = Recorder(model, runs), max(1, round(1.0 / public.epoch_s))
    variances, in_parts, budget_at = [], [], []
    for part in true_motion(task, public, runs):
        F, readings = model.transitions(part), model.readings(part)
        added = model.densities(part) * model.epoch_s
        for k in range(len(part.fix)):
            epoch = part.first + k + 1
            whole = advanced(whole, F[:, k], added[k], readings, k)
            variances.append(_variances(whole.P[0]))
            if parts:
                members = advanced(members, F[:few, k], added[k], readings, k)
                if epoch % every == 0 or epoch == public.num_epochs:
                    in_parts.append(_variances(members.P))
                    budget_at.append(epoch - 1)
            if epoch > public.num_epochs - repeated:
                recorder.add(F[:, k], added[k], readings, R, k)
    course = beyond.repeated(recorder, whole.P[0], repeated * public.epoch_s)
    return _Way(np.array(variances), np.array(in_parts), budget_at, course)


def _variances(P: Array) -> Array:
    """Return the variances (..., n) of P (..., runs, n, n), averaged over the runs."""
    return np.asarray(np.diagonal(P, axis1=-2, axis2=-1).mean(axis=-2), dtype=float)


def _budget(out: Forecast, way: _Way, states: Layout) -> dict[str, Any]:
    """Return shares and bounds without each source. The stack holds the whole, all without one source, and each source alone."""
    shares, without, count = {}, {}, len(out.sources)
    for name, curve in out.sigma.items():
        size = QUANTITIES[name].size(way.in_parts, states)
        relative = size / size[:, :1]
        without[name] = curve[way.budget_at, None] * relative[:, 1 : 1 + count]
        shares[name] = relative[:, 1 + count :] ** 2
    return {"shares": shares, "without": without}


def _reached(out: Forecast, asked: Wanted, course: Course, states: Layout) -> Reached:
    q, curve, end = QUANTITIES[asked.quantity], out.sigma[asked.quantity], float(out.t[-1])
    within = curve <= asked.size
    outside = np.flatnonzero(~within)
    first = float(out.t[np.argmax(within)]) if within.any() else math.inf
    holds = math.inf if not within[-1] else float(out.t[outside[-1] + 1]) if len(outside) else float(out.t[0])
    later = math.inf
    if not within[-1]:
        later = end + course.first(lambda P: bool(q.size(_variances(P), states) <= asked.size))
    limit, settled = out.limit[asked.quantity], out.settled[asked.quantity]
    return Reached(asked, first, holds, float(curve.min()), later, limit, settled)


def _known(imu: ImuSpec) -> tuple[str, ...]:
    return tuple(name for name in KNOWN if getattr(imu, name))
