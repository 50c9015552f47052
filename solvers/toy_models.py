"""The three-state benchmark of 002 (107-114): strongly nonlinear, and one noise drives all states.

    x1' = cos(50 / (1 + x2 x3)),  x2' = 2 x1^2 exp(-x2 x3),  x3' = sin x3,   + [1 1 1]' w,   w ~ N(0.2, 0.4)
    z   = x1 + exp(-3 x2 x3) + v,                                                        v ~ N(0.3, 0.5)

The printed system explodes: once x2 x3 < 0, exp(-x2 x3) feeds itself, and 97 % of the runs overflow within 300 steps. Three
variants handle this (docs/mathematics/filters.md#benchmark-of-002):

- "literal" ends such a run and tells at which step;
- "small_q" has Q = 0.04, with which no run overflows;
- "abs" takes |x2 x3|, which keeps every run bounded at the printed Q.

    truth = Benchmark002("abs").simulate(np.random.default_rng(0), runs=100)
    track = Benchmark002("abs").track(make_filter("aukf", adapt="qQ"), truth.z, Q=0.2, r=0.3, R=0.5)

Shapes: time first, then the batch: x (steps, runs, 3), z (steps, runs, 1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sins_env.arrays import Array
from sins_env.checks import choice, keep, number
from solvers.types import Filter, Gaussian, Health, Measurement, Transition

VARIANTS = ("literal", "small_q", "abs")
G = np.ones((3, 1))
START = np.array([0.5, 1.0, 1.0])  #: true and estimated state at the start; the covariance is I, 002 (110-111)
OVERFLOW = 1e6  #: a run with a state or measurement beyond this has exploded


class Truth(NamedTuple):
    """Simulated runs: true states and measurements."""

    x: Array  #: (steps, runs, 3); NaN from the overflow on
    z: Array  #: (steps, runs, 1); NaN from the overflow on
    ended: NDArray[np.int64]  #: (runs,), the step at which a run overflowed, counted from 1; 0: it did not


class Track(NamedTuple):
    """What a filter made of the measurements of all runs."""

    mean: Array  #: (steps, runs, 3)
    cov: Array  #: (steps, runs, 3, 3)
    noise: dict[str, Array]  #: the filter's diagnostics by name, (steps, runs, ...)
    health: Health


@dataclass(frozen=True)
class Benchmark002:
    """The system with its true noise. What a filter is told about the noise is an argument of ``track``.

    Raises:
        ValueError: a setting outside its range.
    """

    variant: str = "abs"  #: "literal", "small_q" or "abs"
    q: float = 0.2  #: mean of w
    Q: float | None = None  #: variance of w; None: 0.4, or 0.04 in "small_q"
    r: float = 0.3  #: mean of v
    R: float = 0.5  #: variance of v

    def __post_init__(self) -> None:
        keep(self, "variant", choice, VARIANTS)
        keep(self, "q", number)
        if self.Q is not None:
            keep(self, "Q", number, "None, or a finite number >= 0", least=0.0)
        keep(self, "r", number)
        keep(self, "R", number, least=0.0)

    @property
    def true_Q(self) -> float:
        """The variance of w in this variant."""
        return self.Q if self.Q is not None else 0.04 if self.variant == "small_q" else 0.4

    def f(self, x: Array) -> Array:
        """Map states (..., 3) to the next ones (..., 3), without noise: 002 (107)."""
        product = self._product(x)
        with np.errstate(all="ignore"):
            return np.stack(
                [np.cos(50.0 / (1.0 + product)), 2.0 * x[..., 0] ** 2 * np.exp(-product), np.sin(x[..., 2])], axis=-1
            )

    def h(self, x: Array) -> Array:
        """Map states (..., 3) to measurements (..., 1), without noise: 002 (108)."""
        with np.errstate(all="ignore"):
            return (x[..., 0] + np.exp(-3.0 * self._product(x)))[..., None]

    def _product(self, x: Array) -> Array:
        with np.errstate(all="ignore"):
            product: Array = x[..., 1] * x[..., 2]
        return np.abs(product) if self.variant == "abs" else product

    def simulate(
        self,
        rng: np.random.Generator,
        runs: int,
        steps: int = 300,
        R: Callable[[int], float] | None = None,
        limit: float = OVERFLOW,
    ) -> Truth:
        """Simulate ``runs`` runs.

        ``R`` maps the step, counted from 1, to the variance of v; None: the constant one. A run ends where a state or a
        measurement is beyond ``limit``, or not finite.
        """
        x, z = np.full((steps, runs, 3), np.nan), np.full((steps, runs, 1), np.nan)
        ended = np.zeros(runs, dtype=np.int64)
        now = np.tile(START, (runs, 1))
        w, v = rng.standard_normal((steps, runs, 1)), rng.standard_normal((steps, runs, 1))
        for k in range(steps):
            now = self.f(now) + (self.q + np.sqrt(self.true_Q) * w[k]) @ G.T
            seen = self.h(now) + self.r + np.sqrt(self.R if R is None else R(k + 1)) * v[k]
            with np.errstate(invalid="ignore"):
                size = np.abs(np.concatenate([now, seen], axis=-1)).max(axis=-1)
            sound = np.isfinite(size) & (size <= limit)
            ended[~sound & (ended == 0)] = k + 1
            now = np.where((ended == 0)[:, None], now, np.nan)
            x[k], z[k] = now, np.where((ended == 0)[:, None], seen, np.nan)
        return Truth(x, z, ended)

    def track(
        self,
        flt: Filter[Any],
        z: Array,
        Q: ArrayLike,
        R: ArrayLike | Callable[[int], float],
        q: float = 0.0,
        r: float = 0.0,
    ) -> Track:
        """Run ``flt`` on measurements z (steps, runs, 1) with the told noise q, Q, r, R.

        These are numbers; ``R`` may be a function of the step, counted from 1.
        """
        f, h = _Shifted(self.f, q), _Shifted(self.h, r)
        tr = Transition(f, np.asarray(Q) * (G @ G.T), G)
        batch = z.shape[1:-1]
        rng = np.random.default_rng(0).spawn(int(np.prod(batch))) if batch else np.random.default_rng(0)
        b = flt.init(Gaussian(np.broadcast_to(START, (*batch, 3)), np.eye(3)), rng)
        means, covs, noise = [], [], []
        for k, z_k in enumerate(z):
            R_k = np.reshape(R(k + 1) if callable(R) else R, (1, 1))
            b, _ = flt.step(b, tr, Measurement(z_k, h, R_k))
            x = flt.estimate(b)
            means.append(x.mean)
            covs.append(x.cov)
            noise.append(flt.diagnostics(b))
        together = {key: np.stack([one[key] for one in noise]) for key in noise[0]}
        return Track(np.stack(means), np.stack(covs), together, b.health)


@dataclass(frozen=True)
class _Shifted:
    """The function g plus the mean of its noise, which the filters take as zero."""

    g: Callable[[Array], Array]
    by: float

    def __call__(self, x: Array) -> Array:
        return self.g(x) + self.by


def changing_R(k: int) -> float:
    """Return the variance R of example 2 at step ``k``: 002 (113)."""
    if k < 60 or k >= 250:
        return 0.5
    return 0.9 if k < 120 else 0.3 if k < 190 else 0.7
