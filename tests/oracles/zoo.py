"""The filters as the zoo tests see them: a new filter is tested from the moment it is registered.

What the tests need to know of a filter stands in its file; solvers/filters/relations.py says how.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np

from solvers.blocks.moments import SigmaPoints
from solvers.filters import FILTERS, make_filter, names
from solvers.filters.relations import Relation

Settings = dict[str, Any]


def told(name: str, constant: str, default: Any) -> Any:
    """What the file of a filter says of it."""
    return getattr(sys.modules[FILTERS[name].__module__], constant, {}).get(name, default)


def relations(constant: str) -> list[tuple[str, Relation]]:
    """Every filter's relations, with its name."""
    return [(name, relation) for name in names() for relation in told(name, constant, ())]


def first_fix_together(name: str) -> bool:
    """Whether the runs of a batch must have their first fix in the same epoch."""
    return bool(getattr(sys.modules[FILTERS[name].__module__], "FIRST_FIX_TOGETHER", False))


def draws(name: str) -> bool:
    """Whether it draws random particles."""
    return any(field.name == "particles" for field in fields(FILTERS[name]))


def as_kalman(name: str) -> Settings | None:
    """The settings that make a filter the Kalman filter on linear problems; None if its relations do not lead to ``kf``."""
    if name == "kf":
        return {}
    if draws(name):  # its own tests have other oracles
        return None
    ways = (one for one in told(name, "SAME_AS", ()) if one.other != name and as_kalman(one.other) == one.of_other)
    return next((dict(one.settings) for one in ways), None)


def repairs_a_singular_prior(name: str, settings: Settings) -> bool:
    """Whether it draws a Cholesky root of P; the eigen root and the square-root form take a singular one as it is."""
    flt: Any = make_filter(name, **settings)
    rule = getattr(flt, "rule", None)
    return isinstance(rule, SigmaPoints) and rule.root == "cholesky" and getattr(flt, "form", "") != "square-root"


def settings_of(name: str) -> Settings:
    """The settings with which the tests of conduct run a filter: few particles, for time."""
    return {"particles": 128} if draws(name) else {}


def variants() -> Iterator[tuple[str, Settings]]:
    for name in names():
        for settings in told(name, "VARIANTS", ()):
            yield name, dict(settings)


def exact() -> list[tuple[str, Settings]]:
    """Name and settings of all that must be the Kalman filter on linear problems."""
    found = [(name, settings) for name in names() if (settings := as_kalman(name)) is not None]
    return found + [(name, settings) for name, settings in variants() if as_kalman(name) is not None]


def zoo() -> list[tuple[str, Settings]]:
    """Every filter as users get it, and the variants."""
    return [(name, settings_of(name)) for name in names()] + list(variants())


def label(name: str, settings: dict[str, Any]) -> str:
    return "-".join([name, *map(str, settings.values())])


def made(name: str, settings: dict[str, Any] | None = None) -> Any:
    return make_filter(name, **(settings_of(name) if settings is None else settings))


def is_batched(name: str) -> bool:
    return bool(FILTERS[name].batched)


def generators(batch: tuple[int, ...], seed: int = 0) -> Any:
    """One generator for a single run, else one per run."""
    if not batch:
        return np.random.default_rng(seed)
    return np.random.default_rng(seed).spawn(int(np.prod(batch)))
