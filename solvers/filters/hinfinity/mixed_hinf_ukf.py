"""Mixed UKF / H-infinity UKF: one state, corrected by a mixture of two gains.

Idea: K = d K_ukf + (1 - d) K_hinf. Each gain comes from its own covariance, and the two are carried side by side about one mean.

The share d is a heuristic. 000 derives d = tr P_hinf / tr(P_ukf + P_hinf), (4.4.2), as the mixture of least variance of two
estimates with uncorrelated errors. But both use the same fixes. Under the model their cross covariance equals P_ukf, and the
formula before that assumption, (4.4.11), gives d = 1, which is the UKF (docs/mathematics/errata.md no. 51). A smaller d trades
variance for the H-infinity bound, and no theorem says how well. With (4.4.2) d lies between 1/2 and 1.

Source: 000 (4.4.1-11); docs/mathematics/filters.md#mixed-filter.
Shapes: x (..., n), covariances (..., n, n), d (...).
Departures:

- The traces are those of L P L', which have no unit.
- The reported covariance is a third one: that of the error which the mixed gain leaves under the model. The source's
  starts from the UKF's covariance at each fix, as if the earlier gains had been the UKF's.
- L, gamma and its raising are those of hinf.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import keep, number
from solvers.blocks.conditioning import above_rounding, gain, posterior_cov
from solvers.blocks.mixtures import spread_measurement, spread_transition
from solvers.blocks.moments import moments, transform
from solvers.blocks.square_root import any_of, symmetrize
from solvers.filters.base import count
from solvers.filters.hinfinity.hinf import HinfBelief, UnscentedHinf
from solvers.filters.hinfinity.inflation import inflate
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Function, Gaussian, Health, Innovation, Measurement, Moments, Transition

UKF, HINF, MIXED = 0, 1, 2  #: the order of the three covariances


class MixedBelief(NamedTuple):
    """One mean with three covariances; the other fields are those of ``HinfBelief``."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n), covariance of the mixed estimate
    covs: Array  #: (..., 3, n, n), covariances of the UKF, of the H-infinity UKF, and ``cov`` again
    d: Array  #: (...), the UKF's share of the last gain
    scale: Array
    weight: Array
    waited: Array
    theta: Array
    health: Health


@register("mixed_hinf_ukf")
@dataclass(frozen=True)
class MixedHinfUKF(UnscentedHinf[MixedBelief]):
    """The mixed UKF / H-infinity UKF; its mixing rule is a heuristic, for under the model the optimum is the UKF."""

    d: float | None = None  #: the UKF's share of the gain, 0 to 1; None: (4.4.2)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.d is not None:
            keep(self, "d", number, "None, or a number >= 0 and <= 1", least=0.0, most=1.0)

    def belief(self, b: HinfBelief) -> MixedBelief:
        covs = np.repeat(b.cov[..., None, :, :], 3, axis=-3)
        d = np.ones(b.mean.shape[:-1])
        return MixedBelief(b.mean, b.cov, covs, d, b.scale, b.weight, b.waited, b.theta, b.health)

    def predict(self, b: MixedBelief, tr: Transition) -> MixedBelief:
        each = spread_transition(tr, b.mean.ndim - 1)
        y, repaired = transform(each.f, _three(b), self.rule)
        covs = y.cov + each.Q
        b = b._replace(mean=y.mean[..., UKF, :], cov=covs[..., MIXED, :, :], covs=covs)
        return self.wait(count(b, any_of(repaired)), tr)

    def correct(self, b: MixedBelief, me: Measurement) -> tuple[MixedBelief, Innovation]:
        each = spread_measurement(me, b.mean.ndim - 1)
        y, repaired = moments(each.h, _three(b), self.rule)
        y = y._replace(cov=y.cov + each.R)
        K, W, repaired_S = gain(y)
        b = count(count(b, any_of(repaired)), any_of(repaired_S))
        posterior = above_rounding(b.covs - W.mT @ W, b.covs)
        b = self.bound(b, posterior[..., HINF, :, :])
        posterior[..., HINF, :, :] = inflate(posterior[..., HINF, :, :], b.weight, b.theta)
        d = self.share(posterior, b.weight)
        K_mixed = d[..., None, None] * K[..., UKF, :, :] + (1.0 - d)[..., None, None] * K[..., HINF, :, :]  # (4.4.1)
        residual = me.z - y.mean[..., UKF, :]
        mean = b.mean + (K_mixed @ residual[..., None])[..., 0]
        mixed = Moments(*(part[..., MIXED, :, :] if part.ndim > y.mean.ndim else part[..., MIXED, :] for part in y))
        cov = posterior_cov(Gaussian(b.mean, b.cov), mixed, K_mixed)
        posterior[..., MIXED, :, :] = cov
        return b._replace(mean=mean, cov=cov, covs=posterior, d=d), Innovation(residual, mixed.cov)

    def share(self, covs: Array, weight: Array) -> Array:
        """Return the UKF's share d (...) of the gain, 000 (4.4.2), from covs (..., 3, n, n) and the diagonal of L (..., n)."""
        if self.d is not None:
            return np.full(weight.shape[:-1], self.d)
        traces = (np.diagonal(covs, axis1=-2, axis2=-1) * (weight**2)[..., None, :]).sum(axis=-1)
        both = traces[..., UKF] + traces[..., HINF]
        return np.divide(traces[..., HINF], both, out=np.ones(both.shape), where=both != 0.0)

    def move(self, b: MixedBelief, g: Function, jac: Callable[[Array], Array]) -> MixedBelief:
        J = jac(b.mean)[..., None, :, :]
        covs = symmetrize(J @ b.covs @ J.mT)
        return b._replace(mean=g(b.mean), cov=covs[..., MIXED, :, :], covs=covs)

    def diagnostics(self, b: MixedBelief) -> dict[str, Array]:
        """Return the diagnostics of hinf_ukf for the H-infinity covariance, and the share d."""
        return {**super().diagnostics(b._replace(cov=b.covs[..., HINF, :, :])), "d": b.d}


def _three(b: MixedBelief) -> Gaussian:
    return Gaussian(np.repeat(b.mean[..., None, :], 3, axis=-2), b.covs)


SAME_AS = {
    "mixed_hinf_ukf": (
        Relation("ukf", {"gamma2": math.inf}),
        Relation("ukf", {"d": 1.0}),
    ),
}
UNLIKE = {
    "mixed_hinf_ukf": (Relation("hinf_ukf"),),
}
