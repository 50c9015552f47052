"""The Gaussian filter: predict, correct and the care for failing runs, written once.

A filter of this kind is its moment rule: how a Gaussian passes through f and h. # 000 (3.2.2-14)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from solvers.blocks.conditioning import condition
from solvers.blocks.moments import MomentRule, moments, transform
from solvers.blocks.square_root import Mask, symmetrize
from solvers.types import Array, Function, Gaussian, Health, Innovation, Measurement, Transition


class Belief(NamedTuple):
    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health


@dataclass(frozen=True)
class GaussianFilter:
    """Base of the filters whose belief is one Gaussian; a subclass gives the ``rule``."""

    batched: ClassVar[bool] = True  #: whether the filter takes any batch shape, or () alone

    @cached_property
    def rule(self) -> MomentRule:
        raise NotImplementedError(f"{type(self).__name__} has no moment rule")

    def init(self, prior: Gaussian, rng: Any = None) -> Belief:
        """The belief at the start; a run whose prior is not finite failed at epoch 0. ``rng`` is not used."""
        return initial_belief(prior)

    def step(self, b: Belief, tr: Transition, me: Measurement | None) -> tuple[Belief, Innovation | None]:
        """Predict, then correct from points redrawn about the prediction.

        A run that turns non-finite is frozen at its last good belief and marked in ``health``; from then on
        its innovation is NaN. The other runs go on as if it were not there.
        """
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # such runs are marked instead
            x, repaired = self.predict(b, tr)
            if me is None:
                return settle(b, x, (repaired,)), None
            x, innovation, *more = self.correct(x, me)
            after = settle(b, x, (repaired, *more))
        if after.health.frozen:
            innovation = _blank(innovation, after.health.failed_at >= 0)
        return after, innovation

    def predict(self, x: Gaussian | Belief, tr: Transition) -> tuple[Gaussian, Mask | None]:
        """The belief one epoch later, and which runs were repaired."""
        y, repaired = transform(tr.f, Gaussian(x.mean, x.cov), self.rule)
        return Gaussian(y.mean, y.cov + tr.Q), repaired

    def correct(self, x: Gaussian, me: Measurement) -> tuple[Gaussian, Innovation, Mask | None, Mask | None]:
        """The belief after a measurement, the innovation, and which runs were repaired in P and in S."""
        y, repaired = moments(me.h, x, self.rule)
        return *condition(x, y._replace(cov=y.cov + me.R), me.z), repaired

    def estimate(self, b: Belief) -> Gaussian:
        """The belief without its health."""
        return Gaussian(b.mean, b.cov)

    def relocate(self, b: Belief, g: Function, jac: Callable[[Array], Array]) -> Belief:
        """Feedback: the mean x becomes g(x), the covariance J(x) P J(x)'.

        Frozen runs are moved too: what they believe stays the same, only its origin changes.
        """
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            J = jac(b.mean)
            x = Gaussian(g(b.mean), symmetrize(J @ b.cov @ J.mT))
            if _finite(x):
                return Belief(x.mean, x.cov, b.health)
            return _keep(b, x, _finite_runs(x), b.health)


def initial_belief(prior: Gaussian) -> Belief:
    """``prior`` as a belief: mean (..., n), covariance (..., n, n) or (n, n) shared by all runs."""
    mean = np.array(prior.mean, dtype=float)
    n = mean.shape[-1] if mean.ndim else 0
    given = np.shape(prior.cov)
    if n == 0 or given not in ((*mean.shape, n), (n, n)):
        needed = (*mean.shape, n)
        raise ValueError(f"prior mean of shape {mean.shape}: the covariance must be {needed}, given {given}")
    cov = np.array(np.broadcast_to(prior.cov, (*mean.shape, n)), dtype=float)
    well = _finite_runs(Gaussian(mean, cov))
    failed_at = np.where(well, -1, 0)
    return Belief(mean, cov, Health(0, np.zeros(well.shape, dtype=np.int64), failed_at, not well.all()))


def settle(b: Belief, x: Gaussian, repairs: tuple[Mask | None, ...]) -> Belief:
    """The belief that follows ``b``: ``x`` where it is sound, ``b`` where it is not or was frozen before."""
    epoch, repaired, failed_at, frozen = b.health
    epoch += 1
    if not frozen and _finite(x) and not any(r is not None for r in repairs):
        return Belief(x.mean, x.cov, Health(epoch, repaired, failed_at, False))
    well = (failed_at < 0) & _finite_runs(x)
    for mask in repairs:
        if mask is not None:
            repaired = repaired + (mask & well)
    return _keep(b, x, well, Health(epoch, repaired, failed_at, frozen))


def _keep(b: Belief, x: Gaussian, well: Mask, health: Health) -> Belief:
    """``x`` in the runs that are well, ``b`` in the others, which fail now unless they failed before."""
    failed_at = np.where(well | (health.failed_at >= 0), health.failed_at, health.epoch)
    mean = np.where(well[..., None], x.mean, b.mean)
    cov = np.where(well[..., None, None], x.cov, b.cov)
    return Belief(mean, cov, Health(health.epoch, health.repairs, failed_at, bool((failed_at >= 0).any())))


def _finite(x: Gaussian) -> bool:
    """Whether all runs are finite, by one number each; False on overflow too, which the mask then settles."""
    return math.isfinite(np.add.reduce(x.mean, axis=None) + np.add.reduce(x.cov, axis=None))


def _finite_runs(x: Gaussian) -> Mask:
    return np.asarray(np.isfinite(x.mean).all(axis=-1) & np.isfinite(x.cov).all(axis=(-2, -1)))


def _blank(innovation: Innovation, frozen: Mask) -> Innovation:
    residual = np.where(frozen[..., None], np.nan, innovation.residual)
    return Innovation(residual, np.where(frozen[..., None, None], np.nan, innovation.cov))
