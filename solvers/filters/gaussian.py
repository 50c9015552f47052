"""The Gaussian filter: predict and correct, written once, equations 000 (3.2.2-14).

A filter of this kind differs from another by its moment rule, which says how a Gaussian passes through f and h.
Equations: docs/mathematics/filters.md#gaussian-update.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, TypeVar, cast

import numpy as np

from sins_env.arrays import Array
from solvers.blocks.conditioning import condition
from solvers.blocks.moments import MomentRule, linear_moments, moments, transform
from solvers.filters.base import BatchFilter, count, initial_gaussian, initial_health
from solvers.filters.inputs import wrapped
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Transition


class Belief(NamedTuple):
    """One Gaussian, and how its runs fare."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health


B = TypeVar("B", bound=Any)  #: a Belief, or a NamedTuple with the fields of one and more


@dataclass(frozen=True)
class GaussianFilter(BatchFilter[B]):
    """Base of the filters whose belief is one Gaussian; a subclass gives the ``rule``.

    A subclass whose belief holds more makes it in ``init``. The other methods replace mean and covariance alone.
    """

    predicts_by_rule: ClassVar[bool] = True  #: whether its prediction is that of ``rule``, which smoothing needs

    @cached_property
    def rule(self) -> MomentRule:
        """How a Gaussian passes through f and h."""
        raise NotImplementedError(f"{type(self).__name__} has no moment rule")

    def init(self, prior: Gaussian, rng: Any = None) -> B:
        """Make the belief at the start; a run whose prior is not finite has failed at epoch 0. ``rng`` is not used."""
        return cast(B, initial_belief(prior))

    def process_noise(self, b: B, tr: Transition) -> Gaussian:
        """Return the assumed noise w of the next epoch: mean (..., n), covariance (..., n, n); here as told."""
        return Gaussian(np.zeros_like(b.mean), np.broadcast_to(tr.Q, b.cov.shape))

    def predict(self, b: B, tr: Transition) -> B:
        """Return the belief one epoch later."""
        y, repaired = transform(tr.f, Gaussian(b.mean, b.cov), self.rule)
        return count(b._replace(mean=y.mean, cov=y.cov + tr.Q), repaired)

    def correct(self, b: B, me: Measurement) -> tuple[B, Innovation]:
        """Return the belief after a measurement and the innovation; points are drawn anew about the prediction."""
        prior = Gaussian(b.mean, b.cov)
        y, repaired = moments(me.h, prior, self.rule)
        z = me.z if me.turns is None else y.mean + wrapped(me.z - y.mean, me.turns)
        x, innovation, repaired_S = condition(prior, y._replace(cov=y.cov + me.R), z)
        return count(count(b._replace(mean=x.mean, cov=x.cov), repaired), repaired_S), innovation

    def estimate(self, b: B) -> Gaussian:
        """Return the belief without its health."""
        return Gaussian(b.mean, b.cov)

    def move(self, b: B, g: Function, jac: Callable[[Array], Array]) -> B:
        moved = linear_moments(Linear(jac(b.mean)), Gaussian(b.mean, b.cov))
        return b._replace(mean=g(b.mean), cov=moved.cov)


def initial_belief(prior: Gaussian) -> Belief:
    """Make a belief of a prior with mean (..., n) and covariance (..., n, n), or (n, n) shared by all runs."""
    x = initial_gaussian(prior)
    return Belief(x.mean, x.cov, initial_health(x.mean, x.cov, batch=x.mean.shape[:-1]))
