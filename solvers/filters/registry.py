"""The filters by the names that users type. Registering a filter makes it tested (tests/solvers/test_zoo.py)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from sins_env.checks import build, unknown
from solvers.types import Filter

F = TypeVar("F", bound=type)

FILTERS: dict[str, type] = {}


def register(name: str) -> Callable[[F], F]:
    """Class decorator: make a filter, a frozen dataclass of settings, known as ``name``."""

    def add(cls: F) -> F:
        if name in FILTERS:
            raise ValueError(f"filter {name!r} is already registered, as {FILTERS[name].__qualname__}")
        FILTERS[name] = cls
        return cls

    return add


def names() -> list[str]:
    """The registered names, in order of registration."""
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
