"""Catalogue of all tasks by name, from the files of the folder ``suite``."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

from sins_env.checks import unknown
from sins_env.envs import ENV_IDS
from sins_env.evaluation.tasks import suite
from sins_env.evaluation.tasks.task import EvaluationTask


def _files() -> Iterator[tuple[str, tuple[EvaluationTask, ...]]]:
    """Yield the name of each file of ``suite`` and its tasks.

    Raises:
        ImportError: a file without ``TASKS``.
    """
    for found in pkgutil.iter_modules(suite.__path__, f"{suite.__name__}."):
        tasks = getattr(importlib.import_module(found.name), "TASKS", None)
        if not isinstance(tasks, tuple) or not all(isinstance(task, EvaluationTask) for task in tasks):
            raise ImportError(f"{found.name}: TASKS = {tasks!r}; allowed: a tuple of EvaluationTask")
        yield found.name, tasks


def _by_name() -> dict[str, EvaluationTask]:
    """Return all tasks by name, in the order of their environments.

    Raises:
        ImportError: two tasks of one name.
    """
    places = {env_id: place for place, env_id in enumerate(ENV_IDS)}
    known: dict[str, EvaluationTask] = {}
    for file, tasks in _files():
        for task in tasks:
            if task.name in known:
                raise ImportError(f"{file}: a second task {task.name}; allowed: a name of its own")
            known[task.name] = task
    ordered = sorted(known.values(), key=lambda task: places.get(task.env_id, len(places)))
    return {task.name: task for task in ordered}


TASKS: dict[str, EvaluationTask] = _by_name()


def names() -> list[str]:
    """Return the names of all tasks."""
    return list(TASKS)


def get_task(name: str | EvaluationTask) -> EvaluationTask:
    """Return the task of a name; a task is returned as it is.

    Raises:
        ValueError: an unknown name; the error offers the nearest one.
    """
    if isinstance(name, EvaluationTask):
        return name
    if name not in TASKS:
        raise unknown("task", name, TASKS)
    return TASKS[name]
