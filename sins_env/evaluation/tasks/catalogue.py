"""Catalogue of all tasks by name, from the files of the folder ``suite``."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from types import ModuleType

from sins_env.checks import unknown
from sins_env.envs import ENV_IDS
from sins_env.evaluation.tasks import suite
from sins_env.evaluation.tasks.task import EvaluationTask


def suite_files() -> Iterator[ModuleType]:
    """The files of ``suite``, in the order of their names.

    Raises:
        ImportError: a file without ``TASKS``.
    """
    for found in pkgutil.iter_modules(suite.__path__, f"{suite.__name__}."):
        file = importlib.import_module(found.name)
        tasks = getattr(file, "TASKS", None)
        if not isinstance(tasks, tuple) or not all(isinstance(task, EvaluationTask) for task in tasks):
            raise ImportError(f"{found.name}: TASKS = {tasks!r}; allowed: a tuple of EvaluationTask")
        yield file


def collect() -> dict[str, EvaluationTask]:
    """All tasks by name, those of one environment together, in the order of the environments.

    Raises:
        ImportError: a file without ``TASKS``, or two tasks of one name.
    """
    places = {env_id: place for place, env_id in enumerate(ENV_IDS)}
    known: dict[str, EvaluationTask] = {}
    for file in suite_files():
        for task in file.TASKS:
            if task.name in known:
                raise ImportError(f"{file.__name__}: a second task {task.name}; allowed: a name of its own")
            known[task.name] = task
    ordered = sorted(known.values(), key=lambda task: places.get(task.env_id, len(places)))
    return {task.name: task for task in ordered}


TASKS: dict[str, EvaluationTask] = collect()


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
