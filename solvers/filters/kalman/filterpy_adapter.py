"""filterpy 2.0's filters behind our contract: the field's baseline, with its own arithmetic and limits.

Source: R. Labbe, filterpy 2.0.0, classes KalmanFilter, ExtendedKalmanFilter, UnscentedKalmanFilter.
One run at a time: batch shape (), ``batched`` False. A filterpy object is made for each step and given the belief, so it
keeps nothing between steps. Its cubature filter is not offered, because its update leaves out Q. If filterpy cannot factor
a covariance, the step is tried once more with P repaired and R a little wider, and counted as a repair.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import scipy.linalg

from sins_env.arrays import Array
from solvers.blocks.moments import standard_deviations, tangent
from solvers.blocks.sigma_rules import Unscented
from solvers.blocks.square_root import cholesky
from solvers.filters.base import count, filled, settle
from solvers.filters.brief import Brief
from solvers.filters.gaussian import Belief, GaussianFilter, initial_belief
from solvers.filters.inputs import checked_measurement, checked_transition, picked, unwound, wrapped
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Function, Gaussian, Innovation, Measurement, Transition

WIDEN = 1e-10  #: relative increase of the variances of a fix with a singular S


@cache
def _filterpy() -> ModuleType:
    """Import filterpy.kalman when it is first used, for it imports matplotlib, which takes half a second."""
    import filterpy.kalman  # slow, see above

    return filterpy.kalman


def _root(P: Array) -> Array:
    """Return filterpy's default root, but without its ValueError for values that are not finite."""
    S: Array = scipy.linalg.cholesky(P, check_finite=False)
    return S


@dataclass(frozen=True)
class FilterpyFilter(Brief, ABC):
    """Base of the adapters: a subclass makes a filterpy object and lets it predict and update."""

    batched: ClassVar[bool] = False

    @abstractmethod
    def run(self, b: Belief, tr: Transition, me: Measurement | None) -> Any:
        """Return the filterpy object after one step from ``b``."""

    def init(self, prior: Gaussian, rng: Any = None) -> Belief:
        """Make the belief of one run at the start; ``rng`` is not used.

        Raises:
            ValueError: a prior of more than one run.
        """
        shape = np.shape(prior.mean)
        if len(shape) != 1:
            raise ValueError(
                f"{type(self).__name__} takes one run: prior mean of shape (n,), given {shape}. "
                "Loop over the runs, or use a filter whose `batched` is True."
            )
        return initial_belief(prior)

    def step(self, b: Belief, tr: Transition, me: Measurement | None) -> tuple[Belief, Innovation | None]:
        """Predict, then correct; a run on which filterpy fails is frozen and marked.

        Raises:
            ValueError: shapes that do not fit, or a Q or R that is no covariance.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            n = b.mean.shape[-1]
            tr = checked_transition(tr, (), n)
            if me is None:
                return self._stepped(b, tr, None)
            me = checked_measurement(me, (), n)
        rows = me.present
        if rows is None:
            return self._stepped(b, tr, unwound(me, None))
        after, seen = self._stepped(b, tr, unwound(picked(me, rows), None) if rows.any() else None)
        blank = Innovation(np.full(rows.shape, np.nan), np.full((*rows.shape, rows.size), np.nan))
        return after, blank if seen is None else filled(blank, np.ones((), dtype=bool), rows, seen)

    def _stepped(self, b: Belief, tr: Transition, me: Measurement | None) -> tuple[Belief, Innovation | None]:
        """Do what ``step`` does, for a transition and a measurement that are checked and complete."""
        lost = Gaussian(np.full_like(b.mean, np.nan), b.cov), None
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            repaired, (x, innovation) = None, lost
            try:
                x, innovation = self._run(b, tr, me)
            except np.linalg.LinAlgError:
                root, _ = cholesky(b.cov)
                widened = me and me._replace(R=me.R + WIDEN * np.diag(np.diagonal(me.R)))
                with suppress(np.linalg.LinAlgError):
                    x, innovation = self._run(b._replace(cov=root @ root.T), tr, widened)
                    repaired = np.ones((), dtype=bool)
        after = settle(b, count(b._replace(mean=x.mean, cov=x.cov), repaired))
        if me is not None and after.health.frozen:
            m = me.z.shape[-1]
            innovation = Innovation(np.full(m, np.nan), np.full((m, m), np.nan))
        return after, innovation

    def _run(self, b: Belief, tr: Transition, me: Measurement | None) -> tuple[Gaussian, Innovation | None]:
        o = self.run(b, tr, me)
        x = Gaussian(np.array(o.x), np.array(o.P))
        return x, None if me is None else Innovation(np.array(o.y), np.array(o.S))

    def estimate(self, b: Belief) -> Gaussian:
        return Gaussian(b.mean, b.cov)

    def diagnostics(self, b: Belief) -> dict[str, Array]:
        return {}

    def relocate(self, b: Belief, g: Function, jac: Callable[[Array], Array]) -> Belief:
        return GaussianFilter[Belief]().relocate(b, g, jac)


@register("filterpy_kf")
@dataclass(frozen=True)
class FilterpyKF(FilterpyFilter):
    """filterpy's KalmanFilter with the tangents of f and h at the origin, as our ``kf``."""

    feedback: ClassVar[str] = "closed"  #: feedback into the INS, unless a setting says otherwise

    def run(self, b: Belief, tr: Transition, me: Measurement | None) -> Any:
        n, m = b.mean.size, 1 if me is None else me.z.size
        o = _filterpy().KalmanFilter(dim_x=n, dim_z=m)
        o.x, o.P = b.mean, b.cov
        origin = np.zeros(n)
        start, F = tangent(tr.f, origin, standard_deviations(o.P))
        o.predict(u=start, B=np.eye(n), F=F, Q=tr.Q)
        if me is not None:
            constant, o.H = tangent(me.h, origin, standard_deviations(o.P))
            predicted = o.H @ o.x
            o.update(predicted + wrapped(me.z - constant - predicted, me.turns), R=me.R)
        return o


@register("filterpy_ekf")
@dataclass(frozen=True)
class FilterpyEKF(FilterpyFilter):
    """filterpy's ExtendedKalmanFilter with the tangents at the mean, as our ``ekf``."""

    def run(self, b: Belief, tr: Transition, me: Measurement | None) -> Any:
        n, m = b.mean.size, 1 if me is None else me.z.size
        o = _filterpy().ExtendedKalmanFilter(dim_x=n, dim_z=m)
        o.x, o.P, o.Q = b.mean, b.cov, tr.Q
        predicted, o.F = tangent(tr.f, b.mean, standard_deviations(b.cov))
        o.predict_x = lambda u=0: setattr(o, "x", predicted)  # filterpy's manual asks to override this method
        o.predict()
        if me is not None:
            scale = standard_deviations(o.P)
            o.update(me.z, HJacobian=lambda x: tangent(me.h, x, scale)[1], Hx=me.h, R=me.R)
        return o


@register("filterpy_ukf")
@dataclass(frozen=True)
class FilterpyUKF(FilterpyFilter):
    """filterpy's UnscentedKalmanFilter on MerweScaledSigmaPoints; 2.0 draws its points anew after the prediction."""

    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n

    def __post_init__(self) -> None:
        Unscented(self.alpha, self.beta, self.kappa)  # the same settings, checked in one place

    def run(self, b: Belief, tr: Transition, me: Measurement | None) -> Any:
        n, m = b.mean.size, 1 if me is None else me.z.size
        kalman = _filterpy()
        points = kalman.MerweScaledSigmaPoints(n, self.alpha, self.beta, self.kappa, sqrt_method=_root)
        h = None if me is None else me.h
        o = kalman.UnscentedKalmanFilter(n, m, dt=tr.dt, hx=h, fx=lambda x, dt: tr.f(x), points=points)
        o.x, o.P, o.Q = b.mean, b.cov, tr.Q
        o.predict()
        if me is not None:
            o.update(me.z, R=me.R)
        return o


_SPREAD = {"alpha": 0.7, "beta": 2.0, "kappa": 1.0}
SAME_AS = {
    "filterpy_kf": (Relation("kf", within=1e-10),),
    "filterpy_ekf": (Relation("ekf", within=1e-10),),
    "filterpy_ukf": (
        Relation("ukf", within=1e-10),
        Relation("ukf", _SPREAD, _SPREAD, within=1e-10),
    ),
}
VARIANTS = {
    "filterpy_ukf": ({"alpha": 0.5, "beta": 2.0},),
}
