"""Base of the robust cubature filters: the reweighted update, and the guard that keeps it from locking out the fixes.

A filter that rejects what it does not expect cannot tell a series of bad fixes from an estimate that is wrong. The guard tells
them apart by patience. If the innovation has been beyond the ``gate`` at successive fixes for ``patience_s``, the estimate and
its covariance are taken to be wrong. The covariance is then widened until it explains the innovation, and the ordinary
update is taken. This goes on until a fix falls within the gate. A series of bad fixes that is longer than the patience is
believed, which is why the patience is a setting. Each fix taken this way counts as a fallback. So does a fix that is skipped
because none of its components has any weight left. See docs/mathematics/filters.md#robust-updates.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.checks import keep, number, whole
from solvers.blocks.conditioning import condition, gate_limit, nis, posterior_cov
from solvers.blocks.moments import MomentRule, SigmaPoints, moments
from solvers.blocks.sigma_rules import Cubature
from solvers.blocks.square_root import either
from solvers.filters.base import choose, count
from solvers.filters.gaussian import GaussianFilter, initial_belief
from solvers.filters.robust.reweighting import FLOOR, Weigh, reweight, widened
from solvers.types import Gaussian, Health, Innovation, Measurement, Moments, Transition


class RobustBelief(NamedTuple):
    """One Gaussian, and how the last fixes fitted."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    outside: NDArray[np.int64]  #: (...), number of successive fixes with an innovation beyond the gate
    outside_s: Array  #: (...), s, time since the first of them
    weight: Array  #: (...), mean weight of the components of the last fix


@dataclass(frozen=True)
class RobustFilter(GaussianFilter[RobustBelief]):
    """A Gaussian filter with cubature points whose update is reweighted by ``weigh``.

    Raises:
        ValueError: a setting outside its range.
    """

    rounds: int = 20  #: largest number of rounds of the reweighting
    gate: float = 0.999  #: probability that a good innovation lies within the gate; 1: no gate
    patience_s: float = 10.0  #: s, time of successive fixes beyond the gate after which they are believed
    patience: int | None = (
        None  #: number of successive fixes after which they are believed; None: ``patience_s`` decides
    )
    dt_s: float = 0.1  #: s per epoch, if the transition does not tell it
    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance

    def __post_init__(self) -> None:
        keep(self, "rounds", whole, least=1, most=1000)
        keep(self, "gate", number, least=0.5, most=1.0)
        keep(self, "patience_s", number, least=0.0, infinite=True)
        if self.patience is not None:
            keep(self, "patience", whole, "None, or a whole number >= 1", least=1)
        keep(self, "dt_s", number, above=0.0)
        _ = self.rule, self.weigh  # check the settings

    @cached_property
    def rule(self) -> MomentRule:
        return SigmaPoints(Cubature(), self.root)

    @cached_property
    def weigh(self) -> Weigh:
        """The weights of the residuals; see :class:`solvers.filters.robust.reweighting.Residuals`."""
        raise NotImplementedError(f"{type(self).__name__} has no weights")

    def init(self, prior: Gaussian, rng: Any = None) -> RobustBelief:
        mean, cov, health = initial_belief(prior)
        batch = mean.shape[:-1]
        return RobustBelief(mean, cov, health, np.zeros(batch, dtype=np.int64), np.zeros(batch), np.ones(batch))

    def predict(self, b: RobustBelief, tr: Transition) -> RobustBelief:
        """Return the belief one epoch later."""
        dt = self.dt_s if tr.dt is None else tr.dt
        return super().predict(b._replace(outside_s=b.outside_s + dt * (b.outside > 0)), tr)

    def correct(self, b: RobustBelief, me: Measurement) -> tuple[RobustBelief, Innovation]:
        prior = Gaussian(b.mean, b.cov)
        y0, repaired = moments(me.h, prior, self.rule)
        y = y0._replace(cov=y0.cov + me.R)
        x, innovation, repaired_S = condition(prior, y, me.z)
        outside = np.where(nis(innovation) > gate_limit(self.gate, me.z.shape[-1]), b.outside + 1, 0)
        if self.patience is None:
            ordinary = (outside > 1) & (b.outside_s >= self.patience_s * (1.0 - 1e-9))
        else:
            ordinary = outside > self.patience
        if ordinary.any():
            wide, y_wide = widened(prior, y0, me.R, innovation.residual)
            x, _, _ = condition(wide, y_wide, me.z)
        fit = reweight(prior, y, me.z, self.weigh, self.rounds, told=me.R)
        skipped = np.asarray((fit.weights <= FLOOR).all(axis=-1))
        mean = b.mean + (fit.gain @ innovation.residual[..., None])[..., 0]
        cov = posterior_cov(prior, self.believed(y, fit.R, fit.weights), fit.gain)
        x = choose(ordinary, x, choose(skipped, prior, Gaussian(mean, cov)))
        b = b._replace(
            mean=x.mean,
            cov=x.cov,
            outside=outside,
            outside_s=b.outside_s * (outside > 0),
            weight=fit.weights.mean(axis=-1),
        )
        return count(b, either(either(repaired, repaired_S), fit.repaired), ordinary | skipped), innovation

    def believed(self, y: Moments, R: Array, weights: Array) -> Moments:
        """Return the moments of z with the noise that the reported covariance assumes; here the told one."""
        return y

    def diagnostics(self, b: RobustBelief) -> dict[str, Array]:
        return {"weight": b.weight, "outside": b.outside.astype(float)}


def settings_of(flt: RobustFilter) -> dict[str, Any]:
    """Return the settings of a filter by name, to make another with the same settings and another rule."""
    return {f.name: getattr(flt, f.name) for f in fields(flt)}
