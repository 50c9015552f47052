"""The square-root filter: a root S of the covariance, P = S S', is carried from step to step by QR, P never formed.

P is then positive semi-definite whatever happens, no step needs a repair (an indefinite P0, Q or R would, and is
counted), and the condition number that rounding sees is the root of P's. # 000 (3.3.33-46)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from sins_env.arrays import Array
from solvers.blocks.conditioning import root_gain
from solvers.blocks.factors import FactorRule, PairedPoints, beside, factors, pairs
from solvers.blocks.sigma_rules import PointRule
from solvers.blocks.square_root import semidefinite_root, tria
from solvers.filters.base import BatchFilter, count, initial_gaussian, initial_health
from solvers.types import Function, Gaussian, Health, Innovation, Measurement, Transition


class RootBelief(NamedTuple):
    mean: Array  #: (..., n)
    root: Array  #: (..., n, n), the covariance is root root'
    health: Health


@dataclass(frozen=True)
class SquareRootFilter(BatchFilter[RootBelief]):
    """Base of the filters that carry a root; a subclass gives the ``factor_rule``."""

    @cached_property
    def factor_rule(self) -> FactorRule:
        raise NotImplementedError(f"{type(self).__name__} has no factor rule")

    def init(self, prior: Gaussian, rng: Any = None) -> RootBelief:
        """The belief at the start, of a prior that may be singular. ``rng`` is not used."""
        x = initial_gaussian(prior)
        root, repaired = semidefinite_root(x.cov)
        return count(RootBelief(x.mean, root, initial_health(x.mean, root, batch=x.mean.shape[:-1])), repaired)

    def predict(self, b: RootBelief, tr: Transition) -> RootBelief:
        """S- = tria[S1 S_w S2]."""
        y = factors(tr.f, b.mean, b.root, self.factor_rule)
        S_w, repaired = semidefinite_root(tr.Q)
        return count(b._replace(mean=y.mean, root=tria(beside(y.slope, S_w, y.rest))), repaired)

    def correct(self, b: RootBelief, me: Measurement) -> tuple[RootBelief, Innovation]:
        """S_y = tria[T S_v U], S = tria[S- - K T, K S_v, K U]. # 000 (3.3.39-46)"""
        y = factors(me.h, b.mean, b.root, self.factor_rule)
        S_v, repaired = semidefinite_root(me.R)
        S_y = tria(beside(y.slope, S_v, y.rest))
        K, _ = root_gain(S_y, b.root @ y.slope.mT)
        residual = me.z - y.mean
        mean = b.mean + (K @ residual[..., None])[..., 0]
        root = tria(beside(b.root - K @ y.slope, K @ S_v, None if y.rest is None else K @ y.rest))
        return count(b._replace(mean=mean, root=root), repaired), Innovation(residual, S_y @ S_y.mT)

    def estimate(self, b: RootBelief) -> Gaussian:
        return Gaussian(b.mean, b.root @ b.root.mT)

    def move(self, b: RootBelief, g: Function, jac: Callable[[Array], Array]) -> RootBelief:
        return b._replace(mean=g(b.mean), root=tria(jac(b.mean) @ b.root))


@dataclass(frozen=True)
class PairedFilter(SquareRootFilter):
    """The square-root form of a sigma-point filter."""

    points: PointRule

    @cached_property
    def factor_rule(self) -> PairedPoints:
        return PairedPoints(self.points)

    def init(self, prior: Gaussian, rng: Any = None) -> RootBelief:
        b = super().init(prior)
        pairs(self.points, b.mean.shape[-1])  # refuses a rule without a square-root form
        return b
