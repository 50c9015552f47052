"""The mixture filter: what a bank of Gaussian filters shares. A component is a Gaussian with a weight.

Every component predicts and corrects as :class:`GaussianFilter` does, all of them at once. The weights follow from how well
each component predicted the measurement: 004 (9-10), and 000 (3.5.24) with no. 40 of docs/mathematics/errata.md corrected.
Equations: docs/mathematics/filters.md#mixtures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, TypeVar, cast

import numpy as np

from sins_env.arrays import Array, Mask
from solvers.blocks.conditioning import condition, log_likelihood
from solvers.blocks.mixtures import collapse, effective, normalise, spread, spread_measurement, widen
from solvers.blocks.moments import MomentRule, moments, transform
from solvers.blocks.square_root import any_of, either, symmetrize
from solvers.filters.base import BatchFilter, count, initial_gaussian, initial_health
from solvers.types import Function, Gaussian, Health, Innovation, Measurement, Transition


class Mixture(NamedTuple):
    """A Gaussian mixture with G components per run."""

    weights: Array  #: (..., G)
    mean: Array  #: (..., G, n)
    cov: Array  #: (..., G, n, n)
    health: Health


B = TypeVar("B", bound=Any)  #: a Mixture, or a NamedTuple with the fields of one and more


@dataclass(frozen=True)
class MixtureFilter(BatchFilter[B]):
    """Base of the filters whose belief is a Gaussian mixture; a subclass gives the ``rule`` of its components."""

    one_mean: ClassVar[bool] = False

    @cached_property
    def rule(self) -> MomentRule:
        """How each component passes through f and h."""
        raise NotImplementedError(f"{type(self).__name__} has no moment rule")

    def predict(self, b: B, tr: Transition) -> B:
        """Return every component one epoch later."""
        y, repaired = transform(spread(tr.f, axes(b)), Gaussian(b.mean, b.cov), self.rule)
        return count(b._replace(mean=y.mean, cov=y.cov + self.process_noise(tr)), any_of(repaired))

    def correct(self, b: B, me: Measurement) -> tuple[B, Innovation]:
        """Return every component after a measurement, and the innovation of the mixture."""
        me = spread_measurement(me, axes(b))._replace(R=self.measurement_noise(me))
        weights, x, innovation, repaired = bayes(b.weights, Gaussian(b.mean, b.cov), me, self.rule)
        return count(b._replace(weights=weights, mean=x.mean, cov=x.cov), repaired), innovation

    def process_noise(self, tr: Transition) -> Array:
        """Return Q of each component, (..., G, n, n) or what broadcasts to it."""
        return widen(tr.Q)

    def measurement_noise(self, me: Measurement) -> Array:
        """Return R of each component, (..., G, m, m) or what broadcasts to it."""
        return widen(me.R)

    def estimate(self, b: B) -> Gaussian:
        """Return mean (..., n) and covariance (..., n, n) of the mixture."""
        return collapse(b.weights, Gaussian(b.mean, b.cov))

    def move(self, b: B, g: Function, jac: Callable[[Array], Array]) -> B:
        J = jac(b.mean)
        if J.ndim < b.cov.ndim:  # one Jacobian for all components
            J = widen(J)
        return b._replace(mean=spread(g, axes(b))(b.mean), cov=symmetrize(J @ b.cov @ J.mT))

    def diagnostics(self, b: B) -> dict[str, Array]:
        return {"effective_components": effective(b.weights)}


def bayes(
    weights: Array, x: Gaussian, me: Measurement, rule: MomentRule
) -> tuple[Array, Gaussian, Innovation, Mask | None]:
    """Return weights and components after a measurement, the mixture's innovation, and the repaired runs or None.

    ``me`` comes from ``spread_measurement``. The new weights are the old ones times the predictive densities of the fix.
    """
    y, repaired = moments(me.h, x, rule)
    after, innovation, repaired_S = condition(x, y._replace(cov=y.cov + me.R), me.z)
    seen = collapse(weights, Gaussian(*innovation))
    log_prior = np.log(weights, out=np.full(weights.shape, -np.inf), where=weights > 0.0)
    posterior, _ = normalise(log_prior + log_likelihood(innovation))
    repaired = any_of(either(repaired, repaired_S))  # a run with both repairs counts once, for it is the same P
    return np.where(weights > 0.0, posterior, 0.0), after, Innovation(*seen), repaired


def axes(b: Any) -> int:
    """Return the number of batch axes."""
    return cast(int, b.weights.ndim - 1)


def initial_mixture(prior: Gaussian, components: int = 1) -> Mixture:
    """Make a mixture of equal copies of the prior; a run whose prior is not finite has failed at epoch 0."""
    x = initial_gaussian(prior)
    batch = x.mean.shape[:-1]
    return Mixture(
        np.full((*batch, components), 1.0 / components),
        np.repeat(x.mean[..., None, :], components, axis=-2),
        np.repeat(x.cov[..., None, :, :], components, axis=-3),
        initial_health(x.mean, x.cov, batch=batch),
    )
