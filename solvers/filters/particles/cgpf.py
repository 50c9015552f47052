"""Gaussian particle filters with particles drawn from the result of the cubature filter, or of the unscented filter.

Idea: a Kalman step with sigma points says where the belief will be; particles are drawn there. They are weighed by what the step
left out, which is prior times likelihood over the density that they were drawn from. In a linear problem with Gaussian noise
all weigh the same, and the Kalman result stands.

Source: 000 (5.4.1-18); docs/mathematics/filters.md#gaussian-particles.
Shapes: x (..., n), P (..., n, n), z (..., m).
Departures:

- Equation (5.4.15) is corrected (docs/mathematics/errata.md no. 57).
- Particles are matched and weights are marginal, as in gpf.py.
- If the task tells a noise that is not Gaussian, the Kalman step takes an R that stands for it at the residual seen.
- The proposal is then widened by the setting ``widen``, rho in 000, for the posterior has longer tails than any Kalman result.
  Widened particles weigh differently even in a linear problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from sins_env.checks import keep, number
from solvers.blocks.moments import SigmaPoints
from solvers.blocks.sigma_rules import Unscented
from solvers.filters.gaussian import GaussianFilter
from solvers.filters.particles.gaussian_particles import Belief, GaussianParticles
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Gaussian, NoiseLaw, Transition

TOLD_WIDEN = 1.5  #: default of ``widen`` if the task tells a noise that is not Gaussian


@register("cgpf")
@dataclass(frozen=True)
class CGPF(GaussianParticles):
    """The cubature Gaussian particle filter."""

    widen: float | None = None  #: rho >= 1, factor of the proposal's deviations; None: 1, or 1.5 for a told law

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.widen is not None:
            keep(self, "widen", number, "a number >= 1 and <= 10, or None", least=1.0, most=10.0)

    def predict(self, b: Belief, tr: Transition) -> Belief:
        """Return the belief one epoch later, by sigma points: 000 (5.4.1-6)."""
        return GaussianFilter.predict(self, b, tr)

    def proposal(self, prior: Gaussian, kalman: Gaussian, law: NoiseLaw | None) -> Gaussian:
        rho = self.widen or (1.0 if law is None else TOLD_WIDEN)
        return kalman._replace(cov=rho**2 * kalman.cov)


@register("ugpf")
@dataclass(frozen=True)
class UGPF(CGPF):
    """The unscented Gaussian particle filter."""

    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.rule  # checks the settings

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(Unscented(self.alpha, self.beta, self.kappa))


SAME_AS = {
    "cgpf": (
        Relation("kf", on="linear", within=1e-10),  # all particles weigh the same
        Relation("ckf", on="nonlinear f", within=1e-10),
    ),
    "ugpf": (
        Relation("ukf", {"beta": 2.0}, {"beta": 2.0}, on="nonlinear f", within=1e-10),
        Relation("cgpf", within=1e-10),
    ),
}
UNLIKE = {
    "cgpf": (Relation("cgpf", of_other={"widen": 1.2}),),
    "ugpf": (Relation("ugpf", of_other={"beta": 2.0}),),
}
