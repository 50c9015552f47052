"""Particle filters in which each particle is a Gaussian filter: unscented, and hybrid extended (HEPF).

Idea: a particle (x_i, P_i) is a small Gaussian. A Kalman step of its own takes it through model and fix to N(x^_i, P^_i). The new
x_i is drawn from there, and weighed by likelihood times N(x_i; x-_i, P-_i) over N(x_i; x^_i, P^_i). Particles thus move towards
the fix, and few are enough.

Source: van der Merwe, Doucet, de Freitas & Wan (2000), The unscented particle filter, NIPS 13; Aggarwal, Syed & El-Sheimy
(2008), hybrid extended particle filter; 004 section 3.2; docs/mathematics/filters.md#particles-that-are-gaussians.
Shapes: particles (..., M, n), (..., M, n, n); f and h get (..., M, n) and (..., M points, n).
Departures: both sources take each x_i as a point whose transition density is N(f(x), Q), and yet carry a P_i as if it were
uncertain. In alignment Q is tiny, and zero for the biases, while P_i is not. The two densities then never meet, and one
particle takes all the weight, even if Q has a floor. Here P_i makes the transition density. After each fix the particles give
up the share ``kernel`` of their covariance V: x_i shrinks towards the mean, and P_i = kernel V (Liu and West's kernel). The
mixture of all then has the mean and covariance of the particles, and P-_i > 0 needs no floor. If h is linear, only what the
fix shows is weighed (Rao-Blackwell), as in gaussian_particles.py; otherwise chance takes the covariance of all other
directions away. Draws are fitted to the moments of the mixture from which they come, as in pf.py. Its rule for too few
particles holds here too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import keep, number
from sins_env.kernels import kernel
from solvers.blocks.conditioning import above_rounding, condition, log_normal, root_gain
from solvers.blocks.mixtures import collapse, effective, normalise, spread, spread_measurement, widen
from solvers.blocks.moments import Linearized, MomentRule, SigmaPoints, linear_moments, moments, transform
from solvers.blocks.sigma_rules import Unscented
from solvers.blocks.square_root import any_of, cholesky, symmetrize
from solvers.filters.base import count
from solvers.filters.inputs import wrapped
from solvers.filters.particles.gaussian_particles import lifted
from solvers.filters.particles.importance import (
    bandwidth,
    fit,
    law_for,
    log_density,
    stand_in,
    through,
)
from solvers.filters.particles.particle_filter import PREDICT, SEEN, ParticleFilter, log_weights
from solvers.filters.particles.planes import cloud_moments, taken
from solvers.filters.particles.random_points import Keys, normals
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Moments, NoiseLaw, Transition


class Swarm(NamedTuple):
    """Weighted particles with a covariance each, and the random stream of each run."""

    x: Array  #: (..., M, n), means of the particles
    P: Array  #: (..., M, n, n), covariances of the particles, or (..., 1, n, n) if all have the same
    log_w: Array  #: (..., M), logarithms of weights that sum to one
    key: Keys  #: (...), key of the random stream
    ess: Array  #: (...), effective sample size of the last weighing, as a share of the particles
    health: Health


@dataclass(frozen=True)
class KalmanParticles(ParticleFilter):
    """Base of the filters whose particles are Gaussians; a subclass gives the ``rule`` of the filter in each particle."""

    one_mean: ClassVar[bool] = False

    particles: int = 200  #: number of particles
    kernel: float | None = None  #: share of the covariance that the P_i carry; None: the best for a Gaussian

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kernel is not None:
            keep(self, "kernel", number, "a number > 0 and < 1, or None", above=0.0, below=1.0)
        _ = self.rule  # checks the settings

    @cached_property
    def rule(self) -> MomentRule:
        """How each particle passes through f and h."""
        raise NotImplementedError(f"{type(self).__name__} has no moment rule")

    def init(self, prior: Gaussian, rng: Any = None) -> Swarm:
        """Draw particles of the prior; ``rng`` is one Generator, or a sequence with one per run."""
        share = self.share(np.shape(prior.mean)[-1])
        x, cloud = self.start(prior, rng, 1.0 - share)
        return Swarm(cloud.x, share * x.cov[..., None, :, :], cloud.log_w, cloud.key, cloud.ess, cloud.health)

    def predict(self, b: Swarm, tr: Transition) -> Swarm:
        """Predict the Gaussian of each particle."""
        f = spread(self.sliced(tr.f), b.x.ndim - 2)
        y, repaired = transform(f, Gaussian(b.x, b.P), self.rule)
        return count(b._replace(x=y.mean, P=y.cov + widen(tr.Q)), any_of(repaired))

    def correct(self, b: Swarm, me: Measurement) -> tuple[Swarm, Innovation]:
        """Correct the Gaussian of each particle, draw from it and weigh the draw; then apply the kernel again."""
        before, law = np.exp(b.log_w), law_for(self.likelihood, me.law)
        prior, own = Gaussian(b.x, b.P), spread_measurement(me._replace(h=self.sliced(me.h)), b.x.ndim - 2)
        y, repaired = moments(own.h, prior, self.rule)
        R = stand_in(own.z - y.mean, y.cov, own.R, law)
        hat, _, repaired_S = condition(prior, y._replace(cov=y.cov + R), own.z)
        N = normals("random", b.key, b.health.epoch, PREDICT, *b.x.shape[-2:])
        marginal = isinstance(me.h, Linear)
        if marginal:
            hat, log_w, repaired_P = self._seen(b, prior, y, hat, me, law)
            x, lost = _drawn(hat.mean, cholesky(hat.cov)[0], N), None
        else:
            S, repaired_P = cholesky(hat.cov)
            x, lost = fit(_drawn(hat.mean, S, N), _mixture(before, *hat), before)
            v = wrapped(me.z[..., None, :] - through(me.h, x, self.memory_mb), me.turns)
            log_w = log_density(v, me.R, law, exact=True)
            log_w += log_normal(x - prior.mean, cholesky(prior.cov)[0]) - log_normal(x - hat.mean, S)
        w, _ = normalise(b.log_w + log_w)
        number = effective(w)
        few = self.too_few(number, x.shape[-1])
        target = self._lifted(b, me.h, hat, w) if isinstance(me.h, Linear) else cloud_moments(x, w)
        rows = (number < self.resample * self.particles) & ~few
        if rows.any():
            x[rows] = taken(x[rows], self.survivors(b, w, rows))
            w[rows] = 1.0 / self.particles
        seen = _mixture(before, y.mean, y.cov)
        if few.any():
            target = _kalman_where(few, target, _mixture(before, b.x, b.P), me, law, self.rule)
            w = np.where(few[..., None], before, w)
        share = self.share(x.shape[-1])
        x, unfit = fit(x, target._replace(cov=(1.0 - share) * target.cov), w)
        P = share * target.cov[..., None, :, :]
        ess = np.where(np.isfinite(number), number / self.particles, 0.0)
        b = count(b._replace(x=x, P=P, log_w=log_weights(w), ess=ess), unfit, few)
        for mask in (repaired, repaired_S, repaired_P):
            b = count(b, any_of(mask))
        return count(b, lost), Innovation(me.z - seen.mean, seen.cov + me.R)

    def _seen(
        self, b: Swarm, prior: Gaussian, y: Moments, hat: Gaussian, me: Measurement, law: NoiseLaw | None
    ) -> tuple[Gaussian, Array, Any]:
        """Return each particle after a linear fix (Rao-Blackwell), what its weight gains (..., M), and the repaired runs.

        With Gaussian noise the particle is its Kalman result, and gains the density of the fix. Otherwise y = h(x) is drawn and
        weighed, and x given y is exact: x + K (y_drawn - y) with the
        covariance P - K P_yy K'.
        """
        residual = wrapped(me.z[..., None, :] - y.mean, me.turns)
        if law is None:
            L, repaired = cholesky(y.cov + widen(me.R))
            return hat, log_normal(residual, L), repaired
        h = Linear(widen(cast(Linear, me.h).matrix))
        L, _ = cholesky(y.cov)
        K, W = root_gain(L, y.cross)
        target = linear_moments(h, hat)
        S, repaired = cholesky(target.cov)
        apart = target.mean - h(prior.mean)
        N = normals("random", b.key, b.health.epoch, SEEN, self.particles, apart.shape[-1])
        drawn, _ = fit(_drawn(target.mean, S, N), _mixture(np.exp(b.log_w), target.mean, target.cov), np.exp(b.log_w))
        moved = drawn - h(prior.mean)
        log_w = (
            log_density(residual - moved, me.R, law, exact=True) + log_normal(moved, L) - log_normal(moved - apart, S)
        )
        mean = prior.mean + np.matmul(K, moved[..., None])[..., 0]
        return Gaussian(mean, above_rounding(prior.cov - W.mT @ W, prior.cov)), log_w, repaired

    def _lifted(self, b: Swarm, h: Linear, hat: Gaussian, w: Array) -> Gaussian:
        """Return the moments of all particles after a linear fix: those of y = h(x) from the weights, the rest by regression."""
        whole = self.estimate(b)
        y = linear_moments(Linear(widen(h.matrix)), hat)
        seen = collapse(w, Gaussian(y.mean, np.broadcast_to(y.cov, (*w.shape, *y.cov.shape[-2:]))))
        return lifted(whole, linear_moments(Linear(h.matrix), whole), seen)

    def share(self, n: int) -> float:
        """Return the kernel's share of the covariance for n states."""
        return bandwidth(self.particles, n) ** 2 if self.kernel is None else self.kernel

    def sliced(self, g: Function) -> Function:
        """Return g in slices that fit in memory, unless it is linear or has a Jacobian of its own."""
        if isinstance(g, Linear) or getattr(g, "jacobian", None) is not None:
            return g
        return partial(through, g, memory_mb=self.memory_mb)

    def estimate(self, b: Swarm) -> Gaussian:
        """Return mean (..., n) and covariance (..., n, n) of the mixture."""
        return _mixture(np.exp(b.log_w), b.x, b.P)

    def move(self, b: Swarm, g: Function, jac: Callable[[Array], Array]) -> Swarm:
        J = jac(b.x)
        if J.ndim < b.P.ndim:  # one Jacobian for all particles
            J = widen(J)
        return b._replace(x=through(g, b.x, self.memory_mb), P=symmetrize(J @ b.P @ J.mT))


@register("upf")
@dataclass(frozen=True)
class UPF(KalmanParticles):
    """The unscented particle filter."""

    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(Unscented(self.alpha, self.beta, self.kappa))


@register("hepf")
@dataclass(frozen=True)
class HEPF(KalmanParticles):
    """The hybrid extended particle filter."""

    @cached_property
    def rule(self) -> Linearized:
        return Linearized("mean")


def _kalman_where(few: Mask, other: Gaussian, prior: Gaussian, me: Measurement, law: Any, rule: MomentRule) -> Gaussian:
    """Return the Kalman result of ``prior`` in the runs of the mask, and ``other`` in the rest."""
    y, _ = moments(me.h, prior, rule)
    R = stand_in(me.z - y.mean, y.cov, me.R, law)
    kalman, _, _ = condition(prior, y._replace(cov=y.cov + R), me.z)
    mean = np.where(few[..., None], kalman.mean, other.mean)
    return Gaussian(mean, np.where(few[..., None, None], kalman.cov, other.cov))


def _mixture(w: Array, x: Array, P: Array) -> Gaussian:
    """Return the moments of Gaussians with weights (..., M) and means (..., M, n), and one covariance each or for all."""
    return collapse(w, Gaussian(x, np.broadcast_to(P, (*x.shape, x.shape[-1]))))


@kernel("(n),(n,n),(n)->(n)")
def _drawn(mean: Array, S: Array, N: Array, out: Array) -> None:
    """Fill in mean + S N, for a lower S."""
    for i in range(len(mean)):
        out[i] = mean[i]
        for k in range(i + 1):
            out[i] += S[i, k] * N[k]


SAME_AS = {
    "upf": (),  # its particles are drawn
    "hepf": (),  # its particles are drawn
}
UNLIKE = {
    "upf": (Relation("hepf"),),
}
