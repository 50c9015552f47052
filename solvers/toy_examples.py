"""Examples 1 and 2 of 002: the adaptive filter with and without safeguards, beside a UKF told wrong and right noise.

The printed system explodes (:func:`exploded`), so the filters run on its bounded form. All of them see the same measurements.
Findings: docs/mathematics/filters.md#benchmark-of-002.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from solvers.filters import make_filter
from solvers.filters.adaptive.aukf import LITERAL
from solvers.toy_models import OVERFLOW, Benchmark002, Track, Truth, changing_R

STEPS = 300
#: Labels: the adaptive filter told wrong noise, as printed and with safeguards; the UKF told wrong and right noise.
FILTERS = ("as printed", "safeguarded", "UKF told wrong", "UKF told right")


class Example(NamedTuple):
    """The runs of one example: the truth, and what each filter made of it."""

    truth: Truth
    noise: dict[str, Array]  #: true values of the noise statistics that are estimated, by name: (steps,)
    tracks: dict[str, Track]  #: the estimates of each filter, by its label in FILTERS

    def estimate(self, label: str, name: str) -> Array:
        """Return a filter's estimate (steps, runs) of the noise statistic ``name``."""
        found: Array = self.tracks[label].noise[name].reshape(self.truth.z.shape[:2])
        return found

    def errors(self, label: str) -> Array:
        """Return estimate minus truth, (steps, runs, 3)."""
        return self.tracks[label].mean - self.truth.x


def exploded(runs: int, limit: float = OVERFLOW) -> NDArray[np.int64]:
    """Return the step (runs,), counted from 1, at which each run of the printed system passes a limit; 0: it does not."""
    return Benchmark002("literal").simulate(np.random.default_rng(1), runs, STEPS, limit=limit).ended


@lru_cache(maxsize=2)
def example_1(runs: int) -> Example:
    """Run example 1: constant process noise, told as q = 0, Q = 0.2 instead of 0.2, 0.4. Equations 002 (109), (112)."""
    system = Benchmark002()
    truth = system.simulate(np.random.default_rng(2), runs, STEPS)
    noise = {"q": np.full(STEPS, system.q), "Q": np.full(STEPS, system.true_Q)}
    told = {"q": 0.0, "Q": 0.2, "r": system.r, "R": system.R}
    right = {"q": system.q, "Q": system.true_Q}
    return Example(truth, noise, _tracks(system, truth, "aukf", {"adapt": "qQ"}, told, right))


@lru_cache(maxsize=2)
def example_2(runs: int) -> Example:
    """Run example 2: measurement noise that changes slowly, told as R = 1. Equations 002 (113-114), forgetting 0.95."""
    system = Benchmark002()
    truth = system.simulate(np.random.default_rng(3), runs, STEPS, R=changing_R)
    noise = {"R": np.array([changing_R(k + 1) for k in range(STEPS)])}
    told = {"q": system.q, "Q": system.true_Q, "r": system.r, "R": 1.0}
    adapting = {"adapt": "R", "b": 0.95}
    return Example(truth, noise, _tracks(system, truth, "aukf_fading", adapting, told, {"R": changing_R}))


def _tracks(
    system: Benchmark002,
    truth: Truth,
    adaptive: str,
    settings: dict[str, Any],
    told: dict[str, Any],
    right: dict[str, Any],
) -> dict[str, Track]:
    ukf = make_filter("ukf")
    printed, safe = make_filter(adaptive, **settings, **LITERAL), make_filter(adaptive, **settings)
    filters = ((printed, told), (safe, told), (ukf, told), (ukf, told | right))
    return {name: system.track(flt, truth.z, **given) for name, (flt, given) in zip(FILTERS, filters, strict=True)}
