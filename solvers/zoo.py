"""One factory per solver, ``zoo.ckf(**settings)``: what the entry points of ``sins_env.estimators`` name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import solvers
from sins_env.types import Estimator


def __getattr__(name: str) -> Callable[..., Estimator]:
    if name in solvers.names():
        return partial(solvers.make, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
