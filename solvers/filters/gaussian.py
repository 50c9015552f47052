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
from solvers.blocks.conditioning import advance_affine, condition, condition_affine
from solvers.blocks.moments import MomentRule, affine, has_tangent, linear_moments, moments, transform
from solvers.filters.base import BatchFilter, count, initial_gaussian, initial_health
from solvers.filters.inputs import wrapped
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Transition


class Belief(NamedTuple):
    """One Gaussian, and how its runs fare."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health


B = TypeVar("B", bound=Any)  #: a Belief, or a NamedTuple that begins with mean and covariance and has more fields


def with_moments(b: B, mean: Array, cov: Array) -> B:
    """Return the belief with another mean and covariance, its first two fields; ``_replace`` takes three times as long."""
    return cast(B, b._make((mean, cov, *b[2:])))


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

    @cached_property
    def _plain(self) -> bool:
        """Whether belief, prediction and correction are those of this class, so that one kernel may do both steps."""
        own = type(self)
        return all(
            getattr(own, name) is getattr(GaussianFilter, name) for name in ("init", "predict", "correct", "corrected")
        )

    def advance(self, b: B, tr: Transition, me: Measurement | None) -> tuple[B, Innovation | None]:
        if me is not None and me.present is me.turns is None and self._plain and has_tangent(me.h):
            mean, cov, (epoch, repairs, failed_at, fallbacks, frozen) = b
            f, h, rule = None if frozen else affine(tr.f, mean, cov, self.rule), me.h, self.rule
            if f is not None:
                x = Gaussian(mean, cov)
                found = advance_affine(x, f, tr.Q, lambda ahead: affine(h, ahead, None, rule), me.R, me.z)
                if found is not None:
                    mean, cov, residual, S = found
                    after = Belief(mean, cov, Health(epoch + 1, repairs, failed_at, fallbacks))
                    return cast(B, after), Innovation(residual, S)
        return super().advance(b, tr, me)

    def predict(self, b: B, tr: Transition) -> B:
        """Return the belief one epoch later."""
        y, repaired = transform(tr.f, Gaussian(b.mean, b.cov), self.rule, tr.Q)
        return count(with_moments(b, *y), repaired)

    def correct(self, b: B, me: Measurement) -> tuple[B, Innovation]:
        """Return the belief after a measurement and the innovation; points are drawn anew about the prediction."""
        prior = Gaussian(b.mean, b.cov)
        h = None if me.turns is not None else affine(me.h, *prior, self.rule)
        if h is not None:
            x, innovation, repaired = condition_affine(prior, h, me.R, me.z)
            return count(with_moments(b, *x), repaired), innovation
        y, repaired = moments(me.h, prior, self.rule)
        z = me.z if me.turns is None else y.mean + wrapped(me.z - y.mean, me.turns)
        x, innovation, repaired_S = condition(prior, y._replace(cov=y.cov + me.R), z)
        return count(count(with_moments(b, *x), repaired), repaired_S), innovation

    def estimate(self, b: B) -> Gaussian:
        """Return the belief without its health."""
        return Gaussian(b.mean, b.cov)

    def move(self, b: B, g: Function, jac: Callable[[Array], Array]) -> B:
        y = linear_moments(Linear(jac(b.mean)), Gaussian(b.mean, b.cov), mean=g(b.mean))
        return with_moments(b, y.mean, y.cov)


def initial_belief(prior: Gaussian) -> Belief:
    """Make a belief of a prior with mean (..., n) and covariance (..., n, n), or (n, n) shared by all runs."""
    x = initial_gaussian(prior)
    return Belief(x.mean, x.cov, initial_health(x.mean, x.cov, batch=x.mean.shape[:-1]))
