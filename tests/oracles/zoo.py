"""The filters as the zoo tests see them: a new filter is tested from the moment it is registered.

A filter that is the Kalman filter on linear problems with its default settings needs no line here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from solvers.filters import FILTERS, make_filter, names

#: Settings beyond the defaults under which a filter must pass as well.
VARIANTS: list[tuple[str, dict[str, Any]]] = [
    ("ukf", {"alpha": 0.1, "beta": 2.0}),  # 1e-3: see test_relations, its rule magnifies rounding by 1e6
    ("ukf", {"root": "svd"}),
    ("ckf", {"root": "svd"}),
    ("ckf", {"form": "square-root"}),
    ("ukf", {"form": "square-root", "alpha": 0.1, "beta": 2.0}),
    ("ckf5", {"root": "svd"}),
    ("ddf2", {"interval": 1.0}),
    ("filterpy_ukf", {"alpha": 0.5, "beta": 2.0}),
]

#: Filters that are something else than the Kalman filter by default: the settings that make them it, or None where
#: nothing does (a sampled filter; its own tests have other oracles).
AS_KALMAN: dict[str, dict[str, Any] | None] = {
    **{name: {"alpha": math.inf} for name in ("huber_ckf", "huber_ckf5")},
    **{name: {"sigma": math.inf} for name in ("mcc_ckf", "mcc_ckf5")},
    "student_t_ckf": {"dof": math.inf},
    "mpf": None,  # it has no prior covariance
    "mpf_ekf": {"weight": math.inf},
    **{name: {"q_factors": [1.0, 1.0], "r_factors": [1.0]} for name in ("imm_ekf", "imm_ukf")},
    **dict.fromkeys(("pf", "gpf", "rqmc_gpf", "cgpf", "ugpf", "upf", "hepf")),  # None: sampled
    "asmugsf": {"components": 1, "adapt": False},
    **{name: {"adapt": "none"} for name in ("aukf", "aukf_fading", "aukf_window", "augmented_aukf")},
    **{name: {"gamma2": math.inf} for name in ("hinf_kf", "hinf_ukf", "hinf_uif", "mixed_hinf_ukf")},
}

#: Filters that draw random particles.
PARTICLES = ("pf", "gpf", "rqmc_gpf", "cgpf", "ugpf", "upf", "hepf")

#: Particle filters get fewer particles, for time.
FAST: dict[str, dict[str, Any]] = {
    **{name: {"particles": 128} for name in ("pf", "gpf", "rqmc_gpf", "cgpf", "ugpf")},
    **{name: {"particles": 64} for name in ("upf", "hepf")},
}

#: Filters that draw square roots of P, and so repair one that is singular (default settings).
REPAIRS_A_SINGULAR_PRIOR = {
    "aukf",
    "aukf_fading",
    "aukf_window",
    "augmented_aukf",
    "imm_ukf",
    "asmugsf",
    "ukf",
    "ckf",
    "ckf5",
    "hinf_ukf",
    "hinf_uif",
    "mixed_hinf_ukf",
    "huber_ckf",
    "huber_ckf5",
    "mcc_ckf",
    "mcc_ckf5",
    "student_t_ckf",
}


def repairs_a_singular_prior(name: str, settings: dict[str, Any]) -> bool:
    """The eigen root and the square-root form take it as it is."""
    return (
        name in REPAIRS_A_SINGULAR_PRIOR and "svd" not in settings.values() and "square-root" not in settings.values()
    )


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
