"""The Gaussian particle filter: particles for the moments of a step, a Gaussian from step to step.

What the family shares; a filter of it says where its particles come from. The belief holds the Gaussian, the key of each
run's stream and the effective sample size; no particle outlives its step.

Where h is ``Linear``, the likelihood depends on y = h(x) alone, and x given y is Gaussian with known moments. With
``marginal`` only y is sampled and weighed and the rest follows exactly (Rao-Blackwell): else every weighing adds noise of
relative size 1 / sqrt(M) to directions that the fix says nothing of, and thousands of them destroy the covariance
(docs/mathematics/filters.md#gaussian-particles). Process noise enters through Q itself, not through draws, and a
``Linear`` f is used exactly.

f and h meet the particles in slices of the particle axis, for a transition cannot be split into runs; ``memory_mb`` bounds
what they make on the way. The particles themselves take 8 M n bytes per run, twice.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import choice, flag, keep, number
from solvers.blocks.conditioning import condition, gain
from solvers.blocks.mixtures import effective, normalise
from solvers.blocks.moments import MomentRule, SigmaPoints, linear_moments, moments
from solvers.blocks.sigma_rules import Cubature
from solvers.blocks.square_root import cholesky, finite_items, symmetrize
from solvers.filters.base import choose, count
from solvers.filters.gaussian import GaussianFilter, initial_belief
from solvers.filters.particles.importance import LIKELIHOODS, cloud_moments, law_for, log_density, stand_in, through
from solvers.filters.particles.random_points import MATCHING, Keys, check_enough, draw, particle_count, run_keys
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Moments, NoiseLaw, Transition

PREDICT, CORRECT = 0, 1  #: purposes of draws


class Belief(NamedTuple):
    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    key: Keys  #: (...)
    ess: Array  #: (...) effective sample size of the last weighing, as a share of the particles
    health: Health


@dataclass(frozen=True)
class GaussianParticles(GaussianFilter[Belief]):
    """Base of the Gaussian particle filters."""

    particles: int = 2000
    matching: str = "pairs"  #: "pairs", "moments" or "none": what is exact about the particles before they are weighed
    marginal: bool = True  #: weigh no more than a linear h sees
    likelihood: str = "told"  #: of the fix: the law that is "told", or "gaussian"
    min_ess: float = 0.1  #: share of the particles below which the step takes the Kalman result
    memory_mb: float = 4.0  #: for the model's temporaries; small slices stay in the cache and are the fastest

    def __post_init__(self) -> None:
        keep(self, "matching", choice, MATCHING)
        keep(self, "particles", particle_count, self.matching)
        keep(self, "marginal", flag)
        keep(self, "likelihood", choice, LIKELIHOODS)
        keep(self, "min_ess", number, least=0.0, below=1.0)
        keep(self, "memory_mb", number, above=0.0)

    @cached_property
    def rule(self) -> MomentRule:
        """Of the Kalman filter beside it."""
        return SigmaPoints(Cubature())

    @property
    def kind(self) -> str:
        """Of the points, as in ``points_random.normals``."""
        return "random"

    @abstractmethod
    def proposal(self, prior: Gaussian, kalman: Gaussian, law: NoiseLaw | None) -> Gaussian:
        """Where particles are drawn: from the prior itself, or from a Gaussian made of the Kalman result."""

    def init(self, prior: Gaussian, rng: Any = None) -> Belief:
        """The belief at the start; ``rng``: one Generator, or a sequence with one per run."""
        b = initial_belief(prior)
        check_enough(self.particles, b.mean.shape[-1], self.matching)
        batch = b.mean.shape[:-1]
        return Belief(b.mean, b.cov, run_keys(rng, batch), np.ones(batch), b.health)

    def predict(self, b: Belief, tr: Transition) -> Belief:
        """Moments of f(x) over particles, and Q. # 000 (5.2.5-8)"""
        if isinstance(tr.f, Linear):
            return super().predict(b, tr)
        x, repaired = self.drawn(Gaussian(b.mean, b.cov), b, PREDICT)
        y = cloud_moments(through(tr.f, x, self.memory_mb))
        return count(b._replace(mean=y.mean, cov=y.cov + tr.Q), repaired)

    def correct(self, b: Belief, me: Measurement) -> tuple[Belief, Innovation]:
        """Weighted moments, or the Kalman result where too few particles count. # 000 (5.2.12-13), (5.2.3-4)"""
        x = Gaussian(b.mean, b.cov)
        y, repaired = moments(me.h, x, self.rule)
        law = law_for(self.likelihood, me.law)
        R = stand_in(me.z - y.mean, y.cov, me.R, law)
        kalman, innovation, repaired_S = condition(x, y._replace(cov=y.cov + R), me.z)
        if self.marginal and isinstance(me.h, Linear):
            seen, ess, repaired_L = self.weighed(b, Gaussian(y.mean, y.cov), _image(me.h, kalman), _identity, me, law)
            after = lifted(x, y, seen)
        else:
            after, ess, repaired_L = self.weighed(b, x, kalman, me.h, me, law)
        sound = (ess >= self.min_ess) & finite_items(after.cov)
        after = choose(sound, after, kalman)
        b = count(b._replace(mean=after.mean, cov=after.cov, ess=np.where(np.isfinite(ess), ess, 0.0)), repaired)
        b = count(count(b, repaired_S), repaired_L, ~sound)
        return b, innovation._replace(cov=y.cov + me.R)

    def weighed(
        self, b: Belief, prior: Gaussian, kalman: Gaussian, h: Function, me: Measurement, law: NoiseLaw | None
    ) -> tuple[Gaussian, Array, Any]:
        """Moments of the weighted particles, their relative effective sample size, and repairs."""
        q = self.proposal(prior, kalman, law)
        x, repaired = self.drawn(q, b, CORRECT)
        log_w = log_density(me.z[..., None, :] - through(h, x, self.memory_mb), me.R, law)
        if q is not prior:
            log_w += log_density(x - prior.mean[..., None, :], prior.cov)
            log_w -= log_density(x - q.mean[..., None, :], q.cov)
        w, _ = normalise(log_w)
        after = cloud_moments(x, w)
        number = effective(w)
        # unbiased; what matched particles have of their own accord is not corrected twice
        lost = 1.0 / number - (0.0 if self.matching == "none" else 1.0 / self.particles)
        return after._replace(cov=after.cov / (1.0 - lost)[..., None, None]), number / self.particles, repaired

    def drawn(self, x: Gaussian, b: Belief, purpose: int) -> tuple[Array, Any]:
        """Particles (..., M, n) of x, and the runs whose covariance was repaired."""
        S, repaired = cholesky(x.cov)
        where = (self.matching, self.kind, b.key, b.health.epoch, purpose, self.particles)
        return draw(*where, S, x.mean), repaired

    def diagnostics(self, b: Belief) -> dict[str, Array]:
        """Effective sample size as a share of the particles, and the steps that took the Kalman result."""
        return {"ess": b.ess, "fallbacks": b.health.fallbacks.astype(float)}


def lifted(x: Gaussian, y: Moments, seen: Gaussian) -> Gaussian:
    """x after its linear image y was found to have the moments ``seen``: mean + K (seen - y), cov - K (S - seen) K'."""
    K, _, _ = gain(y)
    mean = x.mean + (K @ (seen.mean - y.mean)[..., None])[..., 0]
    cov = x.cov - K @ (y.cov - seen.cov) @ K.mT
    return Gaussian(mean, symmetrize(cov))


def _image(h: Linear, x: Gaussian) -> Gaussian:
    y = linear_moments(h, x)
    return Gaussian(y.mean, y.cov)


def _identity(y: Array) -> Array:
    return y
