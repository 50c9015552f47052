"""Gaussian sum of extended Kalman filters: a bank over the angle that is least known.

Idea: a tangent taken at a heading that is wrong by tens of degrees claims information that is not there. At the first step
the prior is therefore cut into slices of this angle that are narrow enough for a tangent each. Each slice is an EKF, weighted
by how well it predicts. Slices that the fixes rule out are dropped, and slices that agree with the best one are merged into
it. Soon one EKF is left. If the angle is known well, the filter is the EKF.

The angle is found by asking f (solvers/filters/mixtures/angles.py), so the order of the states does not matter. Mean and
covariance of the mixture are taken about its best component, with angles within half a turn of it. Two modes at +-170 deg are
thus 20 deg apart.

Source: Sorenson & Alspach (1971), doi:10.1016/0005-1098(71)90097-5; Alspach & Sorenson (1972),
doi:10.1109/TAC.1972.1100034; docs/mathematics/filters.md#bank-over-the-heading.
Shapes: weights (..., G), means (..., G, n), covariances (..., G, n, n). G is the largest number of components that a run of the
batch still uses. In other runs the slots that are left carry weight zero and a copy of the best component.
Departures: components are merged and pruned by these two rules alone, and never split again. Only the angle is cut, so the other
errors must be small enough for the tangent of a slice. Tilts of 10 or 20 deg are too large: within a second a fix of 0.1 m/s
sees g (1 - cos tilt), which the tangent leaves out, and rules out a true slice. In invariant coordinates, the default in
navigation, such tilts are small enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.checks import choice, keep, number, refused, whole
from solvers.blocks.conditioning import nis
from solvers.blocks.mixtures import collapse, merge, summed
from solvers.blocks.moments import Linearized
from solvers.filters.mixtures.angles import TURN, least_known_angle, slices
from solvers.filters.mixtures.base import MixtureFilter, initial_mixture
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Function, Gaussian, Health, Innovation, Measurement, Transition

ESTIMATES = ("mean", "best")


class Bank(NamedTuple):
    """A mixture, and the angle along which it was cut."""

    weights: Array  #: (..., G)
    mean: Array  #: (..., G, n)
    cov: Array  #: (..., G, n, n)
    health: Health
    axis: NDArray[np.int64]  #: (...), index of the state that was cut; -1: none


@register("gsf_ekf")
@dataclass(frozen=True)
class GSFEKF(MixtureFilter[Bank]):
    """A bank of extended Kalman filters over the angle that is least known, as ``f`` shows it."""

    spacing_deg: float = 12.0  #: largest width of a slice
    components: int = 36  #: largest number of slices
    prune: float = 1e-8  #: weight below which a slice is dropped
    merge_within: float = 0.5  #: distance to the best slice, in standard deviations, at which one is merged
    estimate_by: str = "mean"  #: "mean" of the mixture, or "best", its likeliest component alone
    axis: int | None = None  #: index of the angle in the state; None: the filter finds it
    any_heading: ClassVar[bool] = True  #: it needs no coarse phase

    def __post_init__(self) -> None:
        keep(self, "spacing_deg", number, above=0.0, most=360.0)
        keep(self, "components", whole, least=3, most=1000)
        keep(self, "prune", number, least=0.0, below=0.01)
        keep(self, "merge_within", number, least=0.0)
        keep(self, "estimate_by", choice, ESTIMATES)
        if self.axis is not None:
            keep(self, "axis", whole, "None, or 0, 1, ... below the number of states", least=0)

    navigation_coordinates: ClassVar[str] = "invariant"  #: coordinates of the errors in navigation, by default

    @cached_property
    def rule(self) -> Linearized:
        return Linearized("mean")

    def init(self, prior: Gaussian, rng: Any = None) -> Bank:
        """Make a mixture of one component, the prior, which the first step cuts. ``rng`` is not used.

        Raises:
            ValueError: ``axis`` is not below the number of states.
        """
        b = initial_mixture(prior)
        if self.axis is not None and self.axis >= b.mean.shape[-1]:
            raise refused("axis", self.axis, f"None, or a whole number < {b.mean.shape[-1]}, the number of states")
        return Bank(*b, axis=np.full(b.weights.shape[:-1], -1))

    def advance(self, b: Bank, tr: Transition, me: Measurement | None) -> tuple[Bank, Innovation | None]:
        if b.health.epoch == 0:
            b = self.cut(b, tr.f)
        after, innovation = super().advance(b, tr, me)
        return self.tidy(after), innovation

    def estimate(self, b: Bank) -> Gaussian:
        """Return mean (..., n) and covariance (..., n, n) about the best component, or that component alone."""
        if b.weights.shape[-1] == 1:
            return Gaussian(b.mean[..., 0, :], b.cov[..., 0, :, :])
        best = _best(b)
        if self.estimate_by == "best":
            return best
        return collapse(b.weights, Gaussian(best.mean[..., None, :] + _apart(b, best), b.cov))

    def diagnostics(self, b: Bank) -> dict[str, Array]:
        return {**super().diagnostics(b), "components": (b.weights > 0.0).sum(axis=-1).astype(float)}

    def cut(self, b: Bank, f: Function) -> Bank:
        """Cut the first component into slices along the angle."""
        x, P = b.mean[..., 0, :], b.cov[..., 0, :, :]
        axis = least_known_angle(f, x, P) if self.axis is None else np.full(x.shape[:-1], self.axis)
        here = np.maximum(axis, 0)[..., None]
        column = np.take_along_axis(P, here[..., None], axis=-1)[..., 0]
        variance = np.take_along_axis(column, here, axis=-1)
        known = (axis[..., None] >= 0) & (variance > 0.0)
        offsets, weights, narrow = slices(
            np.where(known, variance, 0.0)[..., 0], math.radians(self.spacing_deg), self.components
        )
        regression = column / np.where(known, variance, 1.0)
        outer = regression[..., :, None] * regression[..., None, :]
        cov = P + outer * (narrow[..., None, None] - variance[..., None])
        cut = (weights > 0.0).sum(axis=-1) > 1
        cov = np.where(cut[..., None, None], cov, P)
        mean = x[..., None, :] + offsets[..., None] * regression[..., None, :]
        cov = np.repeat(cov[..., None, :, :], weights.shape[-1], axis=-3)
        return b._replace(weights=weights, mean=mean, cov=cov, axis=np.where(cut, axis, -1))

    def tidy(self, b: Bank) -> Bank:
        """Drop slices of little weight, and merge those that agree with the best one; G may shrink."""
        if b.weights.shape[-1] == 1:
            return b
        best = _best(b)
        apart = _apart(b, best)
        distance = nis(Innovation(apart, best.cov[..., None, :, :]))
        well = (b.health.failed_at < 0)[..., None]
        active = b.weights > np.where(well, self.prune, 0.0)
        near = well & active & (distance <= self.merge_within**2)
        top = np.arange(active.shape[-1]) == b.weights.argmax(axis=-1)[..., None]
        near |= top
        weight, one = merge(np.where(near, b.weights, 0.0), Gaussian(best.mean[..., None, :] + apart, b.cov))
        weights = np.where(top, weight[..., None], np.where(active & ~near, b.weights, 0.0))
        weights = np.where(well, weights / summed(weights)[..., None], weights)
        keep = weights > 0.0
        order = np.argsort(~keep, axis=-1, kind="stable")[..., : int(keep.sum(axis=-1).max(initial=1))]
        from_best = (top | ~keep)[..., None]
        mean = np.where(from_best, one.mean[..., None, :], b.mean)
        cov = np.where(from_best[..., None], one.cov[..., None, :, :], b.cov)
        return b._replace(
            weights=np.take_along_axis(weights, order, axis=-1),
            mean=np.take_along_axis(mean, order[..., None], axis=-2),
            cov=np.take_along_axis(cov, order[..., None, None], axis=-3),
        )


def _best(b: Bank) -> Gaussian:
    """Return the likeliest component, (..., n) and (..., n, n)."""
    at = b.weights.argmax(axis=-1)[..., None]
    mean = np.take_along_axis(b.mean, at[..., None], axis=-2)[..., 0, :]
    return Gaussian(mean, np.take_along_axis(b.cov, at[..., None, None], axis=-3)[..., 0, :, :])


def _apart(b: Bank, best: Gaussian) -> Array:
    """Return the means (..., G, n) minus the best one, with the angle within half a turn."""
    apart = b.mean - best.mean[..., None, :]
    angle = (np.arange(apart.shape[-1]) == b.axis[..., None])[..., None, :]
    return np.where(angle, apart - TURN * np.round(apart / TURN), apart)


SAME_AS = {
    "gsf_ekf": (Relation("ekf"),),
}
UNLIKE = {
    "gsf_ekf": (Relation("ekf", {"axis": 0}),),
}
