"""filterpy 2.0's filters behind our contract: the field's baseline, with its own arithmetic and limits.

Source: R. Labbe, filterpy 2.0.0, classes KalmanFilter, ExtendedKalmanFilter, UnscentedKalmanFilter.
One run at a time: batch shape (), ``batched`` False. A filterpy object is made for each step and given the belief, so it
keeps nothing between steps. Its cubature filter is not offered, because its update leaves out Q.

What filterpy inverts or factors must be regular. A component of a fix that follows from those before it, by a singular S, is
therefore left out, as if it were missing. A covariance that filterpy cannot factor gets our root. Both count as repairs. The
variances of its unscented filter, which subtracts, are after a fix at least what rounding lets see, as in our own filters.
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

from sins_env.arrays import Array, Mask
from solvers.blocks.conditioning import above_rounding, inverse_lower
from solvers.blocks.moments import standard_deviations, tangent
from solvers.blocks.sigma_rules import Unscented
from solvers.blocks.square_root import cholesky, factor
from solvers.filters.base import count, filled, settle
from solvers.filters.brief import Brief
from solvers.filters.gaussian import Belief, GaussianFilter, initial_belief
from solvers.filters.inputs import checked_measurement, checked_transition, picked, unwound, wrapped
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Function, Gaussian, Innovation, Measurement, Transition

REGULAR = 1e-12  #: least variance of a component of a fix given those before it, relative to its own
WELL = 1e-4  #: the same, below which filterpy's unscented filter gets a fix that is whitened


@cache
def _filterpy() -> ModuleType:
    """Import filterpy.kalman when it is first used, for it imports matplotlib, which takes half a second."""
    import filterpy.kalman  # slow, see above

    return filterpy.kalman


class _Root:
    """filterpy's default root, an upper one, and ours of a covariance that has none; it remembers whether that was needed."""

    def __init__(self) -> None:
        self.repaired = False

    def __call__(self, P: Array) -> Array:
        try:
            S: Array = scipy.linalg.cholesky(P, check_finite=False)
        except np.linalg.LinAlgError:
            self.repaired = True
            S = cholesky(P)[0].T
        return S


def _follows(S: Array) -> int | None:
    """Return the first component that follows from those before it, by an S (m, m) that is finite; None: each tells something."""
    if not np.isfinite(S).all():
        return None
    pivots = np.square(np.diagonal(factor(S)[0]))
    following = np.flatnonzero(~(pivots > REGULAR * np.diagonal(S)))
    return int(following[0]) if following.size else None


@dataclass(frozen=True)
class FilterpyFilter(Brief, ABC):
    """Base of the adapters: a subclass makes a filterpy object that has predicted, and lets it update."""

    batched: ClassVar[bool] = False

    @abstractmethod
    def predicted(self, b: Belief, tr: Transition, m: int, root: _Root) -> Any:
        """Return a filterpy object for fixes of ``m`` components after the prediction from ``b``."""

    @abstractmethod
    def update(self, o: Any, me: Measurement) -> None:
        """Let the object correct its state by a fix."""

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
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            n = b.mean.shape[-1]
            tr = checked_transition(tr, (), n)
            me = None if me is None else checked_measurement(me, (), n)
            if me is None or me.present is None:
                x, innovation, repaired = self._run(b, tr, me if me is None else unwound(me, None))
            else:
                x, innovation, repaired = self._run_without(b, tr, me, me.present)
            after = settle(b, count(b._replace(mean=x.mean, cov=x.cov), np.asarray(True) if repaired else None))
        if innovation is not None and after.health.frozen:
            innovation = Innovation(np.full_like(innovation.residual, np.nan), np.full_like(innovation.cov, np.nan))
        return after, innovation

    def _run(self, b: Belief, tr: Transition, me: Measurement | None) -> tuple[Gaussian, Innovation | None, bool]:
        """Return the estimate after a step with a complete fix, its innovation, and whether anything was repaired."""
        root = _Root()
        o = self.predicted(b, tr, 1 if me is None else me.z.size, root)
        x = Gaussian(np.array(o.x), np.array(o.P))
        if me is None:
            return x, None, root.repaired
        done = False
        with suppress(np.linalg.LinAlgError):  # by a singular S, which is set before its inverse is sought
            self.update(o, me)
            done = True
        at = _follows(o.S)
        if at is not None:
            x, innovation, _ = self._run_without(b, tr, me, np.arange(me.z.size) != at)
            return x, innovation, True
        mean = np.array(o.x) if done else np.full(x.mean.shape, np.nan)
        return Gaussian(mean, np.array(o.P)), Innovation(np.array(o.y), np.array(o.S)), root.repaired

    def _run_without(self, b: Belief, tr: Transition, me: Measurement, rows: Mask) -> tuple[Gaussian, Innovation, bool]:
        """Do what ``_run`` does, with the components in the mask (m,) alone."""
        x, seen, repaired = self._run(b, tr, unwound(picked(me, rows), None) if rows.any() else None)
        blank = Innovation(np.full(rows.shape, np.nan), np.full((*rows.shape, rows.size), np.nan))
        return x, blank if seen is None else filled(blank, np.ones((), dtype=bool), rows, seen), repaired

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

    def predicted(self, b: Belief, tr: Transition, m: int, root: _Root) -> Any:
        n = b.mean.size
        o = _filterpy().KalmanFilter(dim_x=n, dim_z=m)
        o.x, o.P = b.mean, b.cov
        start, F = tangent(tr.f, np.zeros(n), standard_deviations(o.P))
        o.predict(u=start, B=np.eye(n), F=F, Q=tr.Q)
        return o

    def update(self, o: Any, me: Measurement) -> None:
        constant, o.H = tangent(me.h, np.zeros(o.x.size), standard_deviations(o.P))
        predicted = o.H @ o.x
        o.update(predicted + wrapped(me.z - constant - predicted, me.turns), R=me.R)


@register("filterpy_ekf")
@dataclass(frozen=True)
class FilterpyEKF(FilterpyFilter):
    """filterpy's ExtendedKalmanFilter with the tangents at the mean, as our ``ekf``."""

    def predicted(self, b: Belief, tr: Transition, m: int, root: _Root) -> Any:
        o = _filterpy().ExtendedKalmanFilter(dim_x=b.mean.size, dim_z=m)
        o.x, o.P, o.Q = b.mean, b.cov, tr.Q
        predicted, o.F = tangent(tr.f, b.mean, standard_deviations(b.cov))
        o.predict_x = lambda u=0: setattr(o, "x", predicted)  # filterpy's manual asks to override this method
        o.predict()
        return o

    def update(self, o: Any, me: Measurement) -> None:
        _, H = tangent(me.h, o.x, standard_deviations(o.P))
        o.S = H @ o.P @ H.T + me.R
        if not np.isfinite(o.S).all():
            raise np.linalg.LinAlgError("a covariance that is not finite has no inverse")
        if _follows(o.S) is None:  # otherwise scipy would invert it nevertheless, with a warning
            o.update(me.z, HJacobian=lambda x: H, Hx=me.h, R=me.R)


@register("filterpy_ukf")
@dataclass(frozen=True)
class FilterpyUKF(FilterpyFilter):
    """filterpy's UnscentedKalmanFilter on MerweScaledSigmaPoints; 2.0 draws its points anew after the prediction."""

    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n

    def __post_init__(self) -> None:
        Unscented(self.alpha, self.beta, self.kappa)  # the same settings, checked in one place

    def predicted(self, b: Belief, tr: Transition, m: int, root: _Root) -> Any:
        n, kalman = b.mean.size, _filterpy()
        points = kalman.MerweScaledSigmaPoints(n, self.alpha, self.beta, self.kappa, sqrt_method=root)
        o = kalman.UnscentedKalmanFilter(n, m, dt=tr.dt, hx=None, fx=lambda x, dt: tr.f(x), points=points)
        o.x, o.P, o.Q = b.mean, b.cov, tr.Q
        o.predict()
        return o

    def update(self, o: Any, me: Measurement) -> None:
        o.update(me.z, R=me.R, hx=me.h)
        L, singular = factor(o.S)
        if not singular and (np.square(np.diagonal(L)) < WELL * np.diagonal(o.S)).any() and _follows(o.S) is None:
            W, h = inverse_lower(L), me.h  # P - K S K' with S^-1 keeps few digits: once more, by a fix with S = I
            o.x, o.P = o.x_prior, o.P_prior
            o.update(W @ me.z, R=W @ me.R @ W.T, hx=lambda x: W @ h(x))
            o.y, o.S = L @ o.y, L @ o.S @ L.T
        o.P = above_rounding(o.P, o.P_prior)


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
