"""Predictive filter: the model error of an epoch is what best explains the fix at its end.

Idea: x' = f(x) + w with w = L d and L L' = Q. The filter has no prior covariance. It picks the d that minimises

    1/2 r' R^-1 r + 1/2 d' W d,    r = z - h(x').

Half of L d enters at either end of the epoch, so that x+ = x- + B d with B = (L + F L) / 2 and F the tangent of f. With S = H B
the minimum is at d = (S' R^-1 S + W)^-1 S' R^-1 (z - h(f(x))). This is the source's Lambda S in discrete form: a state that the
noise drives moves by dt, and one behind it by dt^2 / 2.

The unit of d is a standard deviation of the told noise, so W is one number. The update is the Kalman update from the prior
N(f(x), B B' / W). W follows the covariance constraint E[r r'] = R, with r after the update: each fix multiplies it by
exp(rate (1 - r' R^-1 r / m)). Residuals that are too large thus loosen the model, and small ones tighten it.

Source: Crassidis & Markley (1997), doi:10.2514/2.4035; 004 section 3.1, which prints no equations;
docs/mathematics/filters.md#predictive-filter.
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: the source has no covariance. The reported one is that of the errors which the gain K leaves under the told model,
(I - K H)(F P F' + Q)(I - K H)' + K R K'; it does not enter the estimate. The filter moves only what the noise drives, and only
as far as one epoch shows. It tracks, but it never learns a constant bias, hardly a heading, and so it cannot align.
"""

from __future__ import annotations

import math
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
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Moments, Transition

LARGEST = 10.0  #: squared residual over its expectation beyond which a fix does not loosen the model any further
RANGE = 1e12  #: largest factor between W and its value at the start, up or down


class PredictiveBelief(NamedTuple):
    """One estimate, its covariance under the told model, and the weight of the model error."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    reach: Array  #: (..., n, n), B B': how far the model error of an epoch can move the state
    trust: Array  #: (...), 1 / W


@register("mpf")
@dataclass(frozen=True)
class MPF(GaussianFilter[PredictiveBelief]):
    """The predictive filter of Crassidis and Markley on an epoch map."""

    weight: float = 1.0  #: W at the start, > 0; inf: no model error
    rate: float = 0.01  #: rate at which a fix adapts W to the covariance constraint, 0 to 1

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
        """Return the gain K (..., n, m) of the update, and a mask (...) of repaired runs.

        ``y`` holds the moments of z under the told model, ``by_error`` those under the model error of the epoch alone.
        """
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

    The prediction is x- = f(x) + B d, and the EKF update starts there. Both use the same fix, so the gains are joined:
    K = K_d + K_ekf (I - H K_d). The covariance is that of the joint gain, which is never below the EKF's. While the model
    holds, the constraint on the residuals turns d off. If the noise is larger than told, the filter takes it for model
    error and loses what the EKF has learnt. With ``weight`` inf it is the EKF.
    """

    def gain(self, y: Moments, by_error: Moments, H: Array) -> tuple[Array, Mask | None]:
        K_d, repaired = super().gain(y, by_error, H)
        K, _, repaired_S = gain(y)
        return K_d + K - K @ (H @ K_d), either(repaired, repaired_S)


SAME_AS = {
    "mpf": (),  # it has no prior covariance
    "mpf_ekf": (Relation("ekf", {"weight": math.inf}, within=1e-10),),
}
