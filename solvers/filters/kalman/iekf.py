"""Iterated extended Kalman filter.

Idea: Gauss-Newton steps to the maximum of the posterior. The extended Kalman filter takes only the first of them. Each step
takes the tangent of h again, at the newest estimate. If h is linear, as that of INS minus GPS, only the tangent of f can be
taken again. ``smooth`` does so, at the estimate, given the fix, of the state before the last transition. Without ``smooth``
the filter is the textbook's, which for a linear h is the extended Kalman filter.

One transition turns the state too little for its tangent to matter. With ``window_s`` the tangents of all transitions and fixes
of a window are taken again together (:mod:`solvers.filters.kalman.window`): the filter is the sliding-window smoother.

Source: Bell & Cathey (1993), doi:10.1109/9.250476; the transition as in Kullberg, Skog & Hendeby (2024), arXiv:2404.15359;
the window as in Bell (1994), doi:10.1137/0804035; docs/mathematics/filters.md#extended-kalman-filters.
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: each run stops by itself when no state moves by more than ``tolerance`` standard deviations. There is no line
search. ``smooth`` goes back one transition, not to the last fix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import flag, keep, number, whole
from solvers.blocks.conditioning import condition, gain
from solvers.blocks.moments import Linearized, moments, standard_deviations, tangent_moments
from solvers.filters.base import count
from solvers.filters.gaussian import Belief, GaussianFilter, initial_belief
from solvers.filters.kalman.window import WindowBelief, WindowFilter, length
from solvers.filters.relations import Relation
from solvers.registry import register
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Moments, Transition


@dataclass(frozen=True)
class Step:
    """The transition that led to a prediction, with the estimate before it."""

    tr: Transition
    before: Gaussian  #: the estimate before the transition
    cross: Array  #: (..., n, n), cross covariance of the states before and after


class Predicted(NamedTuple):
    """One Gaussian, and the transition that led to it."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    step: Step | None  #: None: no transition since the last fix
    window: WindowBelief | None = (
        None  #: the window, which ends in this Gaussian; None: no tangents of the past are kept
    )


@register("iekf")
@dataclass(frozen=True)
class IEKF(GaussianFilter[Predicted]):
    """The extended Kalman filter with tangents taken again at the estimate after the fix."""

    iterations: int = 5  #: largest number of tangents per fix; 1: the extended Kalman filter
    tolerance: float = 1e-3  #: change of the estimate, in standard deviations, below which the iteration stops
    smooth: bool = True  #: whether the tangent of the last transition is taken again too
    window_s: float = (
        0.0  #: s, time over which all tangents are taken again; up to the length of an epoch: the last alone
    )
    relinearise_s: float = 0.0  #: s, time from one set of tangents in the window to the next; 0: at each fix

    def __post_init__(self) -> None:
        keep(self, "iterations", whole, least=1, most=1000)
        keep(self, "tolerance", number, least=0.0)
        keep(self, "smooth", flag)
        keep(self, "window_s", number, "a number of seconds", least=0.0, infinite=True)
        keep(self, "relinearise_s", number, "a number of seconds", least=0.0, infinite=True)

    @cached_property
    def rule(self) -> Linearized:
        return Linearized("mean")

    @cached_property
    def window(self) -> WindowFilter:
        """The filter of a window that is longer than an epoch."""
        return WindowFilter(self.window_s, self.relinearise_s, self.iterations - 1, self.tolerance)

    def init(self, prior: Gaussian, rng: object = None) -> Predicted:
        """Make the belief at the start; a run whose prior is not finite has failed at epoch 0. ``rng`` is not used."""
        return Predicted(*initial_belief(prior), None)

    def step(self, b: Predicted, tr: Transition, me: Measurement | None) -> tuple[Predicted, Innovation | None]:
        if b.window is None and (self.window_s == 0.0 or self.window_s <= length(tr)):
            return super().step(b, tr, me)
        before = b.window or self.window.begin(Belief(b.mean, b.cov, b.health))
        window, innovation = self.window.step(before, tr, me)
        return _end_of(window), innovation

    def relocate(self, b: Predicted, g: Function, jac: Callable[[Array], Array]) -> Predicted:
        return super().relocate(b, g, jac) if b.window is None else _end_of(self.window.relocate(b.window, g, jac))

    @property
    def predicts_by_rule(self) -> bool:  # type: ignore[override]
        """Whether its prediction is that of ``rule``; a window changes the tangents afterwards."""
        return self.window_s == 0.0

    def predict(self, b: Predicted, tr: Transition) -> Predicted:
        before = Gaussian(b.mean, b.cov)
        y, _ = moments(tr.f, before, self.rule)
        step = Step(tr, before, y.cross) if self.smooth and not isinstance(tr.f, Linear) else None
        return b._replace(mean=y.mean, cov=y.cov + tr.Q, step=step)

    def correct(self, b: Predicted, me: Measurement) -> tuple[Predicted, Innovation]:
        x, step, at = Gaussian(b.mean, b.cov), b.step, b.mean
        first = at if step is None else step.before.mean
        going = np.ones(at.shape[:-1], dtype=bool)
        y, H = tangent_moments(me.h, x, at)
        for _ in range(self.iterations - 1):
            cross = y.cross if step is None else np.concatenate([step.cross @ H.mT, y.cross], axis=-2)
            K, _, _ = gain(Moments(y.mean, y.cov + me.R, cross))
            led = (K @ (me.z - y.mean)[..., None])[..., 0]
            there = x.mean + led[..., -at.shape[-1] :]
            going = going & (np.abs(there - at) > self.tolerance * standard_deviations(x.cov)).any(axis=-1)
            if not going.any():
                break
            at = np.where(going[..., None], there, at)  # a run that has stopped keeps its tangents
            if step is not None:
                first = np.where(going[..., None], step.before.mean + led[..., : at.shape[-1]], first)
                x, step = _again(step, first)
            y, H = tangent_moments(me.h, x, at)
        after, innovation, repaired = condition(x, y._replace(cov=y.cov + me.R), me.z)
        return count(b._replace(mean=after.mean, cov=after.cov, step=None), repaired), innovation

    def move(self, b: Predicted, g: Function, jac: Callable[[Array], Array]) -> Predicted:
        return super().move(b, g, jac)._replace(step=None)


def _again(step: Step, at: Array) -> tuple[Gaussian, Step]:
    """Predict again with the tangent of the transition taken at ``at`` (..., n), a state before it."""
    y, _ = tangent_moments(step.tr.f, step.before, at)
    return Gaussian(y.mean, y.cov + step.tr.Q), replace(step, cross=y.cross)


def _end_of(window: WindowBelief) -> Predicted:
    return Predicted(*window.now, None, window)


SAME_AS = {
    "iekf": (
        Relation("kf", on="linear", within=1e-10),
        Relation("ekf", {"iterations": 1}),
        Relation("ekf", {"smooth": False}, on="nonlinear f", within=1e-10),
        Relation("kf", {"tolerance": 0.0, "iterations": 9}, on="linear", within=1e-10),
    ),
}
UNLIKE = {
    "iekf": (
        Relation("iekf", of_other={"smooth": False}),
        Relation("iekf", of_other={"iterations": 2}),
        Relation("iekf", of_other={"window_s": 4.0}),
    ),
}
VARIANTS = {
    "iekf": ({"window_s": 4.0},),
}
