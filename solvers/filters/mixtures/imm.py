"""Interacting multiple models: filters of different noise levels that trade places.

Idea: a bank of filters, one per model of the noise; the model in force is a Markov chain. Before each prediction
every filter starts from the mixture of all that its model may have come from; after it the models are weighted by how
well they predicted. So the noise may change at any time, where a plain bank would have made up its mind.
The models are all pairs of a factor of the told Q and a factor of the told R. Models that the fixes hardly tell apart
stay about equally likely, and the bank then works as one filter of their mean noise: a model of 10 Q beside the told
one costs alignment a fifth of its azimuth where Q was told right, one of Q / 100 costs nothing, and is what helps
where a cautious Q was told. That is the default, with 10 R for fixes that are worse than told.

Source: Blom & Bar-Shalom (1988), doi:10.1109/9.1299; equations in 004 (1-12), docs/mathematics/filters.md#interacting-models.
Shapes: probabilities (..., M), means (..., M, n), covariances (..., M, n, n); M = len(q_factors) len(r_factors).
Departures: 004 (3) needs rows over the destination that sum to one, (6) is garbled there, (7) holds for linear h only
(erratum 69); likelihoods as logarithms; a missing fix leaves the chain's own prediction of the model. A model that the
chain cannot reach mixes with itself.
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
from solvers.filters.registry import register
from solvers.types import Gaussian, Measurement, Transition


@dataclass(frozen=True)
class _IMM(MixtureFilter[Mixture]):
    """Base: the models, their chain and the mixing; a subclass gives the rule."""

    q_factors: Sequence[float] = (0.01, 1.0)  #: of the told Q
    r_factors: Sequence[float] = (1.0, 10.0)  #: of the told R; the models: (q1, r1), (q1, r2), ..., (q2, r1), ...
    stay: float = 0.95  #: probability that a model is still in force at the next epoch
    transition: Sequence[Sequence[float]] | None = (
        None  #: from row to column, in the order of models; None: by ``stay``
    )

    def __post_init__(self) -> None:
        keep(self, "q_factors", numbers, None, "finite numbers > 0, at least one", above=0.0)
        keep(self, "r_factors", numbers, None, "finite numbers > 0, at least one", above=0.0)
        keep(self, "stay", number, above=0.0, most=1.0)
        if self.transition is not None:
            keep(self, "transition", _stochastic, len(self.models))

    @property
    def models(self) -> list[tuple[float, float]]:
        """(factor of Q, factor of R) of each."""
        return [(q, r) for q in self.q_factors for r in self.r_factors]

    @cached_property
    def _factors(self) -> Array:
        """(2, M, 1, 1): of Q and of R."""
        return np.array(self.models).T[..., None, None]

    @cached_property
    def chain(self) -> Array:
        """P(i at the next epoch | j now), (M, M) from row j to column i. # 004 (3)"""
        if self.transition is not None:
            return np.array(self.transition)
        M = len(self.models)
        if M == 1:
            return np.ones((1, 1))
        leave = (1.0 - self.stay) / (M - 1)
        return np.full((M, M), leave) + (self.stay - leave) * np.eye(M)

    def init(self, prior: Gaussian, rng: Any = None) -> Mixture:
        """The prior under every model, all equally likely. ``rng`` is not used."""
        return initial_mixture(prior, len(self.models))

    def predict(self, b: Mixture, tr: Transition) -> Mixture:
        """Mix, then every model one epoch later."""
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
        """The models' probabilities, and the noise that they expect in units of what was told."""
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
    """The rows of a matrix (M, M) of probabilities."""
    allowed = f"None, or {M} rows of {M} probabilities that sum to one"
    rows = tuple(numbers(name, row, M, allowed, least=0.0) for row in items(given) or ())
    if len(rows) != M or any(abs(sum(row) - 1.0) > 1e-9 for row in rows):
        raise refused(name, given, allowed)
    return rows
