"""One factory per solver, ``zoo.ckf(**settings)``: what the entry points of ``sins_env.estimators`` name."""

from __future__ import annotations

import inspect
from functools import partial

import solvers


def __getattr__(name: str) -> partial[solvers.Estimator]:
    if name not in solvers.names():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    factory = partial(solvers.make, name)
    factory.__doc__ = solvers.describe(name)
    factory.__signature__ = inspect.Signature(solvers.settings(name))  # type: ignore[attr-defined]
    return factory
