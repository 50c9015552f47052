"""solvers: the mathematics. Every filter of the sources as a small frozen dataclass, and the pipeline from IMU to attitude.

    make("ckf")                             the complete estimator, as ``sins-env`` runs it
    make("ckf", feedback="closed")          settings of the pipeline and of the filter, by name
    names()                                 what there is

The bare filters are in :mod:`solvers.filters`, the contract in :mod:`solvers.types`.
"""

from __future__ import annotations

import inspect
from dataclasses import fields
from typing import Any

from sins_env.errors import unknown
from sins_env.types import Estimator
from solvers import filters
from solvers.pipeline.aligner import Aligner, CoarseAligner

_PIPELINE = tuple(inspect.signature(Aligner).parameters)[1:]
_COARSE = {"coarse_inertial": CoarseAligner}


def names() -> list[str]:
    """Every name that :func:`make` takes."""
    return sorted([*filters.names(), *_COARSE])


def make(name: str, **settings: Any) -> Estimator:
    """The estimator ``name``: the alignment pipeline around that filter.

    ``settings`` are those of the pipeline (``model bias_frame feedback coarse``) and of the filter.

    Raises:
        ValueError: an unknown name or setting, with the nearest valid one.
    """
    if name in _COARSE:
        allowed = tuple(inspect.signature(_COARSE[name]).parameters)
        for key in settings:
            if key not in allowed:
                raise unknown(f"setting of {name}", key, allowed)
        return _COARSE[name](**settings)
    if name not in filters.names():
        raise unknown("solver", name, names())
    allowed = [*_PIPELINE, *(f.name for f in fields(filters.FILTERS[name]))]
    for key in settings:
        if key not in allowed:
            raise unknown(f"setting of {name}", key, allowed)
    pipeline = {key: settings.pop(key) for key in _PIPELINE if key in settings}
    return Aligner(filters.make_filter(name, **settings), **pipeline)
