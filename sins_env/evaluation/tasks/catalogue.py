"""Catalogue of all tasks by name: those of the folder ``suite``, of installed packages, and of one's own files.

A task of one's own is a scenario, a YAML or JSON file or a dict (docs/scenarios.md). Wherever a name of a task is asked
for, the path of such a file may stand.
"""

from __future__ import annotations

import importlib.metadata
import math
import os
from collections import UserDict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sins_env import checks
from sins_env.checks import refused, unknown
from sins_env.envs import ENV_IDS
from sins_env.evaluation.bound import bounds
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.tasks import suite
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.scenarios.key import TASK
from sins_env.scenarios.scenario import Scenario, is_scenario
from sins_env.scenarios.table import COMMON

GROUP = "sins_env.tasks"  #: group of the entry points by which installed packages offer tasks
BOUNDS = 3.0  #: thresholds that are left out, over the bound at the end
HOLD_PART = 0.5  #: largest part of the scored time for which an error must hold, if a scenario does not say how long
STEP_DEG, STEP_ARCSEC = 0.1, 10.0  #: to which they are rounded up: azimuth, level
SPANNED = {"rank_by", "score_from_s", "hold_s"}  #: fields that must fit the length of a run and what solvers return
THRESHOLDS = ("delta_azimuth_deg", "delta_level_arcsec")

Given = str | os.PathLike[str] | Mapping[str, Any] | EvaluationTask  #: a name, a file, a dict, or a task itself


def suite_files() -> list[Path]:
    """Return the files of the suite, in the order of their names."""
    return sorted(
        (path for folder in suite.__path__ for path in Path(folder).glob("*.yaml")), key=lambda path: path.name
    )


def collect() -> dict[str, EvaluationTask]:
    """Return all tasks of the suite by name, those of one environment together, in the order of the environments.

    Raises:
        ValueError: a file that is no scenario or has no thresholds, or two tasks of one name.
    """
    known: dict[str, EvaluationTask] = {}
    for path in suite_files():
        scenario = Scenario.of(path)
        for name in THRESHOLDS:
            if name not in scenario.task:
                raise ValueError(f"{path}: no {name}; allowed in the suite: both thresholds of score")
        task = _task(scenario)
        if task.name in known:
            raise ValueError(f"{path}: a second task {task.name}; allowed: a name of its own")
        known[task.name] = task
    ordered = sorted(known.values(), key=lambda task: ENV_IDS.index(task.env_id))
    return {task.name: task for task in ordered}


def _task(scenario: Scenario, **more: float) -> EvaluationTask:
    fields = {"what": "", "source": ""} | more | {k: v for k, v in scenario.task.items() if k != "digest"}
    return EvaluationTask(env_id=scenario.env_id, kwargs=scenario.kwargs, **fields)


@cache
def suite_tasks() -> Mapping[str, EvaluationTask]:
    """Return the tasks of the suite by name, read once."""
    return collect()


class Tasks(UserDict[str, EvaluationTask]):
    """Tasks by name, whose files are read when a task is asked for first, not at the import."""

    def __init__(self) -> None:
        """Read nothing yet."""

    @cached_property
    def data(self) -> dict[str, EvaluationTask]:  # type: ignore[override]
        """All tasks by name."""
        return dict(suite_tasks())


#: Tasks of the suite, and those that :func:`register` has added.
TASKS = Tasks()


def load(given: Given) -> EvaluationTask:
    """Return the task of a scenario: a YAML or JSON file, or a dict; a task is returned as it is.

    Thresholds that it leaves out are three times the Cramer-Rao bound at the end, rounded up to 0.1 deg and 10 arcsec. The
    bound takes seconds, once. An error must hold for 60 s, or for half of what is scored if that is less.

    Raises:
        ValueError: what is no scenario (the error has the line), a name that a task of the suite has, another digest than
            that of the present world, or no thresholds where there is no bound.
        OSError: no such file, or one that cannot be read.
    """
    if isinstance(given, EvaluationTask):
        return given
    scenario = Scenario.of(given)
    missing = [name for name in THRESHOLDS if name not in scenario.task]
    task = _task(scenario, **dict.fromkeys(missing, 1.0))
    scored_s = _check_score(scenario, task)
    if "hold_s" not in scenario.task:
        task = replace(task, hold_s=min(task.hold_s, HOLD_PART * scored_s))
    if missing:
        found = bounds.find(task)
        if found is None or not np.isfinite(found.final).all():
            what = "score.azimuth_deg and score.level_arcsec are missing, and there is no bound from which they would follow"
            raise scenario.place.error(("score",), f"{what}; allowed: both")
        derived = thresholds(found)
        for name in missing:
            task = replace(task, **{name: derived[name]})  # type: ignore[arg-type]
    if _is_other(task):
        raise scenario.place.error(("name",), f"name = {task.name!r}, which a task of the suite has; allowed: another")
    if (wanted := scenario.task.get("digest")) and wanted != (now := digest(task)):
        raise scenario.place.error(("digest",), f"digest = {wanted!r}; allowed: {now}, that of the present world")
    return task


def _check_score(scenario: Scenario, task: EvaluationTask) -> float:
    """Check that what a scenario says of its score can be: quantities that solvers return, and spans within the run.

    Returns the time that is scored, s; infinity for a recording.
    """
    there = {key.path: key.to.removeprefix(TASK) for key in COMMON if key.to.startswith(TASK)}
    given = {path: scenario.task[name] for path, name in there.items() if name in SPANNED & scenario.task.keys()}
    if task.windows:  # the length of a recording is known when it is read
        navigates, end, coarse = task.kwargs.get("mode") == "navigate", math.inf, 0.0
    else:
        env = task.make(1)
        public = env.unwrapped.task  # type: ignore[attr-defined]
        env.close()
        navigates, end, coarse = public.navigate, public.duration_s, public.coarse_s
    faults = {
        "score.rank_by": "" if navigates or task.rank_by in ("azimuth", "failures") else "azimuth, failures",
        "score.from_s": "" if navigates or not task.score_from_s else "0",
        "score.hold_s": "" if task.hold_s <= end - coarse else f"at most {end - coarse:g}, the seconds that are scored",
    }
    if navigates and task.score_from_s >= end:
        faults["score.from_s"] = f"less than {end:g}, the seconds of the run"
    for path, allowed in faults.items():
        if path in given and allowed:
            why = "" if navigates or path == "score.hold_s" else ", for solvers return the attitude alone"
            raise scenario.place.error(
                tuple(path.split(".")), f"{path} = {checks.shown(given[path])}; allowed: {allowed}{why}"
            )
    return end - coarse


def _is_other(task: EvaluationTask) -> bool:
    """Return whether a task of the suite has the name of this one, but not its definition."""
    own = suite_tasks().get(task.name)
    return own is not None and replace(own, what="", source="") != replace(task, what="", source="")


def thresholds(bound: Bound) -> dict[str, float]:
    """Return the thresholds of a task that follow from its bound."""
    east, north, azimuth = BOUNDS * np.degrees(bound.final[:3])
    level = 3600.0 * max(east, north)
    return {
        "delta_azimuth_deg": round(max(math.ceil(azimuth / STEP_DEG - 1e-9), 1) * STEP_DEG, 9),
        "delta_level_arcsec": round(max(math.ceil(level / STEP_ARCSEC - 1e-9), 1) * STEP_ARCSEC, 9),
    }


def register(given: Given) -> EvaluationTask:
    """Add a task to those that this process knows by name, and return it: a task, a YAML or JSON file, or a dict.

    Raises:
        ValueError, OSError: as :func:`load`, or a task of the suite that has the name.
    """
    task = load(given)
    if _is_other(task):
        raise refused("name", task.name, "a name that no task of the suite has")
    TASKS[task.name] = task
    return task


def _points() -> dict[str, importlib.metadata.EntryPoint]:
    """Return the entry points of installed packages by the name of their task."""
    return {point.name: point for point in importlib.metadata.entry_points(group=GROUP) if point.group == GROUP}


def installed(name: str) -> EvaluationTask | None:
    """Return the task that an installed package offers under a name; None if none does.

    The entry point has the name of the task. It is a task, a path or a dict of a scenario, or a function that returns one.

    Raises:
        ValueError: the package offers anything else; the error names it.
    """
    point = _points().get(name)
    if point is None:
        return None
    try:
        found = point.load()
        found = found() if callable(found) else found
        task = load(found)
    except Exception as error:
        raise ValueError(f"task {name} of {point.value}: {type(error).__name__}: {error}") from error
    if task.name != name:
        raise ValueError(f"task {name} of {point.value} has the name {task.name}; allowed: that of its entry point")
    return task


def names() -> list[str]:
    """Return the names of all tasks."""
    return [*TASKS, *(name for name in _points() if name not in TASKS)]


def find(name: str) -> EvaluationTask | None:
    """Return the task of a name; None if there is none.

    Raises:
        ValueError: an installed package offers no task under its name.
    """
    if name not in TASKS:
        found = installed(name)
        if found is None:
            return None
        TASKS[name] = found
    return TASKS[name]


def file_of(name: str) -> Path | None:
    """Return the file of a task of the suite; None if there is none of that name."""
    return next((path for path in suite_files() if Scenario.of(path).task["name"] == name), None)


def named(given: Sequence[str]) -> list[str]:
    """Return names of tasks, where the file of a scenario stands for the name of its task, which is registered.

    Raises:
        ValueError, OSError: as :func:`register`.
    """
    return [register(one).name if is_scenario(one) else one for one in given]


def get_task(name: Given) -> EvaluationTask:
    """Return the task of a name, or of a scenario: a YAML or JSON file, or a dict; a task is returned as it is.

    Raises:
        ValueError: an unknown name (the nearest one is offered), or what is no scenario (the error has the line).
        OSError: no such file, or one that cannot be read.
    """
    if isinstance(name, EvaluationTask) or is_scenario(name):
        return load(name)
    found = find(str(name))
    if found is None:
        raise unknown("task", name, [*names(), "a YAML or JSON file of a scenario"])
    return found
