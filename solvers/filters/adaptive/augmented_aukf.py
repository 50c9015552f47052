"""Augmented adaptive unscented Kalman filter.

Idea: draw the points of state, process noise and measurement noise together. Send them through f and on through h without
drawing anew, and take Q from the corrections of the last M fixes.

Source: 000 (3.5.1-15); docs/mathematics/filters.md#augmented-state.
Shapes: x (..., n), P (..., n, n), z (..., m); f gets (..., 2 (n + n_w) + 1, n), with n_w the number of driven directions of w.
Departures, with the numbers of docs/mathematics/errata.md#chapter-3:

- The outer weights are 0.5/(L + lambda), because only those sum to one (37).
- The noise v is additive. Its points would only add R and widen the others, so they are not drawn: L = n + n_w with
  kappa + n_v gives the same moments as L = n + n_w + n_v with kappa.
- Equation (3.5.15) takes the mean of K e e' K' for Q. On average this is P- - P+, so that every error which the filter still
  has to correct counts as process noise (38). ``unbiased`` adds the missing P+ - PF; without it the equation is as
  printed, but with 1/M for 1/(M - 1).
- A linear h is used exactly. Safeguards are those of solvers/filters/adaptive/base.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.checks import flag, keep, whole
from solvers.blocks import noise as noises
from solvers.blocks.conditioning import condition
from solvers.blocks.moments import draw, weigh, weigh_pair
from solvers.blocks.noise import Noise
from solvers.blocks.sigma_rules import Points, Unscented, points
from solvers.blocks.square_root import ROOTS
from solvers.filters.adaptive.aukf import WindowedFilter
from solvers.filters.adaptive.base import Past, Told
from solvers.filters.base import count
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Transition


class AugmentedBelief(NamedTuple):
    """An ``AdaptiveBelief`` with the points that go from f to h."""

    mean: Array
    cov: Array
    health: Health
    noise: Noise
    past: tuple[Past, Past]
    told: Told | None
    fixes: NDArray[np.int64]
    idle: NDArray[np.int64]
    gated: NDArray[np.int64]
    points: Array  #: (..., points, n), images under f
    n_v: int  #: size of the last fix; an epoch without a fix keeps it, so that all runs of a batch agree


@register("augmented_aukf")
@dataclass(frozen=True)
class AugmentedAUKF(WindowedFilter):
    """The adaptive unscented filter on the state augmented with the noises."""

    predicts_by_rule: ClassVar[bool] = False

    M: int = 200  #: number of fixes remembered
    unbiased: bool = True  #: whether P+ - PF is added to Q; False: 000 (3.5.15) as printed

    def __post_init__(self) -> None:
        super().__post_init__()
        keep(self, "M", whole, least=2, most=100_000)
        keep(self, "unbiased", flag)

    @property
    def window(self) -> tuple[int, float]:
        return self.M, 1.0

    def init(self, prior: Gaussian, rng: Any = None) -> Any:
        b = super().init(prior, rng)
        return AugmentedBelief(*b, np.zeros((*b.mean.shape[:-1], 1, 1)), 0)

    def advance(self, b: Any, tr: Transition, me: Measurement | None) -> tuple[Any, Innovation | None]:
        return super().advance(b if me is None else b._replace(n_v=me.z.shape[-1]), tr, me)

    def propagate(self, b: Any, tr: Transition) -> Any:
        S, repaired = ROOTS[self.root](b.cov)
        B, repaired_Q = self._noise_root(b, tr)
        n = b.mean.shape[-1]
        size = n + B.shape[-1]
        root = np.zeros((*b.mean.shape[:-1], size, size))
        root[..., :n, :n] = S
        root[..., n:, n:] = np.eye(size - n)
        p = self._points(size, b.n_v)
        chi = draw(np.concatenate([b.mean, np.zeros((*b.mean.shape[:-1], size - n))], axis=-1), root, p)
        images = _images(tr.f, chi[..., :n]) + chi[..., n:] @ B.mT  # 000 (3.5.5)
        x = weigh(images, p)
        return count(count(b._replace(mean=x.mean, cov=x.cov, points=images), repaired), repaired_Q)

    def shift(self, b: Any, q: Array) -> Any:
        return super().shift(b, q)._replace(points=b.points + q[..., None, :])

    def update(self, b: Any, me: Measurement) -> tuple[Any, Innovation]:
        if isinstance(me.h, Linear):
            return super().update(b, me)
        p = self._points(b.points.shape[-2] // 2, b.n_v)
        y = weigh_pair(b.points, me.h(b.points), p)  # 000 (3.5.8-11)
        x, innovation, repaired = condition(Gaussian(b.mean, b.cov), y._replace(cov=y.cov + me.R), me.z)
        return count(b._replace(mean=x.mean, cov=x.cov), repaired), innovation

    def statistic(self, now: Gaussian, moved: Gaussian, epochs: Array) -> Gaussian:
        new = super().statistic(now, moved, epochs)
        return new if self.unbiased else new._replace(cov=noises.least(moved, epochs))  # 000 (3.5.15)

    def _noise_root(self, b: Any, tr: Transition) -> tuple[Array, Any]:
        """Return B (..., n, n_w) with B B' = Q, one column for each driven direction, and the repaired runs."""
        told = noises.variances(b.told.Q)
        driven = np.flatnonzero((told > 0.0).reshape(-1, told.shape[-1]).any(axis=0))
        Q = b.noise.w.cov[..., driven[:, None], driven]
        W, repaired = ROOTS[self.root](Q)
        G = np.eye(told.shape[-1]) if tr.G is None else tr.G
        return G[:, driven] @ W, repaired

    def _points(self, size: int, n_v: int) -> Points:
        return points(Unscented(self.alpha, self.beta, self.kappa + n_v), size)


def _images(f: Function, chi: Array) -> Array:
    """Return f at the points (..., points, n); a ``Linear`` may have a matrix for each run."""
    if not isinstance(f, Linear):
        return f(chi)
    y = chi @ f.matrix.mT
    return y if f.offset is None else y + f.offset[..., None, :]


SAME_AS = {
    "augmented_aukf": (
        Relation("kf", {"adapt": "none"}, on="linear", within=1e-10),
        Relation("aukf", {"M": 60}, on="linear", within=1e-9),
    ),
}
UNLIKE = {
    "augmented_aukf": (
        Relation("ukf", {"adapt": "none"}),
        Relation("augmented_aukf", of_other={"unbiased": False}),
    ),
}
#: The points know the size of a fix from the first one on.
FIRST_FIX_TOGETHER = True
