"""Variational-Bayes adaptive cubature Kalman filter.

Idea: the predicted covariance and R are unknown, too, with inverse-Wishart priors about the told ones. The posterior of state,
covariance and R is taken as a product, of which each factor follows from the means of the others. A few iterations at each
fix find them:

    given P and R,  x, P+     the cubature update of x-                                              Huang (20-22, 38-40)
    given x, P+     A = P+ + (x - x-)(x - x-)'                       P = (tau P- + A) / (tau + 1)    Huang (25, 29, 36)
                    B = E[(z - h(x))(z - h(x))']                     R = (c R- + B) / (c + 1)        Huang (26, 32, 37)

Here c is the number of fixes that R- counts for: it starts at ``k0`` and becomes rho (c + 1) from a fix to the next. In one
dimension it is twice the alpha of an inverse gamma distribution, whose beta is c R / 2. With a Q that is too small A exceeds P-
again and again, and P grows with the innovations. With ``adapt`` "R" an outlier has little weight, because the R of its fix
grows with it.

Source: Sarkka & Nummenmaa (2009), doi:10.1109/TAC.2008.2008348 (R); Huang, Zhang, Wu, Li & Chambers (2018),
doi:10.1109/TAC.2017.2730480 (P and R); docs/mathematics/filters.md#variational-bayes.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., 2n, n).
Departures:

- R is estimated in units of the told one. What is remembered of it stays within ``floor`` and ``cap``; a direction told to be
  without noise keeps none.
- The degrees of freedom of the inverse-Wishart distributions are c + m + 1 and tau + n + 1, as in Huang's paper. With its
  formula for E[R^-1] the factor of x then has the R above, which is the mean of the distribution.
- ``tau`` is 10, beyond the 2 to 6 of Huang's paper: with heavy-tailed fixes smaller values cost three runs of sixty.
- The first update has the told P and the last R, as in Sarkka's paper, where Huang's begins with x = x- and P+ = P-.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import choice, keep, number, whole
from solvers.blocks import noise as noises
from solvers.blocks.conditioning import condition, inverse_lower
from solvers.blocks.moments import SigmaPoints, moments
from solvers.blocks.sigma_rules import Cubature
from solvers.blocks.square_root import cholesky, either
from solvers.filters.adaptive.base import refuse_another_size
from solvers.filters.base import count
from solvers.filters.gaussian import GaussianFilter, initial_belief
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Gaussian, Health, Innovation, Measurement, Transition

ADAPT = ("QR", "Q", "R", "none")


class VariationalBelief(NamedTuple):
    """One Gaussian, and what is known of R in units of the told one."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    excess: Array  #: (..., m, m), the estimated R without the told one, in units of the told one
    share: Array  #: (...), 1/c, the weight of the last fix in the estimate


@register("vb_ckf")
@dataclass(frozen=True)
class VBCKF(GaussianFilter[VariationalBelief]):
    """The cubature Kalman filter that finds its predicted covariance and R by variational Bayes.

    Raises:
        ValueError: a setting outside its range.
    """

    predicts_by_rule: ClassVar[bool] = False  # a fix changes the prediction's covariance

    adapt: str = "QR"  #: what is estimated: "QR", "Q", by the covariance of the prediction, "R", or "none"
    tau: float = 10.0  #: number of fixes that the predicted covariance counts for; inf: it is kept
    k0: float = 20.0  #: number of fixes that the told R counts for; inf: it is kept
    rho: float = 0.99  #: share of what is known of R that is still true at the next fix
    iterations: int = 5  #: number of iterations at each fix
    floor: float = 1e-4  #: least R, relative to the told one
    cap: float = 1e4  #: largest R, relative to the told one
    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance

    def __post_init__(self) -> None:
        _ = self.rule  # checks the setting
        keep(self, "adapt", choice, ADAPT)
        keep(self, "tau", number, above=0.0, infinite=True)
        keep(self, "k0", number, above=0.0, infinite=True)
        keep(self, "rho", number, above=0.0, most=1.0)
        keep(self, "iterations", whole, least=1, most=1000)
        keep(self, "floor", number, least=0.0, most=1.0)
        keep(self, "cap", number, least=1.0)

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(Cubature(), self.root)

    def init(self, prior: Gaussian, rng: Any = None) -> VariationalBelief:
        """Make the belief at the start, with the R that the first fix tells; ``rng`` is not used."""
        b = initial_belief(prior)
        batch = b.mean.shape[:-1]
        return VariationalBelief(*b, np.zeros((*batch, 1, 1)), np.full(batch, 1.0 / self.k0))

    def checked(self, b: Any, tr: Transition, me: Measurement | None) -> tuple[Transition, Measurement | None]:
        tr, me = super().checked(b, tr, me)
        if me is not None and b.excess.any():
            refuse_another_size(me, b.excess.shape[-1])
        return tr, me

    def correct(self, b: VariationalBelief, me: Measurement) -> tuple[VariationalBelief, Innovation]:
        L, _ = cholesky(me.R)
        told, unit = np.eye(me.z.shape[-1]), inverse_lower(L)
        weight = (b.share / self.rho)[..., None, None]
        share = weight / (1.0 + weight) if "R" in self.adapt else 0.0
        share_P = 1.0 / (self.tau + 1.0) if "Q" in self.adapt else 0.0
        excess = known = b.excess + 0.0 * told  # before the first fix it does not know its size
        x, first, repaired = self._given(b, b.cov, known, L, me)
        for _ in range(self.iterations if self.adapt != "none" else 0):
            y, repaired_y = moments(me.h, x, self.rule)
            A, B = x.cov + _square(x.mean - b.mean), y.cov + _square(me.z - y.mean)
            P = b.cov + share_P * (A - b.cov)
            excess = known + share * (unit @ B @ unit.mT - told - known)
            x, _, again = self._given(b, P, excess, L, me)
            repaired = either(either(repaired, repaired_y), again)
        after = b._replace(mean=x.mean, cov=x.cov)
        if "R" in self.adapt:
            R = noises.bound(told + excess, told, self.floor, self.cap, "full")
            after = after._replace(excess=R - told, share=np.asarray(share)[..., 0, 0])
        return count(after, repaired), first

    def correct_rows(self, b: VariationalBelief, me: Measurement, rows: Mask) -> tuple[VariationalBelief, Innovation]:
        """Correct by the components in the mask (m,); what is known of the R of the others stays."""
        excess, at = b.excess + np.zeros(me.R.shape[-2:]), np.flatnonzero(rows)
        block = ..., at[:, None], at
        x, seen = super().correct_rows(b._replace(excess=excess[block]), me, rows)
        excess[block] = x.excess
        return x._replace(excess=excess), seen

    def diagnostics(self, b: VariationalBelief) -> dict[str, Array]:
        """Return the variances of the estimated R, in units of the told one, and the number of fixes they count for."""
        with np.errstate(divide="ignore"):
            return {"R": 1.0 + noises.variances(b.excess), "fixes": 1.0 / b.share}

    def _given(
        self, b: VariationalBelief, P: Array, excess: Array, L: Array, me: Measurement
    ) -> tuple[Gaussian, Innovation, Mask | None]:
        """Update the prediction with the covariance P (..., n, n) and the estimated R."""
        prior = Gaussian(b.mean, P)
        y, repaired = moments(me.h, prior, self.rule)
        R = me.R + L @ excess @ L.mT
        x, innovation, repaired_S = condition(prior, y._replace(cov=y.cov + R), me.z)
        return x, innovation, either(repaired, repaired_S)


def _square(a: Array) -> Array:
    """Return a a' (..., k, k) for vectors a (..., k)."""
    return a[..., :, None] * a[..., None, :]


SAME_AS = {
    "vb_ckf": (
        Relation("ckf", {"adapt": "none"}),
        Relation("ckf", {"tau": math.inf, "k0": math.inf}, within=1e-10),
        Relation("ckf", {"tau": 1e12, "k0": 1e12, "rho": 1.0}, within=1e-10),
    ),
}
UNLIKE = {
    "vb_ckf": (
        Relation("vb_ckf", of_other={"adapt": "Q"}),
        Relation("vb_ckf", of_other={"adapt": "R"}),
        Relation("vb_ckf", of_other={"iterations": 1}),
    ),
}
