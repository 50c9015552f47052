"""The solvers by the names that users type. Registering one makes it known everywhere, and tested (tests/solvers/test_zoo.py)."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from sins_env.checks import build, unknown
from solvers.types import Filter

C = TypeVar("C", bound=type)

FILTERS: dict[str, type] = {}  #: classes that :func:`solvers.make` puts into the pipeline
ESTIMATORS: dict[str, type] = {}  #: classes that are estimators by themselves


def register(name: str) -> Callable[[C], C]:
    """Class decorator: make a filter, a frozen dataclass of settings, known as ``name``.

    A class with ``reset`` is an estimator by itself and gets no pipeline.

    Raises:
        ValueError: a name that is taken.
    """

    def add(cls: C) -> C:
        if taken := FILTERS.get(name) or ESTIMATORS.get(name):
            raise ValueError(f"solver {name!r} is already registered, as {taken.__qualname__} of {taken.__module__}")
        (ESTIMATORS if hasattr(cls, "reset") else FILTERS)[name] = cls
        return cls

    return add


def import_all(folders: Iterable[str], package: str) -> None:
    """Import every module of a package, given its ``__path__`` and name: importing one registers what it holds."""
    for found in pkgutil.walk_packages(folders, f"{package}."):
        importlib.import_module(found.name)


def class_of(name: str) -> type:
    """The class that is registered as ``name``."""
    return FILTERS.get(name) or ESTIMATORS[name]


def names() -> list[str]:
    """The filters by name, in the order of registration."""
    return list(FILTERS)


def make_filter(name: str, **settings: Any) -> Filter[Any]:
    """The filter ``name`` with its settings.

    Raises:
        ValueError: an unknown name or setting, with the nearest that exists; a value that is not allowed.
    """
    if name not in FILTERS:
        raise unknown("filter", name, FILTERS)
    made: Filter[Any] = build(FILTERS[name], settings, name)
    return made
