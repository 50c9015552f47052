"""The filters as the zoo tests see them: a new filter is tested from the moment it is registered.

A filter that is the Kalman filter on linear problems with its default settings needs no line here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from solvers.filters import FILTERS, make_filter, names

#: Settings beyond the defaults under which a filter must pass as well.
VARIANTS: list[tuple[str, dict[str, Any]]] = [
    ("ukf", {"alpha": 0.1, "beta": 2.0}),  # 1e-3: see test_relations, its rule magnifies rounding by 1e6
    ("ukf", {"root": "svd"}),
    ("ckf", {"root": "svd"}),
    ("filterpy_ukf", {"alpha": 0.5, "beta": 2.0}),
]

#: Filters that are something else than the Kalman filter by default: the settings that make them it, or None where
#: nothing does (a sampled filter; its own tests have other oracles).
AS_KALMAN: dict[str, dict[str, Any] | None] = {}

#: Particle filters get fewer particles, for time.
FAST: dict[str, dict[str, Any]] = {}

#: Filters that draw square roots of P, and so repair one that is singular (default settings).
REPAIRS_A_SINGULAR_PRIOR = {"ukf", "ckf"}


def settings_of(name: str) -> dict[str, Any]:
    """The settings with which the tests of conduct run a filter."""
    return FAST.get(name, {})


def exact() -> list[tuple[str, dict[str, Any]]]:
    """Name and settings of all that must be the Kalman filter on linear problems."""
    defaults = [(name, AS_KALMAN.get(name, {})) for name in names()]
    found = [(name, s) for name, s in defaults if s is not None]
    return found + [(name, s) for name, s in VARIANTS if AS_KALMAN.get(name, {}) is not None]


def zoo() -> list[tuple[str, dict[str, Any]]]:
    """Every filter as users get it, and the variants."""
    return [(name, settings_of(name)) for name in names()] + VARIANTS


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
