"""Gaussian-mixture extended Kalman filter: each fix is either good or contaminated, and the update weighs both.

Idea: v is N(0, R) or, in a ``share`` of the fixes, N(0, factor R), for the whole vector at once. Update under either
hypothesis, weigh the two by how well they predicted the fix, and merge them into one Gaussian. With the share of the task this
is nearly the exact filter; for a linear problem the merger is the only approximation.

The share is told by the task, given, or learnt. To learn it, the posterior probability w that a fix was contaminated moves the
share by (w - share) / count. The count grows up to ``memory`` fixes. This is the quasi-Bayes rule.

Source: Sorenson & Alspach (1971), doi:10.1016/0005-1098(71)90097-5; Masreliez & Martin (1977),
doi:10.1109/TAC.1977.1101538 (contaminated noise); Smith & Makov (1978), doi:10.1111/j.2517-6161.1978.tb01651.x;
docs/mathematics/filters.md#mixture-of-fix-noises.
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: the mixture is merged after every fix. A told Student-t noise is not a mixture of two and is taken as Gaussian.
The reported covariance of the innovation is that of both hypotheses together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import items, keep, number, refused, whole
from solvers.blocks.conditioning import condition, log_likelihood
from solvers.blocks.mixtures import collapse, normalise
from solvers.blocks.moments import Linearized, moments
from solvers.blocks.square_root import either
from solvers.filters.base import count
from solvers.filters.gaussian import GaussianFilter, initial_belief
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Gaussian, Health, Innovation, Measurement, NoiseLaw

FIRST_SHARE, FIRST_COUNT = 0.1, 20.0  #: share from which learning starts, and the number of fixes that it counts for


class MixtureBelief(NamedTuple):
    """One Gaussian, and what is known of the contamination."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    share: Array  #: (...), share of contaminated fixes
    fixes: Array  #: (...), number of fixes on which the share rests
    suspicion: Array  #: (...), posterior probability that the last fix was contaminated


@register("gm_ekf")
@dataclass(frozen=True)
class GMEKF(GaussianFilter[MixtureBelief]):
    """The extended Kalman filter with a two-component measurement noise; with one component it is the EKF."""

    contamination: str | Sequence[float] = "told"  #: "told" by the task, "learn", or (share, factor)
    factor: float = 10.0  #: variance of a contaminated fix over that of a good one, if the share is learnt
    memory: int = 1000  #: largest number of fixes on which a learnt share rests

    def __post_init__(self) -> None:
        keep(self, "contamination", _contamination)
        keep(self, "factor", number, least=1.0)
        keep(self, "memory", whole, least=1)

    @cached_property
    def rule(self) -> Linearized:
        return Linearized("mean")

    def init(self, prior: Gaussian, rng: Any = None) -> MixtureBelief:
        mean, cov, health = initial_belief(prior)
        batch = mean.shape[:-1]
        share = FIRST_SHARE if self.contamination == "learn" else self._told(None)[0]
        return MixtureBelief(mean, cov, health, np.full(batch, share), np.full(batch, FIRST_COUNT), np.zeros(batch))

    def correct(self, b: MixtureBelief, me: Measurement) -> tuple[MixtureBelief, Innovation]:
        learn = self.contamination == "learn"
        told, factor = (0.0, self.factor) if learn else self._told(me.law)
        share = b.share if learn else np.full(b.share.shape, told)
        if not share.any():
            b, innovation = super().correct(b, me)
            return b._replace(share=share, suspicion=np.zeros(share.shape)), innovation
        prior = Gaussian(b.mean, b.cov)
        y, repaired = moments(me.h, prior, self.rule)
        good, innovation, repaired_good = condition(prior, y._replace(cov=y.cov + me.R), me.z)
        bad, surprise, repaired_bad = condition(prior, y._replace(cov=y.cov + factor * me.R), me.z)
        logs = np.log1p(-share) + log_likelihood(innovation), np.log(share) + log_likelihood(surprise)
        weights, _ = normalise(np.stack(logs, axis=-1))
        x = collapse(weights, Gaussian(np.stack([good.mean, bad.mean], -2), np.stack([good.cov, bad.cov], -3)))
        repaired = either(repaired, either(repaired_good, repaired_bad))
        suspicion = weights[..., 1]
        b = count(b._replace(mean=x.mean, cov=x.cov, share=share, suspicion=suspicion), repaired)
        spread = y.cov + (1.0 + share * (factor - 1.0))[..., None, None] * me.R
        return self._learnt(b) if learn else b, innovation._replace(cov=spread)

    def _told(self, law: NoiseLaw | None) -> tuple[float, float]:
        """Return share and factor: those of the setting, or those of the law that the task tells."""
        if not isinstance(self.contamination, str):
            share, factor = self.contamination
            return share, factor
        return (0.0, 1.0) if law is None else (law.share, law.factor)

    def _learnt(self, b: MixtureBelief) -> MixtureBelief:
        """Update the share after a fix."""
        total = np.minimum(b.fixes + 1.0, self.memory)
        return b._replace(fixes=total, share=b.share + (b.suspicion - b.share) / total)

    def diagnostics(self, b: MixtureBelief) -> dict[str, Array]:
        return {"share": b.share, "suspicion": b.suspicion}


def _contamination(name: str, given: Any) -> str | tuple[float, float]:
    pair = items(given)
    if pair is not None and len(pair) == 2:
        share = number(f"{name}: share", pair[0], least=0.0, most=1.0)
        return share, number(f"{name}: factor", pair[1], least=1.0)
    if not isinstance(given, str) or given not in ("told", "learn"):
        raise refused(name, given, "'told', 'learn', or a pair (share, factor)")
    return given


SAME_AS = {
    "gm_ekf": (
        Relation("ekf"),
        Relation("ekf", {"contamination": [0.0, 10.0]}),
        Relation("ekf", {"contamination": [0.3, 1.0]}, within=1e-10),
    ),
}
UNLIKE = {
    "gm_ekf": (Relation("ekf", {"contamination": "learn"}),),
}
