"""Interacting multiple models: filters of different noise levels that trade places.

Idea: a bank of filters, one per model of the noise; the model in force is a Markov chain. Before each prediction every filter
starts from a mixture of the estimates of all models from which its own may have come. After the fix the models are weighted
by how well they predicted it. The noise may therefore change at any time, while a plain bank soon settles on one model.

The models are all pairs of a factor of the told Q and a factor of the told R. If the fixes hardly tell models apart, these stay
about equally likely, and the bank works as one filter with their mean noise. A model of 10 Q beside a Q told right then costs
alignment a fifth of its azimuth accuracy. A model of Q / 100 costs nothing, and helps if the told Q is cautious. The default has
that one, and 10 R for fixes that are worse than told.

Source: Blom & Bar-Shalom (1988), doi:10.1109/9.1299; equations in 004 (1-12); docs/mathematics/filters.md#interacting-models.
Shapes: probabilities (..., M), means (..., M, n), covariances (..., M, n, n); M = len(q_factors) len(r_factors).
Departures: the rows of the chain sum to one over the destination, which 004 (3) leaves open. Equation (6) is restored, and (7)
is extended to a nonlinear h (docs/mathematics/errata.md no. 69). Likelihoods are logarithms. A missing fix leaves the chain's
own prediction of the model. A model that the chain cannot reach mixes with itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import items, keep, number, numbers, refused
from solvers.blocks.mixtures import collapse
from solvers.blocks.moments import Linearized, SigmaPoints
from solvers.blocks.sigma_rules import Unscented
from solvers.filters.mixtures.base import Mixture, MixtureFilter, initial_mixture
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Gaussian, Measurement, Transition

MOST_MODELS = 100


@dataclass(frozen=True)
class _IMM(MixtureFilter[Mixture]):
    """Base of the interacting models: their noise, their chain and the mixing; a subclass gives the rule.

    Raises:
        ValueError: a setting outside its range, or a ``transition`` that is not a matrix of probabilities.
    """

    q_factors: Sequence[float] = (0.01, 1.0)  #: factors of the told Q
    r_factors: Sequence[float] = (1.0, 10.0)  #: factors of the told R; models: (q1, r1), (q1, r2), ..., (q2, r1), ...
    stay: float = 0.95  #: probability that a model is still in force at the next epoch
    #: probabilities from the model of a row to that of a column, in the order of the models; None: from ``stay``
    transition: Sequence[Sequence[float]] | None = None

    def __post_init__(self) -> None:
        keep(self, "q_factors", numbers, None, "finite numbers > 0, at least one", above=0.0)
        keep(self, "r_factors", numbers, None, "finite numbers > 0, at least one", above=0.0)
        if len(self.models) > MOST_MODELS:
            raise refused(
                "q_factors", self.q_factors, f"at most {MOST_MODELS} models, pairs of q_factors and r_factors"
            )
        keep(self, "stay", number, above=0.0, most=1.0)
        if self.transition is not None:
            keep(self, "transition", _stochastic, len(self.models))

    @property
    def models(self) -> list[tuple[float, float]]:
        """Factor of Q and factor of R of each model."""
        return [(q, r) for q in self.q_factors for r in self.r_factors]

    @cached_property
    def _factors(self) -> Array:
        """Factors of Q and of R, shape (2, M, 1, 1)."""
        return np.array(self.models).T[..., None, None]

    @cached_property
    def chain(self) -> Array:
        """Probabilities (M, M) that model j (row) now is followed by model i (column) at the next epoch: 004 (3)."""
        if self.transition is not None:
            return np.array(self.transition)
        M = len(self.models)
        if M == 1:
            return np.ones((1, 1))
        leave = (1.0 - self.stay) / (M - 1)
        return np.full((M, M), leave) + (self.stay - leave) * np.eye(M)

    def init(self, prior: Gaussian, rng: Any = None) -> Mixture:
        """Make a mixture of the prior under every model, all equally likely. ``rng`` is not used."""
        return initial_mixture(prior, len(self.models))

    def predict(self, b: Mixture, tr: Transition) -> Mixture:
        """Mix the models, then predict each of them."""
        joint = b.weights[..., None] * self.chain  # (..., from, to)
        ahead = joint.sum(axis=-2)
        reached = ahead > 0.0
        mix = np.where(reached[..., None, :], joint, np.eye(len(self.models)))
        mix = (mix / np.where(reached, ahead, 1.0)[..., None, :]).mT  # (..., to, from) # 004 (4)
        x = collapse(mix, Gaussian(b.mean[..., None, :, :], b.cov[..., None, :, :, :]))  # 004 (5-6)
        return super().predict(b._replace(weights=ahead, mean=x.mean, cov=x.cov), tr)

    def process_noise(self, tr: Transition) -> Array:
        return self._factors[0] * super().process_noise(tr)

    def measurement_noise(self, me: Measurement) -> Array:
        return self._factors[1] * super().measurement_noise(me)

    def diagnostics(self, b: Mixture) -> dict[str, Array]:
        """Return the probabilities of the models, and the expected factors of the told Q and R."""
        q, r = self._factors[..., 0, 0]
        return {
            **super().diagnostics(b),
            "mode_probabilities": b.weights,
            "q_factor": b.weights @ q,
            "r_factor": b.weights @ r,
        }


@register("imm_ekf")
@dataclass(frozen=True)
class IMMEKF(_IMM):
    """Interacting multiple models of the noise, by extended Kalman filters."""

    @cached_property
    def rule(self) -> Linearized:
        return Linearized("mean")


@register("imm_ukf")
@dataclass(frozen=True)
class IMMUKF(_IMM):
    """Interacting multiple models of the noise, by unscented Kalman filters."""

    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n
    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.rule  # checks the settings

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(Unscented(self.alpha, self.beta, self.kappa), self.root)


def _stochastic(name: str, given: Any, M: int) -> tuple[tuple[float, ...], ...]:
    """Check a matrix (M, M) of probabilities, and return its rows."""
    allowed = f"None, or {M} rows of {M} probabilities that sum to one"
    rows = tuple(numbers(name, row, M, allowed, least=0.0) for row in items(given) or ())
    if len(rows) != M or any(abs(sum(row) - 1.0) > 1e-9 for row in rows):
        raise refused(name, given, allowed)
    return rows


_EQUAL = {"q_factors": [1.0, 1.0], "r_factors": [1.0, 1.0]}
SAME_AS = {
    "imm_ekf": (Relation("ekf", _EQUAL, within=1e-9),),
    "imm_ukf": (
        Relation("ukf", _EQUAL, within=1e-9),
        Relation("ukf", {"q_factors": [1.0], "r_factors": [1.0]}),
    ),
}
UNLIKE = {
    "imm_ukf": (
        Relation("imm_ekf"),
        Relation("ukf", {"q_factors": [1.0]}),
        Relation("ukf", {"r_factors": [1.0]}),
    ),
}
