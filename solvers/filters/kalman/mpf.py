"""Predictive filter: the model error of an epoch is what best explains the fix at its end.

Idea: x' = f(x) + w, w = L d with L L' = Q. The filter has no prior covariance; it picks the d that minimises

    1/2 r' R^-1 r + 1/2 d' W d,    r = z - h(x'),

puts half of L d in at either end of the epoch, and so x+ = x- + B d, B = (L + F L) / 2, F the tangent of f. With
S = H B that is d = (S' R^-1 S + W)^-1 S' R^-1 (z - h(f(x))). # docs/mathematics/filters.md#predictive-filter, with
Lambda S of the source in discrete form: half
and half gives dt for a state that is driven itself and dt^2 / 2 for one that is driven through another.

As d is in standard deviations of the told noise, W is one number, and the update is the Kalman update from the prior
N(f(x), B B' / W). W follows the covariance constraint E[r r'] = R, r after the update: each fix turns it by
exp(rate (1 - r' R^-1 r / m)), so residuals that are too large loosen the model and others tighten it.

Source: Crassidis & Markley (1997), doi:10.2514/2.4035; 004 section 3.1, which prints no equations.
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: the source has no covariance. The one reported is that of the errors of this gain K under the told model,
(I - K H)(F P F' + Q)(I - K H)' + K R K', and does not enter the estimate. The filter moves only what the noise drives,
and only as much as one epoch lets the fix see: constant biases are never learnt, and a heading hardly: it tracks, it
cannot align. # docs/mathematics/filters.md#predictive-filter
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import keep, number
from solvers.blocks.conditioning import gain, nis, posterior_cov
from solvers.blocks.moments import Linearized, linear_moments, standard_deviations, tangent
from solvers.blocks.square_root import either, semidefinite_root, symmetrize
from solvers.filters.base import count
from solvers.filters.gaussian import GaussianFilter, initial_belief
from solvers.filters.registry import register
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Moments, Transition

LARGEST = 10.0  #: squared residual over its expectation, beyond which a fix does not loosen the model further
RANGE = 1e12  #: by which W may leave the value that it started from, up or down


class PredictiveBelief(NamedTuple):
    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    reach: Array  #: (..., n, n) B B': where the model error of the epoch can carry the state
    trust: Array  #: (...) 1 / W


@register("mpf")
@dataclass(frozen=True)
class MPF(GaussianFilter[PredictiveBelief]):
    """The predictive filter of Crassidis and Markley on an epoch map."""

    weight: float = 1.0  #: W at the start, > 0; inf: no model error
    rate: float = 0.01  #: of the adaptation of W to the covariance constraint per fix, at least 0

    def __post_init__(self) -> None:
        keep(self, "weight", number, least=1e-12, infinite=True)
        keep(self, "rate", number, least=0.0, most=1.0)

    @cached_property
    def rule(self) -> Linearized:
        return Linearized("mean")

    def init(self, prior: Gaussian, rng: Any = None) -> PredictiveBelief:
        mean, cov, health = initial_belief(prior)
        return PredictiveBelief(mean, cov, health, np.zeros(cov.shape), np.full(mean.shape[:-1], 1.0 / self.weight))

    def predict(self, b: PredictiveBelief, tr: Transition) -> PredictiveBelief:
        mean, F = tangent(tr.f, b.mean, standard_deviations(b.cov))
        cov = linear_moments(Linear(F), Gaussian(b.mean, b.cov)).cov + tr.Q
        L, repaired = semidefinite_root(tr.Q)
        B = 0.5 * (L + F @ L)
        return count(b._replace(mean=mean, cov=cov, reach=np.broadcast_to(B @ B.mT, cov.shape)), repaired)

    def correct(self, b: PredictiveBelief, me: Measurement) -> tuple[PredictiveBelief, Innovation]:
        y0, H = tangent(me.h, b.mean, standard_deviations(b.cov))
        prior, driven = Gaussian(b.mean, b.cov), Gaussian(b.mean, b.trust[..., None, None] * b.reach)
        y, by_error = (linear_moments(Linear(H), x) for x in (prior, driven))
        y, by_error = (u._replace(mean=y0, cov=u.cov + me.R) for u in (y, by_error))
        K, repaired = self.gain(y, by_error, H)
        residual = me.z - y0
        mean = b.mean + (K @ residual[..., None])[..., 0]
        left = nis(Innovation(me.z - me.h(mean), np.broadcast_to(me.R, y.cov.shape))) / me.z.shape[-1]
        trust = b.trust * np.exp(self.rate * (np.minimum(left, LARGEST) - 1.0))
        trust = np.clip(trust, 1.0 / (self.weight * RANGE), RANGE / self.weight)
        b = b._replace(mean=mean, cov=posterior_cov(prior, y, K), trust=trust)
        return count(b, repaired), Innovation(residual, y.cov)

    def gain(self, y: Moments, by_error: Moments, H: Array) -> tuple[Array, Mask | None]:
        """K (..., n, m) of the whole update, from the moments of z under the told model and under its error alone."""
        K, _, repaired = gain(by_error)
        return K, repaired

    def move(self, b: PredictiveBelief, g: Function, jac: Any) -> PredictiveBelief:
        J = jac(b.mean)
        return super().move(b, g, jac)._replace(reach=symmetrize(J @ b.reach @ J.mT))

    def diagnostics(self, b: PredictiveBelief) -> dict[str, Array]:
        return {"trust": b.trust}


@register("mpf_ekf")
@dataclass(frozen=True)
class MPFEKF(MPF):
    """The extended Kalman filter whose prediction takes in the model error that the predictive filter finds.

    x- = f(x) + B d, then the EKF update from there. Both use the same fix, so the gains are joined,
    K = K_d + K_ekf (I - H K_d), and the covariance is that of the joint gain: never below the EKF's, for a right model
    needs no d. The constraint on the residuals turns d off while the model holds; noise heavier than told it cannot tell
    from model error, and then it spoils what the EKF has learnt. weight = inf is the EKF.
    """

    def gain(self, y: Moments, by_error: Moments, H: Array) -> tuple[Array, Mask | None]:
        K_d, repaired = super().gain(y, by_error, H)
        K, _, repaired_S = gain(y)
        return K_d + K - K @ (H @ K_d), either(repaired, repaired_S)
