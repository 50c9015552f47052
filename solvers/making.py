"""Solvers by name, complete as ``sins-env`` runs them: what they are called, what they take, and one that is made."""

from __future__ import annotations

import inspect
from typing import Any

from sins_env.checks import unknown
from sins_env.types import Estimator
from solvers import filters, pipeline
from solvers.pipeline.estimator import Pipeline
from solvers.pipeline.settings import Settings
from solvers.registry import ESTIMATORS, FILTERS, class_of, import_all, register

__all__ = ["Pipeline", "describe", "make", "names", "register", "settings"]

import_all(pipeline.__path__, pipeline.__name__)

_PIPELINE = tuple(inspect.signature(Settings).parameters)


def names() -> list[str]:
    """Every name that :func:`make` takes."""
    return sorted([*FILTERS, *ESTIMATORS])


def settings(name: str) -> list[inspect.Parameter]:
    """What :func:`make` takes for ``name``, with defaults: the filter's own settings, then the pipeline's."""
    own = list(inspect.signature(class_of(name)).parameters.values())
    if name in ESTIMATORS:
        return own
    return [p.replace(kind=p.KEYWORD_ONLY) for p in (*own, *inspect.signature(Settings).parameters.values())]


def describe(name: str) -> str:
    """The docstring of the filter or estimator ``name``."""
    return inspect.getdoc(class_of(name)) or ""


def make(name: str, **given: Any) -> Estimator:
    """The estimator ``name``: the pipeline around that filter, for tasks of alignment and of navigation.

    The settings given are those of the pipeline, :class:`solvers.pipeline.settings.Settings`, and of the filter.

    Raises:
        ValueError: an unknown name or setting, with the nearest valid one.
    """
    if name not in names():
        raise unknown("solver", name, names())
    allowed = [p.name for p in settings(name)]
    for key in given:
        if key not in allowed:
            raise unknown(f"setting of {name}", key, allowed)
    if name in ESTIMATORS:
        made: Estimator = ESTIMATORS[name](**given)
        return made
    around = {key: given.pop(key) for key in _PIPELINE if key in given}
    return Pipeline(filters.make_filter(name, **given), **around)
