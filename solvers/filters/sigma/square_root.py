"""The square-root filter: a root S of the covariance P = S S' is carried from step to step by QR; P is never formed.

P is therefore always positive semi-definite. A component of a fix that follows from the others, by a singular S, is left out
and counted as a repair, as an indefinite P0, Q or R is.
The condition number that matters for rounding is the square root of that of P. Equations 000 (3.3.33-46);
docs/mathematics/filters.md#square-roots.
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
from solvers.blocks.square_root import either, semidefinite_root, tria, without_known
from solvers.filters.base import BatchFilter, count, initial_gaussian, initial_health
from solvers.types import Function, Gaussian, Health, Innovation, Measurement, Transition


class RootBelief(NamedTuple):
    """One Gaussian by its mean and a root of its covariance."""

    mean: Array  #: (..., n)
    root: Array  #: (..., n, n), S with covariance S S'
    health: Health


@dataclass(frozen=True)
class SquareRootFilter(BatchFilter[RootBelief]):
    """Base of the filters that carry a root; a subclass gives the ``factor_rule``."""

    @cached_property
    def factor_rule(self) -> FactorRule:
        """How a Gaussian with a root passes through f and h."""
        raise NotImplementedError(f"{type(self).__name__} has no factor rule")

    def init(self, prior: Gaussian, rng: Any = None) -> RootBelief:
        """Make the belief at the start from a prior that may be singular. ``rng`` is not used."""
        x = initial_gaussian(prior)
        root, repaired = semidefinite_root(x.cov)
        return count(RootBelief(x.mean, root, initial_health(x.mean, root, batch=x.mean.shape[:-1])), repaired)

    def predict(self, b: RootBelief, tr: Transition) -> RootBelief:
        """Predict mean and root, with S- = tria[T S_w U]."""
        y = factors(tr.f, b.mean, b.root, self.factor_rule)
        S_w, repaired = semidefinite_root(tr.Q)
        return count(b._replace(mean=y.mean, root=tria(beside(y.slope, S_w, y.rest))), repaired)

    def correct(self, b: RootBelief, me: Measurement) -> tuple[RootBelief, Innovation]:
        """Correct mean and root, with S_y = tria[T S_v U] and S = tria[S- - K T, K S_v, K U]: 000 (3.3.39-46)."""
        y = factors(me.h, b.mean, b.root, self.factor_rule)
        S_v, repaired = semidefinite_root(me.R)
        S_y = tria(beside(y.slope, S_v, y.rest))
        regular, dropped = without_known(S_y)
        K, _ = root_gain(regular, b.root @ y.slope.mT)
        residual = me.z - y.mean
        mean = b.mean + (K @ residual[..., None])[..., 0]
        root = tria(beside(b.root - K @ y.slope, K @ S_v, None if y.rest is None else K @ y.rest))
        return count(b._replace(mean=mean, root=root), either(repaired, dropped)), Innovation(residual, S_y @ S_y.mT)

    def estimate(self, b: RootBelief) -> Gaussian:
        return Gaussian(b.mean, b.root @ b.root.mT)

    def move(self, b: RootBelief, g: Function, jac: Callable[[Array], Array]) -> RootBelief:
        return b._replace(mean=g(b.mean), root=tria(jac(b.mean) @ b.root))


@dataclass(frozen=True)
class PairedFilter(SquareRootFilter):
    """The square-root form of a sigma-point filter.

    Raises:
        ValueError: in ``init``, a rule that has no square-root form.
    """

    points: PointRule

    @cached_property
    def factor_rule(self) -> PairedPoints:
        return PairedPoints(self.points)

    def init(self, prior: Gaussian, rng: Any = None) -> RootBelief:
        b = super().init(prior)
        pairs(self.points, b.mean.shape[-1])  # refuses a rule without a square-root form
        return b
