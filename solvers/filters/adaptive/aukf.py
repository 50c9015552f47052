"""Adaptive unscented Kalman filters of Sage-Husa type: noise statistics by maximum a posteriori estimation.

Idea: average what every fix says about the noise; the three filters differ in how they remember.

    aukf          constant noise: the mean over all fixes, d_k = 1/k                            000 (3.4.45-48), 002 (42-45)
    aukf_fading   slowly changing noise: weights that fall with b, d_k = (1 - b)/(1 - b^k)      002 (68-71)
    aukf_window   fast changing noise: the last m fixes, with weights that fall with b          002 (75-81)

The told noise enters as k0 fixes that all said the same. The relative sampling error of a variance is sqrt(2/k) after k
fixes, sqrt(2 (1 - b)/(1 + b)) with b, and sqrt(2/m) with a window. This is 0.3 for the told value (k0 = 20) and 0.1 for the
memories (b = 0.99, m = 200). If all fixes count alike, a told value that is far off is forgotten only as slowly as 1/k.

Source: Zhao Lin et al. (2010), "Adaptive UKF filtering algorithm based on maximum a posterior estimation and
exponential weighting", Acta Automatica Sinica 36(7) = 002; 000 section 3.4; Sage & Husa (1969);
docs/mathematics/filters.md#adaptive-noise.
Shapes: x (..., n), P (..., n, n), z (..., m); q (..., p), Q (..., p, p), r (..., m), R (..., m, m).
Departures, with the numbers of docs/mathematics/errata.md#chapter-3:

- The safeguards of solvers/filters/adaptive/base.py; without them Q and R turn indefinite in most runs (33).
- The limited memory is summed over its buffer. The recursion of 002 has the same sum, but cannot follow once an estimate
  was bounded.
- Points are drawn anew after the prediction (27, 28).
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.checks import keep, number, whole
from solvers.blocks.noise import memory_weight, window_weights
from solvers.filters.adaptive.base import AdaptiveFilter
from solvers.filters.relations import Relation
from solvers.registry import register

#: Settings of the papers, without any safeguard.
LITERAL = {"k0": 0, "guard": "none", "project": "none", "gate": 1.0}


@register("aukf")
@dataclass(frozen=True)
class AUKF(AdaptiveFilter):
    """The adaptive unscented filter for constant noise statistics."""

    def blend(self, now: Array, new: Array, past: Array, k: NDArray[np.int64]) -> tuple[Array, Array]:
        return now + memory_weight(k)[..., None] * (new - now), past


@register("aukf_fading")
@dataclass(frozen=True)
class FadingAUKF(AdaptiveFilter):
    """The adaptive unscented filter with fading memory."""

    b: float = 0.99  #: weight of a fix over that of the next one, > 0 and <= 1

    def __post_init__(self) -> None:
        super().__post_init__()
        keep(self, "b", number, above=0.0, most=1.0)

    def blend(self, now: Array, new: Array, past: Array, k: NDArray[np.int64]) -> tuple[Array, Array]:
        return now + memory_weight(k, self.b)[..., None] * (new - now), past


@dataclass(frozen=True)
class WindowedFilter(AdaptiveFilter):
    """Base of the filters that remember only the last fixes."""

    @property
    @abstractmethod
    def window(self) -> tuple[int, float]:
        """Number of fixes in the memory, and the weight of a fix over that of the next one."""

    def blend(self, now: Array, new: Array, past: Array, k: NDArray[np.int64]) -> tuple[Array, Array]:
        m, b = self.window
        first = (k == self.k0 + 1) | (past.shape[-2] != m)
        past = past.copy()
        if first.any() or not first.size:  # at the first fix all slots hold the told noise
            past = np.where(first[..., None, None], np.repeat(now[..., None, :], m, axis=-2), past)
        if (k == k.max(initial=0)).all():  # usually all runs had the same number of fixes, which is faster
            past[..., k.max(initial=0) % m, :] = new
            return window_weights(k.max(initial=0), m, b) @ past, past
        np.put_along_axis(past, (k % m)[..., None, None], new[..., None, :], axis=-2)
        return (window_weights(k, m, b)[..., None, :] @ past)[..., 0, :], past


@register("aukf_window")
@dataclass(frozen=True)
class WindowAUKF(WindowedFilter):
    """The adaptive unscented filter with limited memory."""

    m: int = 200  #: number of fixes remembered
    b: float = 0.99  #: weight of a fix over that of the next one, > 0 and <= 1

    def __post_init__(self) -> None:
        super().__post_init__()
        keep(self, "m", whole, least=2, most=100_000)
        keep(self, "b", number, above=0.0, most=1.0)

    @property
    def window(self) -> tuple[int, float]:
        return self.m, self.b


SAME_AS = {
    "aukf": (
        Relation("ukf", {"adapt": "none"}),
        Relation("aukf_window", of_other={"b": 1.0, "m": 60}, within=1e-9),  # the window outlasts the test
    ),
    "aukf_fading": (
        Relation("ukf", {"adapt": "none"}),
        Relation("ukf", {"adapt": "none", "beta": 2.0}, {"beta": 2.0}),
        Relation("aukf", {"b": 1.0, "adapt": "qQ"}, {"adapt": "qQ"}),
        Relation("aukf_window", {"b": 0.9, "adapt": "QR"}, {"b": 0.9, "m": 100, "adapt": "QR"}, within=1e-9),
    ),
    "aukf_window": (Relation("ukf", {"adapt": "none"}),),
}
UNLIKE = {
    "aukf_fading": (Relation("aukf", {"b": 0.9}),),
    "aukf_window": (Relation("aukf", {"m": 10}),),
}
