"""The public question: the bound of a task, and of the same task with other settings."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

from sins_env import checks
from sins_env.envs.environments import ENVIRONMENTS
from sins_env.evaluation.planning.compute import forecast
from sins_env.evaluation.planning.forecast import Forecast
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.scenarios.key import TASK
from sins_env.scenarios.motions import KINDS
from sins_env.scenarios.table import keys_of

MOST_MEMBERS = 24  #: most members of a family


def bound(
    task: str | EvaluationTask,
    until: str | Iterable[str] | Mapping[str, str] = (),
    compare: Mapping[str, Sequence[Any]] | None = None,
    budget: bool = True,
) -> Forecast:
    """Return the Cramer-Rao bound of a task over time, its budget by source of error, and when an accuracy is reached.

    No run is played, and it takes seconds. ``sins_env.bound("sway-white-v0", until="0.1deg").rows()``

    Args:
        task: a task or its name.
        until: wanted accuracies, such as "0.1deg" or "level=20arcsec".
        compare: settings with some values each, such as {"gps.rate_hz": [1, 5, 10]}; ``family`` of the result has every
            combination.
        budget: whether to find the share of each source of error, and the bound without it.

    Raises:
        ValueError: a task without a bound, settings that it refuses, an accuracy that is none, or more than 24 members.
    """
    task, settings = get_task(task), dict(compare or {})
    for name, values in settings.items():
        if checks.items(values) in (None, []):
            raise checks.refused(f"compare {name}", values, "a list of values, such as {'gps.rate_hz': [1, 5, 10]}")
    combinations = list(itertools.product(*settings.values())) if settings else []
    if len(combinations) > MOST_MEMBERS:
        raise ValueError(f"{len(combinations)} members of the family; allowed: at most {MOST_MEMBERS}")
    whole, family = forecast(task, until, budget), {}
    for values in combinations:
        other, label = task, []
        for name, value in zip(settings, values, strict=True):
            other = varied(other, name, value)
            label.append(f"{name} = {value if isinstance(value, str) else checks.shown(value)}")
        family[", ".join(label)] = forecast(other, until, budget=False)
    return dataclasses.replace(whole, family=family)


def varied(task: EvaluationTask, name: str, value: Any) -> EvaluationTask:
    """Return a task with another setting, whose runs have the same seeds, and so the same motions.

    ``name`` is a key of a scenario, such as "duration_s" or "site.latitude_deg", or a setting of the environment. A field of either
    stands behind a dot, as in "gps.rate_hz".
    """
    path = _setting(task, name).split(".")
    kwargs = {**task.kwargs, path[0]: _within(task.kwargs.get(path[0], _default(task, path[0])), path[1:], value, name)}
    return dataclasses.replace(task, kwargs=kwargs, seeds_of=task.seeds_of or task.name)


def _setting(task: EvaluationTask, name: str) -> str:
    """Return the setting that a key of a scenario means, with the fields that stand behind it."""
    for kind in (kind for kind in KINDS.values() if kind.env_id == task.env_id):
        keys = keys_of(kind)
        for path in sorted(keys, key=len, reverse=True):
            to = kind.target(keys[path])
            if to and not to.startswith(TASK) and f"{name}.".startswith(f"{path}."):
                return to + name.removeprefix(path)
    return name


def _default(task: EvaluationTask, name: str) -> Any:
    """Return what the environment of the task takes for a setting that is not given."""
    known = ENVIRONMENTS.get(task.env_id)
    return next((f.default for f in fields(known.single.settings) if f.name == name), None) if known else None


def _within(now: Any, path: Sequence[str], value: Any, name: str) -> Any:
    """Return a setting with another value at a path of fields; the name of a preset is one of its fields."""
    if not path:
        return value
    if isinstance(now, str):
        now = {"preset": now}
    if not isinstance(now or {}, Mapping):
        raise ValueError(
            f"{name}: {checks.shown(now)} has no field {path[0]!r}; allowed: a field of a dict or of a preset"
        )
    fields_now = dict(now or {})
    return {**fields_now, path[0]: _within(fields_now.get(path[0]), path[1:], value, name)}
