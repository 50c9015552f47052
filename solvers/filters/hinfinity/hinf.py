"""H-infinity filters hinf_kf and hinf_ukf: a bound on the worst gain from disturbances to errors.

Idea: gain and mean are those of the Kalman filter. Then the posterior covariance D is inflated,

    P = (D^-1 - gamma^-2 L'L)^-1,

which keeps sum |L e|^2 below gamma^2 (|x0 - x^|^2 in P0^-1 + sum |w|^2 in Q^-1 + sum |v|^2 in R^-1) for all x0, w and v.
With gamma -> infinity it is the Kalman filter. Adding Phi (P - D) Phi' to Q in the next prediction is the same filter.

Source: 000 (4.2.14-24), (4.3.5-22); Hassibi, Sayed & Kailath (1996), Linear estimation in Krein spaces,
IEEE Trans. Automatic Control 41(1); docs/mathematics/filters.md#h-infinity.
Shapes: x (..., n), P (..., n, n), z (..., m), gamma (...); ``...`` any batch.
Departures:

- L is diag(1 / sigma_i) of the prior, so that gamma has no unit; L = I would add rad to m/s. States that no noise drives, such
  as biases, are left out of L. If no fix observes such a state, its covariance would certainly escape after ``horizon_s``.
- The sum over fixes is made one over time: each fix counts with the seconds since the last, gamma^2 = horizon_s / seconds.
  The rates of fixes and epochs then do not matter. A state of prior variance escapes if it stays unobserved for ``horizon_s``.
- Existence, gamma^2 > lambda_max(L D L'), is checked at every fix (docs/mathematics/errata.md no. 42). If it fails, or
  lambda_max(L P L') would exceed ``cap``, gamma is raised for this fix as far as needed, and counted. Existence alone is a
  poor safeguard. Just above it P has no bound, and sigma points that go twice around the circle do not come back.

If gamma varies, only the bound of the largest gamma holds; a variation by ``horizon_s`` at uneven fixes is the exception.
"""

from __future__ import annotations

import math
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
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Gaussian, Health, Innovation, Measurement, Transition


class HinfBelief(NamedTuple):
    """One Gaussian with an inflated covariance, and what the next inflation needs."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n), the inflated P
    scale: Array  #: (..., n), diagonal of L if all states were in it
    weight: Array  #: (..., n), diagonal of L
    waited: Array  #: (...), s since the last inflation
    theta: Array  #: (...), gamma^-2 of the last inflation
    health: Health


B = TypeVar("B", bound=Any)  #: an HinfBelief, or a NamedTuple with the fields of one and more

WEIGH = ("driven", "all")
ON_FAILURE = ("raise_gamma", "error")


@dataclass(frozen=True)
class HinfFilter(GaussianFilter[B]):
    """Base of the H-infinity filters: the settings, L and gamma; a subclass gives the ``rule``.

    Raises:
        ValueError: a setting outside its range; with ``on_failure`` "error", a gamma that would have to be raised.
    """

    gamma2: float | None = None  #: gamma^2 at every fix; None: from horizon_s; inf: the Kalman filter
    horizon_s: float = 60.0  #: s, gamma^2 times the time between fixes
    #: s, keeps gamma^2 at least (1 + tau_s / time between fixes) lambda_max(L D L'); None: no such rule
    tau_s: float | None = None
    weigh: str = "driven"  #: states that L holds: "driven", those with process noise, or "all"
    weights: tuple[float, ...] | None = None  #: the diagonal of L, for all states; None: 1 / sigma of the prior
    cap: float = 2.0  #: largest lambda_max(L P L') that an inflation may reach, in units of the prior, > 1
    on_failure: str = "raise_gamma"  #: "raise_gamma", or "error": a ValueError instead
    dt_s: float = 1.0  #: s per epoch, if the transition does not tell it

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
        """Make the belief at the start, with the scale of L. ``rng`` is not used.

        Raises:
            ValueError: ``weights`` has another length than the state.
        """
        x = initial_belief(prior)
        scale, zeros = reciprocal_deviations(x.cov), np.zeros(x.mean.shape[:-1])
        if self.weights is not None:
            if len(self.weights) != x.mean.shape[-1]:
                raise refused("weights", self.weights, f"as many numbers as states, {x.mean.shape[-1]}")
            scale = np.broadcast_to(self.weights, x.mean.shape).copy()
        return self.belief(HinfBelief(x.mean, x.cov, scale, scale, zeros, zeros, x.health))

    def belief(self, b: HinfBelief) -> B:
        """Make this filter's own belief at the start from ``b``."""
        return cast(B, b)

    def predict(self, b: B, tr: Transition) -> B:
        """Return the belief one epoch later."""
        return self.wait(super().predict(b, tr), tr)

    def wait(self, b: B, tr: Transition) -> B:
        """Add the time of this epoch to the belief, and set its L."""
        weight = b.scale
        if self.weigh == "driven" and self.weights is None:
            weight = weight * (np.diagonal(tr.Q, axis1=-2, axis2=-1) > 0.0)
        return b._replace(weight=weight, waited=b.waited + (self.dt_s if tr.dt is None else tr.dt))

    def correct(self, b: B, me: Measurement) -> tuple[B, Innovation]:
        """Correct as the Kalman filter does, then inflate the covariance."""
        b, innovation = super().correct(b, me)
        b = self.bound(b, b.cov)
        return b._replace(cov=inflate(b.cov, b.weight, b.theta)), innovation

    def bound(self, b: B, D: Array) -> B:
        """Set the theta = gamma^-2 with which the posterior covariance D (..., n, n) is to be inflated.

        Raises:
            ValueError: gamma would have to be raised, and ``on_failure`` is "error".
        """
        with np.errstate(divide="ignore"):
            wanted = b.waited / self.horizon_s if self.gamma2 is None else np.full_like(b.waited, 1.0) / self.gamma2
            if self.tau_s is not None:
                wanted = np.minimum(wanted, 1.0 / ((1.0 + self.tau_s / b.waited) * largest(D, b.weight)))
                wanted = np.where(wanted < np.inf, wanted, 0.0)  # inf if gamma2 = 0 and there is nothing to bound
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
        """Return gamma^-2 of the last inflation, and lambda_max(L P L'), which grows when a covariance escapes."""
        return {"inverse_gamma2": b.theta, "largest": largest(b.cov, b.weight)}


@register("hinf_kf")
@dataclass(frozen=True)
class HinfKF(HinfFilter[HinfBelief]):
    """The linear H-infinity filter of the error dynamics at zero error, run closed loop."""

    feedback: ClassVar[str] = "closed"  #: feedback into the INS, unless a setting says otherwise

    @cached_property
    def rule(self) -> MomentRule:
        return Linearized("origin")


@dataclass(frozen=True)
class UnscentedHinf(HinfFilter[B]):
    """Base of the H-infinity filters with the unscented rule."""

    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n
    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(Unscented(self.alpha, self.beta, self.kappa), self.root)


@register("hinf_ukf")
@dataclass(frozen=True)
class HinfUKF(UnscentedHinf[HinfBelief]):
    """The H-infinity unscented Kalman filter."""


SAME_AS = {
    "hinf_kf": (Relation("kf", {"gamma2": math.inf}),),
    "hinf_ukf": (Relation("ukf", {"gamma2": math.inf}),),
}
