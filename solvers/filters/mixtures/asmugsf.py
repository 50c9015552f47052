"""Adaptive split-and-merge unscented Gaussian sum filter: a mixture of process noises instead of one.

Idea: the process noise w ~ N(0, Q) is split into components. Each goes through the unscented update, and the predictive
densities of the fix say which component it was. The collapsed posterior is the estimate. The size of Q follows from the
noises of the components, merged with the same weights, and from the correction of the update. Then Q is split again.

The split needs a direction v. An eigenvector of Q will not do, because Q mixes m/s and rad, and because a noise that moves no
fix cannot be weighed. The filter takes v = Q H' a / sqrt(a' H Q H' a) with the a that maximises a' H Q H' a / a' S a. This is the
noise that moves the innovation most, in units of its standard deviation; it is the same in any units, and v v' <= Q. Since w is
additive, the predicted Gaussian can be split along v instead of Q. One set of points then serves all components.

The adaptation works on factors of the driven diagonal elements of Q. They become 1 - d times the merged second moments
sum zeta_g (Q_g + w_g w_g'), plus d times the statistic Q + dx dx' - (P- - P) with dx = x - x-, which is 3.5.15 made unbiased. Here
d = (1 - b) / (1 - b^(k + k0)), and the factors are clipped to [floor, cap]. Told zeros, such as those of biases, stay zeros.
The statistic is the damped one of blocks/noise.py; otherwise Q is wrong by a factor of ten within the first minute.
Innovations beyond the gate count as if they lay there. Between fixes the noises add up and are adapted together.
R is not adapted, so fixes that are worse than told pass for process noise, which costs much accuracy.

Source: 000 (3.5.16-27); docs/mathematics/filters.md#split-and-merge.
Shapes: x (..., n), P (..., n, n), z (..., m); factors (..., n).
Departures, with the numbers of docs/mathematics/errata.md#chapter-3:

- Weights are N(z; z_g, S_g) with S_g in place of R (40).
- Posterior and merger have terms for the spread of the means (39, 41).
- The noise keeps its told mean zero, and its second moments are about zero. A mean merged from posterior noises would be a
  random walk, and the variance about it would shrink by E var(E[w | z]) at every step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.checks import flag, keep, number, whole
from solvers.blocks.conditioning import inverse_lower, nis
from solvers.blocks.mixtures import collapse, effective, split, spread_measurement
from solvers.blocks.moments import SigmaPoints, moments, standard_deviations, tangent, transform
from solvers.blocks.noise import gated, memory_weight, statistic, variances
from solvers.blocks.sigma_rules import Unscented
from solvers.blocks.square_root import cholesky, finite_items, symmetrize
from solvers.filters.base import count
from solvers.filters.gaussian import GaussianFilter, initial_belief
from solvers.filters.mixtures.base import bayes
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Gaussian, Health, Innovation, Measurement, Transition


class Adaptive(NamedTuple):
    """One Gaussian, and the estimated process noise."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    factor: Array  #: (..., n), estimated variances of the noise over the told ones
    noise: Array  #: (..., n, n), covariance of the noise since the last fix
    weights: Array  #: (..., G), weights of the components of the noise at the last fix
    fixes: NDArray[np.int64]  #: (...), number of fixes so far


@register("asmugsf")
@dataclass(frozen=True)
class ASMUGSF(GaussianFilter[Adaptive]):
    """The adaptive split-and-merge unscented Gaussian sum filter."""

    components: int = 3  #: number of components into which the process noise is split
    omega: float = 0.5  #: share of the noise along the split that the means of the components carry, >= 0 and < 1
    adapt: bool = True  #: whether Q is estimated; False: it stays as told
    b: float = 0.99  #: weight of a fix over that of the next one, > 0 and <= 1
    k0: int = 20  #: number of fixes that the told Q counts for
    floor: float = 1e-6  #: least variance, relative to the told one
    cap: float = 1e2  #: largest variance, relative to the told one
    gate: float = 0.999  #: probability that a good innovation lies within the gate; 1: no gate
    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n
    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance

    def __post_init__(self) -> None:
        _ = self.rule  # checks its settings
        keep(self, "components", whole, least=1, most=1000)
        keep(self, "omega", number, least=0.0, below=1.0)
        keep(self, "adapt", flag)
        keep(self, "b", number, above=0.0, most=1.0)
        keep(self, "k0", whole, least=1)
        keep(self, "floor", number, above=0.0, most=1.0)
        keep(self, "cap", number, least=1.0)
        keep(self, "gate", number, above=0.0, most=1.0)

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(Unscented(self.alpha, self.beta, self.kappa), self.root)

    def init(self, prior: Gaussian, rng: Any = None) -> Adaptive:
        """Make the belief of the prior with the told noise. ``rng`` is not used."""
        b = initial_belief(prior)
        G = self.components
        weights = np.full((*b.mean.shape[:-1], G), 1.0 / G)
        return Adaptive(*b, np.ones(b.mean.shape), np.zeros(b.cov.shape), weights, np.zeros(b.mean.shape[:-1], int))

    def predict(self, b: Adaptive, tr: Transition) -> Adaptive:
        y, repaired = transform(tr.f, Gaussian(b.mean, b.cov), self.rule)
        Q = self.process_noise(b, tr).cov
        return count(b._replace(mean=y.mean, cov=y.cov + Q, noise=b.noise + Q), repaired)

    def process_noise(self, b: Adaptive, tr: Transition) -> Gaussian:
        """Return w with its estimated variances: mean zero (..., n), covariance (..., n, n)."""
        s = np.sqrt(b.factor)
        return Gaussian(np.zeros_like(b.mean), s[..., :, None] * tr.Q * s[..., None, :])

    def correct(self, b: Adaptive, me: Measurement) -> tuple[Adaptive, Innovation]:
        prior = Gaussian(b.mean, b.cov)
        v = math.sqrt(self.omega) * self.direction(b, me) if self.components > 1 else np.zeros(b.mean.shape)
        components = split(prior, v, self.components)
        equal = np.full(b.weights.shape, 1.0 / self.components)
        me = spread_measurement(me, b.mean.ndim - 1)
        weights, x, innovation, repaired = bayes(equal, components, me, self.rule)
        after = collapse(weights, x)
        b = count(b._replace(mean=after.mean, cov=after.cov, weights=weights), repaired)
        if self.adapt:
            b = self._adapt(b, prior, components, innovation)
        return b._replace(noise=np.zeros(b.cov.shape), fixes=b.fixes + 1), innovation

    def diagnostics(self, b: Adaptive) -> dict[str, Array]:
        return {"q_factor": b.factor, "effective_components": effective(b.weights)}

    def direction(self, b: Adaptive, me: Measurement) -> Array:
        """Return v (..., n), the noise that moves the innovation most, with v v' <= P."""
        y, _ = moments(me.h, Gaussian(b.mean, b.cov), self.rule)
        _, H = tangent(me.h, b.mean, standard_deviations(b.cov))
        QH = b.noise @ H.mT
        whiten = inverse_lower(cholesky(y.cov + me.R)[0])
        shown = symmetrize(whiten @ H @ QH @ whiten.mT)
        share, axes = np.linalg.eigh(np.where(finite_items(shown)[..., None, None], shown, 0.0))
        a = whiten.mT @ axes[..., -1:]
        top = share[..., -1, None]
        v = np.where(top > 0.0, (QH @ a)[..., 0] / np.sqrt(np.where(top > 0.0, top, 1.0)), 0.0)
        # v v' <= Q, but a stable f forgets noise between fixes, so that P may hold less than the sum of Q
        return v / np.sqrt(np.maximum(nis(Innovation(v, b.cov)), 1.0))[..., None]

    def _adapt(self, b: Adaptive, prior: Gaussian, components: Gaussian, innovation: Innovation) -> Adaptive:
        """Update the factors of Q after a fix: 000 (3.5.15), (3.5.27)."""
        Q = variances(b.noise)
        w = components.mean - prior.mean[..., None, :]
        merged = Q + ((b.weights - 1.0 / self.components)[..., None, :] @ w**2)[..., 0, :]
        part, beyond = gated(innovation, self.gate)
        moved = Gaussian(part[..., None] * (b.mean - prior.mean), prior.cov - b.cov)
        found = statistic(Gaussian(np.zeros(Q.shape), b.noise), moved, np.ones(part.shape), damp=True)
        d = memory_weight(b.fixes + self.k0, self.b)[..., None]
        driven = Q > 0.0
        ratio = np.where(driven, (1.0 - d) * merged + d * variances(found.cov), 1.0) / np.where(driven, Q, 1.0)
        factor = np.clip(b.factor * ratio, self.floor, self.cap)
        return count(b._replace(factor=factor), fallbacks=beyond)


SAME_AS = {
    "asmugsf": (
        Relation("ukf", {"components": 1, "adapt": False}),
        Relation("ukf", {"omega": 0.0, "adapt": False}),
    ),
}
UNLIKE = {
    "asmugsf": (
        Relation("ukf", {"adapt": False}),
        Relation("ukf", {"components": 1}),
    ),
}
