"""What the Gaussian particle filters share: particles for the moments of a step, a Gaussian from step to step.

A filter of this family says from where its particles are drawn. The belief holds the Gaussian, the key of each run's random
stream, and the effective sample size. No particle outlives its step.

If h is ``Linear``, the likelihood depends on y = h(x) alone, and x given y is Gaussian with known moments. With ``marginal``
only y is sampled and weighed, and the rest follows exactly (Rao-Blackwell). Otherwise every weighing adds noise of relative
size 1 / sqrt(M) to directions about which the fix says nothing. Thousands of weighings then destroy the covariance. Process
noise enters through Q itself, not through draws, and a ``Linear`` f is used exactly.

The functions f and h get the particles in slices of the particle axis, because a transition cannot be split into runs.
``memory_mb`` bounds their temporaries. The particles themselves take 8 M n bytes per run, twice.
Equations: docs/mathematics/filters.md#gaussian-particles.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

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
from solvers.filters.inputs import wrapped
from solvers.filters.particles.importance import LIKELIHOODS, law_for, log_density, stand_in, through
from solvers.filters.particles.planes import cloud_moments
from solvers.filters.particles.random_points import MATCHING, Keys, check_enough, draw, particle_count, run_keys
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Moments, NoiseLaw, Transition

PREDICT, CORRECT = 0, 1  #: what a draw is for, so that each has random numbers of its own


class Belief(NamedTuple):
    """One Gaussian, and the random stream of each run."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    key: Keys  #: (...), key of the random stream
    ess: Array  #: (...), effective sample size of the last weighing, as a share of the particles
    health: Health


@dataclass(frozen=True)
class GaussianParticles(GaussianFilter[Belief]):
    """Base of the Gaussian particle filters.

    Raises:
        ValueError: a setting outside its range; in ``init``, too few particles for the number of states.
    """

    predicts_by_rule: ClassVar[bool] = False

    particles: int = 2000  #: number of particles
    matching: str = "pairs"  #: how draws are matched to their moments: "pairs", "moments" or "none"
    marginal: bool = True  #: whether only the directions that a linear h sees are weighed
    likelihood: str = "told"  #: likelihood of a fix: "told", the law that the task tells, or "gaussian"
    min_ess: float = 0.1  #: effective share of the particles below which the step takes the Kalman result
    memory_mb: float = 4.0  #: memory for the temporaries of f and h; small slices stay in the cache and are the fastest

    def __post_init__(self) -> None:
        keep(self, "matching", choice, MATCHING)
        keep(self, "particles", particle_count, self.matching)
        keep(self, "marginal", flag)
        keep(self, "likelihood", choice, LIKELIHOODS)
        keep(self, "min_ess", number, least=0.0, below=1.0)
        keep(self, "memory_mb", number, above=0.0)

    @cached_property
    def rule(self) -> MomentRule:
        """The moment rule of the Kalman step that accompanies the particles."""
        return SigmaPoints(Cubature())

    @property
    def kind(self) -> str:
        """The kind of random points: "random", or a key of ``random_points.POINTS``."""
        return "random"

    @abstractmethod
    def proposal(self, prior: Gaussian, kalman: Gaussian, law: NoiseLaw | None) -> Gaussian:
        """Return the Gaussian from which particles are drawn: the prior itself, or one made of the Kalman result."""

    def init(self, prior: Gaussian, rng: Any = None) -> Belief:
        """Make the belief at the start; ``rng`` is one Generator, or a sequence with one per run."""
        b = initial_belief(prior)
        check_enough(self.particles, b.mean.shape[-1], self.matching)
        batch = b.mean.shape[:-1]
        return Belief(b.mean, b.cov, run_keys(rng, batch), np.ones(batch), b.health)

    def predict(self, b: Belief, tr: Transition) -> Belief:
        """Return the belief one epoch later: the moments of f(x) over particles, and Q added: 000 (5.2.5-8)."""
        if isinstance(tr.f, Linear):
            return super().predict(b, tr)
        x, repaired = self.drawn(Gaussian(b.mean, b.cov), b, PREDICT)
        y = cloud_moments(through(tr.f, x, self.memory_mb))
        return count(b._replace(mean=y.mean, cov=y.cov + tr.Q), repaired)

    def correct(self, b: Belief, me: Measurement) -> tuple[Belief, Innovation]:
        """Return the belief of the weighted moments, or the Kalman result if too few particles count.

        Equations 000 (5.2.12-13), (5.2.3-4).
        """
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
        """Return the moments of the weighted particles, their effective sample size as a share, and the repaired runs."""
        q = self.proposal(prior, kalman, law)
        x, repaired = self.drawn(q, b, CORRECT)
        log_w = log_density(
            wrapped(me.z[..., None, :] - through(h, x, self.memory_mb), me.turns), me.R, law, exact=True
        )
        if q is not prior:
            log_w += log_density(x - prior.mean[..., None, :], prior.cov)
            log_w -= log_density(x - q.mean[..., None, :], q.cov)
        w, _ = normalise(log_w)
        after = cloud_moments(x, w)
        number = effective(w)
        # an unbiased covariance; matched particles already have the part 1 / M
        lost = 1.0 / number - (0.0 if self.matching == "none" else 1.0 / self.particles)
        return after._replace(cov=after.cov / (1.0 - lost)[..., None, None]), number / self.particles, repaired

    def drawn(self, x: Gaussian, b: Belief, purpose: int) -> tuple[Array, Any]:
        """Draw particles (..., M, n) of x, and return them with the runs whose covariance was repaired."""
        S, repaired = cholesky(x.cov)
        where = (self.matching, self.kind, b.key, b.health.epoch, purpose, self.particles)
        return draw(*where, S, x.mean), repaired

    def diagnostics(self, b: Belief) -> dict[str, Array]:
        """Return the effective sample size as a share, and the number of steps that took the Kalman result."""
        return {"ess": b.ess, "fallbacks": b.health.fallbacks.astype(float)}


def lifted(x: Gaussian, y: Moments, seen: Gaussian) -> Gaussian:
    """Return x after its linear image y turned out to have the moments ``seen``.

    The mean is x + K (seen - y), the covariance P - K (S - seen) K', with S the covariance of y.
    """
    K, _, _ = gain(y)
    mean = x.mean + (K @ (seen.mean - y.mean)[..., None])[..., 0]
    cov = x.cov - K @ (y.cov - seen.cov) @ K.mT
    return Gaussian(mean, symmetrize(cov))


def _image(h: Linear, x: Gaussian) -> Gaussian:
    y = linear_moments(h, x)
    return Gaussian(y.mean, y.cov)


def _identity(y: Array) -> Array:
    return y
