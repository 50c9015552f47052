"""solvers: the mathematics. Every filter of the sources as a small frozen dataclass, and the pipeline around it.

    make("ckf")                             the complete estimator, as ``sins-env`` runs it: aligns or navigates as the task asks
    make("ckf", feedback="closed")          settings of the pipeline and of the filter, by name
    names()                                 what there is
    @register("mine")                       make a filter of your own known by name

The bare filters are in :mod:`solvers.filters`, the contract in :mod:`solvers.types`.
"""

from __future__ import annotations

import inspect
from typing import Any

from sins_env.checks import unknown
from sins_env.types import Estimator
from solvers import filters
from solvers.filters import register
from solvers.pipeline import coarse_only as coarse
from solvers.pipeline.estimator import Pipeline
from solvers.pipeline.settings import Settings
from solvers.pipeline.two_pass import TwoPass

__all__ = ["describe", "make", "names", "register", "settings"]

_PIPELINE = tuple(inspect.signature(Settings).parameters)
#: Complete estimators, not made around a filter of choice.
_COMPLETE: dict[str, type] = {
    "coarse_inertial": coarse.CoarseInertial,
    "coarse_oba": coarse.CoarseOba,
    "coarse_analytic1": coarse.CoarseAnalytic1,
    "coarse_analytic2": coarse.CoarseAnalytic2,
    "coarse_analytic3": coarse.CoarseAnalytic3,
    "two_pass": TwoPass,
}


def names() -> list[str]:
    """Every name that :func:`make` takes."""
    return sorted([*filters.names(), *_COMPLETE])


def settings(name: str) -> list[inspect.Parameter]:
    """What :func:`make` takes for ``name``, with defaults: the filter's own settings, then the pipeline's."""
    if name in _COMPLETE:
        return list(inspect.signature(_COMPLETE[name]).parameters.values())
    own = inspect.signature(filters.FILTERS[name]).parameters.values()
    pipeline = inspect.signature(Settings).parameters.values()
    return [p.replace(kind=p.KEYWORD_ONLY) for p in (*own, *pipeline)]


def describe(name: str) -> str:
    """The docstring of the filter or estimator ``name``."""
    return inspect.getdoc(_COMPLETE.get(name) or filters.FILTERS[name]) or ""


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
    if name in _COMPLETE:
        return _COMPLETE[name](**given)
    pipeline = {key: given.pop(key) for key in _PIPELINE if key in given}
    return Pipeline(filters.make_filter(name, **given), **pipeline)
