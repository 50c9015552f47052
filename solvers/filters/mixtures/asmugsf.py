"""Adaptive split-and-merge unscented Gaussian sum filter: a mixture of process noises instead of one.

Idea: the process noise w ~ N(0, Q) is split into components, each goes through the unscented update, and the
predictive densities of the fix say which of them it was. The collapsed posterior is the estimate; the components'
noises, merged with the same weights, and the update's own correction say how large Q is; split again.

The split (docs/mathematics/filters.md#split-and-merge) needs a direction, and an eigenvector of Q is none: Q mixes
m/s and rad, and a noise that no fix shows
cannot be weighed by it. So it is the direction v = Q H' a / sqrt(a' H Q H' a) of the noise which moves the
innovation most in units of its standard deviation, max a' H Q H' a / a' S a: the same in any units, and v v' <= Q.
As w is additive, splitting Q before the prediction is splitting the predicted Gaussian along v: one set of points
serves all components.

Adaptation (docs/mathematics/filters.md#split-and-merge with the safeguards of E.5): the factors of the driven,
diagonal elements of Q become 1 - d times
their merged second moments sum zeta_g (Q_g + w_g w_g') plus d times the statistic Q + dx dx' - (P^- - P), dx = x - x^-,
which is 3.5.15 made unbiased; then they are clipped to [floor, cap]. d = (1 - b) / (1 - b^(k + k0)). The statistic is
the damped one of blocks/noise.py, without which the first minute sets Q off by a factor of ten, and innovations beyond
the gate enter it as if they were on it. Told zeros (biases) stay zeros. Between fixes the noises add up, and are
adapted together. Q alone is adapted (docs/mathematics/filters.md#adaptive-noise d): fixes worse than told pass for
process noise, and cost dearly.

Source: 000 (3.5.16-27); docs/mathematics/filters.md#split-and-merge, docs/mathematics/errata.md#chapter-3 (37-41).
Shapes: x (..., n), P (..., n, n), z (..., m); factors (..., n).
Departures: weights by N(z; z_g, S_g), not R (erratum 40); spread terms in the posterior and in the merger (39, 41);
the noise keeps its told mean zero and second moments about it: posterior noises merged into a mean would be a random
walk, and their variance about that mean shrinks by E var(E[w | z]) at every step.
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
from solvers.filters.registry import register
from solvers.types import Gaussian, Health, Innovation, Measurement, Transition


class Adaptive(NamedTuple):
    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    factor: Array  #: (..., n) of the variances of the told noise
    noise: Array  #: (..., n, n) covariance of the noise since the last fix
    weights: Array  #: (..., G) of the noise's components at the last fix
    fixes: NDArray[np.int64]  #: (...) so far


@register("asmugsf")
@dataclass(frozen=True)
class ASMUGSF(GaussianFilter[Adaptive]):
    """The adaptive split-and-merge unscented Gaussian sum filter."""

    components: int = 3  #: of the process noise
    omega: float = 0.5  #: share of the noise along the split that the components' means carry
    adapt: bool = True  #: whether Q is; False: it stays as told
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
        keep(self, "components", whole, least=1)
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
        """The prior and the told noise. ``rng`` is not used."""
        b = initial_belief(prior)
        G = self.components
        weights = np.full((*b.mean.shape[:-1], G), 1.0 / G)
        return Adaptive(*b, np.ones(b.mean.shape), np.zeros(b.cov.shape), weights, np.zeros(b.mean.shape[:-1], int))

    def predict(self, b: Adaptive, tr: Transition) -> Adaptive:
        y, repaired = transform(tr.f, Gaussian(b.mean, b.cov), self.rule)
        Q = self.process_noise(b, tr).cov
        return count(b._replace(mean=y.mean, cov=y.cov + Q, noise=b.noise + Q), repaired)

    def process_noise(self, b: Adaptive, tr: Transition) -> Gaussian:
        """w with the factors of its variances."""
        s = np.sqrt(b.factor)
        return Gaussian(np.zeros_like(b.mean), s[..., :, None] * tr.Q * s[..., None, :])

    def correct(self, b: Adaptive, me: Measurement) -> tuple[Adaptive, Innovation]:
        prior = Gaussian(b.mean, b.cov)
        v = math.sqrt(self.omega) * self._direction(b, me) if self.components > 1 else np.zeros(b.mean.shape)
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

    def _direction(self, b: Adaptive, me: Measurement) -> Array:
        """v (..., n): what the noise does to the state where it moves the innovation most, v v' <= P."""
        y, _ = moments(me.h, Gaussian(b.mean, b.cov), self.rule)
        _, H = tangent(me.h, b.mean, standard_deviations(b.cov))
        QH = b.noise @ H.mT
        whiten = inverse_lower(cholesky(y.cov + me.R)[0])
        shown = symmetrize(whiten @ H @ QH @ whiten.mT)
        share, axes = np.linalg.eigh(np.where(finite_items(shown)[..., None, None], shown, 0.0))
        a = whiten.mT @ axes[..., -1:]
        top = share[..., -1, None]
        v = np.where(top > 0.0, (QH @ a)[..., 0] / np.sqrt(np.where(top > 0.0, top, 1.0)), 0.0)
        # <= Q it is, but between fixes a stable f forgets noise, of which P then has less than the sum
        return v / np.sqrt(np.maximum(nis(Innovation(v, b.cov)), 1.0))[..., None]

    def _adapt(self, b: Adaptive, prior: Gaussian, components: Gaussian, innovation: Innovation) -> Adaptive:
        """The factors of Q after a fix. # 000 (3.5.15), (3.5.27), docs/mathematics/filters.md#adaptive-noise"""
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
