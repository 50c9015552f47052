"""H-infinity filters hinf_kf and hinf_ukf: a bound on the worst gain from disturbances to errors.

Idea: gain and mean as in the Kalman filter, then the covariance is inflated, P = (D^-1 - gamma^-2 L'L)^-1, which keeps
sum |L e|^2 below gamma^2 (|x0 - x^|^2 in P0^-1 + sum |w|^2 in Q^-1 + sum |v|^2 in R^-1), whatever x0, w and v are.
gamma -> infinity is the Kalman filter. An ordinary filter with Q + Phi (P - D) Phi' in the next prediction is the same.

Source: 000 (4.2.14-24), (4.3.5-22); Hassibi, Sayed & Kailath (1996), Linear estimation in Krein spaces,
IEEE Trans. Automatic Control 41(1); docs/mathematics/filters.md#h-infinity.
Shapes: x (..., n), P (..., n, n), z (..., m), gamma (...); ``...`` any batch.
Departures:
- L = diag(1 / sigma_i) of the prior instead of I, which adds rad to m/s: gamma has no unit. It keeps out of L the
  states that no noise drives, such as biases: one that no fix sees gains no information, so its covariance escapes
  after ``horizon_s`` with certainty. (In SI units L = I does the same unawares: a bias is a small number there.)
- The sum over fixes is one over time, each fix with the seconds since the last: gamma^2 = horizon_s / seconds. So the
  rates of fixes and epochs do not matter, and a state of prior variance escapes if it stays unobserved for horizon_s.
- Existence, gamma^2 > lambda_max(L D L'), is seen to at every fix; (4.2.18) prints the posterior in place of D^-1. Where
  it fails, or lambda_max(L P L') would exceed ``cap``, gamma is raised for that fix, just enough, and counted. Existence
  alone is a poor safeguard: just above it P has no bound, and sigma points twice around the circle do not come back.
With a gamma that varies, by horizon_s at uneven fixes excepted, only the bound of the largest survives.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, TypeVar, cast

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import choice, keep, number, numbers, refused
from solvers.blocks.moments import Linearized, MomentRule, SigmaPoints
from solvers.blocks.sigma_rules import Unscented
from solvers.filters.base import count
from solvers.filters.gaussian import GaussianFilter, initial_belief
from solvers.filters.hinfinity.inflation import admissible, inflate, largest, reciprocal_deviations
from solvers.filters.registry import register
from solvers.types import Gaussian, Health, Innovation, Measurement, Transition


class HinfBelief(NamedTuple):
    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n) the inflated P
    scale: Array  #: (..., n) what L would be with all states in it
    weight: Array  #: (..., n) diagonal of L
    waited: Array  #: (...) s since the last inflation
    theta: Array  #: (...) gamma^-2 of the last inflation
    health: Health


B = TypeVar("B", bound=Any)  #: an HinfBelief, or a NamedTuple with the fields of one and more

WEIGH = ("driven", "all")
ON_FAILURE = ("raise_gamma", "error")


@dataclass(frozen=True)
class HinfFilter(GaussianFilter[B]):
    """Base: the settings, L and gamma; a subclass gives the ``rule``."""

    gamma2: float | None = None  #: gamma^2 at every fix; None: from horizon_s; inf: the Kalman filter
    horizon_s: float = 60.0  #: s, gamma^2 times the time between fixes
    #: s, gamma^2 is at least (1 + tau_s / time between fixes) lambda_max(L D L'); None: fixed
    tau_s: float | None = None
    weigh: str = "driven"  #: what L holds: states with process noise, or "all"
    weights: tuple[float, ...] | None = None  #: the diagonal of L, of all states; None: 1 / sigma of the prior
    cap: float = 2.0  #: how far an inflation may take lambda_max(L P L'), in units of the prior, > 1
    on_failure: str = "raise_gamma"  #: or "error": a ValueError where gamma would have to be raised
    dt_s: float = 1.0  #: s per epoch, where the transition does not say

    def __post_init__(self) -> None:
        _ = self.rule  # checks its settings
        if self.gamma2 is not None:
            allowed = "None, a number > 0, or inf (the Kalman filter); with a tau_s 0 too"
            keep(self, "gamma2", number, allowed, least=0.0, infinite=True)
            if self.gamma2 == 0.0 and self.tau_s is None:
                raise refused("gamma2", self.gamma2, allowed)
        keep(self, "horizon_s", number, above=0.0)
        if self.tau_s is not None:
            keep(self, "tau_s", number, "None, or a finite number > 0", above=0.0)
        keep(self, "weigh", choice, WEIGH)
        if self.weights is not None:
            keep(self, "weights", numbers, None, "None, or finite numbers >= 0, one per state", least=0.0)
        keep(self, "cap", number, above=1.0)
        keep(self, "on_failure", choice, ON_FAILURE)
        keep(self, "dt_s", number, above=0.0)

    def init(self, prior: Gaussian, rng: Any = None) -> B:
        """The belief at the start, with the scale of L; ``rng`` is not used."""
        x = initial_belief(prior)
        scale, zeros = reciprocal_deviations(x.cov), np.zeros(x.mean.shape[:-1])
        if self.weights is not None:
            if len(self.weights) != x.mean.shape[-1]:
                raise refused("weights", self.weights, f"as many numbers as states, {x.mean.shape[-1]}")
            scale = np.broadcast_to(self.weights, x.mean.shape).copy()
        return self.belief(HinfBelief(x.mean, x.cov, scale, scale, zeros, zeros, x.health))

    def belief(self, b: HinfBelief) -> B:
        """``b`` as this filter's belief at the start."""
        return cast(B, b)

    def predict(self, b: B, tr: Transition) -> B:
        """The belief one epoch later."""
        return self.wait(super().predict(b, tr), tr)

    def wait(self, b: B, tr: Transition) -> B:
        """The belief with the time and the L of this epoch."""
        weight = b.scale
        if self.weigh == "driven" and self.weights is None:
            weight = weight * (np.diagonal(tr.Q, axis1=-2, axis2=-1) > 0.0)
        return b._replace(weight=weight, waited=b.waited + (self.dt_s if tr.dt is None else tr.dt))

    def correct(self, b: B, me: Measurement) -> tuple[B, Innovation]:
        """The Kalman filter's correction, then the inflation."""
        b, innovation = super().correct(b, me)
        b = self.bound(b, b.cov)
        return b._replace(cov=inflate(b.cov, b.weight, b.theta)), innovation

    def bound(self, b: B, D: Array) -> B:
        """The belief with the theta = gamma^-2 that the posterior D (..., n, n) is to be inflated with."""
        with np.errstate(divide="ignore"):
            wanted = b.waited / self.horizon_s if self.gamma2 is None else np.full_like(b.waited, 1.0) / self.gamma2
            if self.tau_s is not None:
                wanted = np.minimum(wanted, 1.0 / ((1.0 + self.tau_s / b.waited) * largest(D, b.weight)))
                wanted = np.where(wanted < np.inf, wanted, 0.0)  # gamma2 = 0, and nothing to bound
            theta, lowered = admissible(D, b.weight, wanted, self.cap)
        if lowered is not None and self.on_failure == "error":
            self._refuse(b, D, wanted, lowered & (b.health.failed_at < 0))
        return count(b._replace(theta=theta, waited=np.zeros_like(theta)), fallbacks=lowered)

    def _refuse(self, b: B, D: Array, theta: Array, lowered: Mask) -> None:
        for i in np.argwhere(lowered)[:1]:
            run = tuple(i.tolist())
            top = float(largest(D[run], b.weight[run]))
            why = (
                "no such filter exists"
                if theta[run] * top >= 1.0
                else f"the covariance escapes beyond cap = {self.cap:g}"
            )
            raise ValueError(
                f"gamma^2 = {1.0 / theta[run]:.4g} at epoch {b.health.epoch + 1}, run {run}: {why}, for lambda_max(L D L') = "
                f"{top:.4g}. Allowed: a larger gamma2 or horizon_s, the adaptive rule by tau_s, or on_failure='raise_gamma'"
            )

    def diagnostics(self, b: B) -> dict[str, Array]:
        """gamma^-2 of the last inflation, and lambda_max(L P L'), which tells of an escape."""
        return {"inverse_gamma2": b.theta, "largest": largest(b.cov, b.weight)}


@register("hinf_kf")
@dataclass(frozen=True)
class HinfKF(HinfFilter[HinfBelief]):
    """The linear H-infinity filter of the error dynamics at zero error; closed loop, as kf."""

    feedback: ClassVar[str] = "closed"  #: what the pipeline does unless told otherwise

    @cached_property
    def rule(self) -> MomentRule:
        return Linearized("origin")


@dataclass(frozen=True)
class UnscentedHinf(HinfFilter[B]):
    """Base of those with the unscented rule."""

    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 knows of a Gaussian's fourth moment, 0 nothing beyond the covariance
    kappa: float = 0.0  #: second spread parameter, > -n
    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(Unscented(self.alpha, self.beta, self.kappa), self.root)


@register("hinf_ukf")
@dataclass(frozen=True)
class HinfUKF(UnscentedHinf[HinfBelief]):
    """The H-infinity unscented Kalman filter."""
