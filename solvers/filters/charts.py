"""Filters on manifolds: a filter of vectors about a point that moves along.

Idea: near a point x of a manifold a state is plus(x, d) with a tangent vector d. The filter is given the model in tangents,

    f_x(d) = minus(f(plus(x, d)), y) with y = f(x),    h_y(d) = h(plus(y, d)),

and takes its own step. Its belief then moves into the tangent at the new estimate, exactly as feedback moves the belief of a
closed loop. Every filter of the zoo therefore serves manifolds with the text that serves vectors.

Source: Hertzberg, Wagner, Frese & Schroeder (2013), doi:10.1016/j.inffus.2011.08.003 (plus and minus); Brossard, Barrau &
Bonnabel (2017), doi:10.1109/IROS.2017.8206066 (sigma points); docs/mathematics/filters.md#charts.
Shapes: points (..., p), tangent vectors (..., n), covariances (..., n, n).
Departures: the predicted mean is taken in the tangent at f(x), which is one round of the first source's iteration. The covariance
passes through each move by its Jacobian. A Jacobian that f or h has of its own is not used, for it is not that of the tangents.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import refused
from solvers.blocks.moments import STEP, tangent
from solvers.filters.base import choose
from solvers.filters.brief import Brief
from solvers.filters.inputs import checked_function
from solvers.types import Chart, Function, Gaussian, Health, Innovation, Measurement, Transition

MOVE_STEP = (
    1e-3  #: step of the numerical Jacobian of a move, in units of the tangent; larger than the rounding of any point
)
WITHIN = 1e-6  #: largest difference between minus(plus(x, d), x) and d, relative to the step
ROUNDING = 1e-14  #: largest rounding of minus, relative to the largest number of a point


class Located(NamedTuple):
    """A point, and the belief of a filter of vectors about it."""

    point: Array  #: (..., p)
    local: Any  #: belief over tangent vectors (..., n) at the point

    @property
    def health(self) -> Health:
        """How the runs fare."""
        return self.local.health


@dataclass(frozen=True)
class OnManifold(Brief):
    """A filter of the zoo for states on a manifold: ``OnManifold(make_filter("ukf"), chart)``.

    The prior has a point (..., p) as mean and a covariance (..., n, n) of the tangent there, as ``estimate`` has. The functions f
    and h take points; Q and the noise belong to the tangent at f(x). Angles, missing components and charts of the fix work as ever.

    Raises:
        ValueError: a chart that is none.
    """

    inner: Any  #: the filter of vectors, which works in the tangents
    chart: Chart

    def __post_init__(self) -> None:
        if not isinstance(self.chart, Chart):
            raise refused("chart", self.chart, "a solvers.types.Chart(plus, minus)")

    @property
    def batched(self) -> bool:
        """Whether the filter takes any batch shape; False: one run, of shape ()."""
        return bool(self.inner.batched)

    def init(self, prior: Gaussian, rng: Any = None) -> Located:
        """Make the belief at the start; see :class:`solvers.types.Filter`.

        Raises:
            ValueError: a chart whose minus does not undo its plus at the prior; shapes that do not fit.
        """
        point = np.array(prior.mean, dtype=float)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # runs without a prior are marked
            self._check(point)
            return Located(point, self.inner.init(Gaussian(self.chart.minus(point, point), prior.cov), rng))

    def _check(self, point: Array) -> None:
        """Refuse a chart that gives other shapes than it should, or whose minus does not undo its plus."""
        plus, minus = self.chart
        n = np.shape(minus(point, point))[-1] if point.ndim else 0
        d, x = MOVE_STEP * np.eye(n), point[..., None, :]
        moved = plus(x, d)
        given = (*point.shape[:-1], n, point.shape[-1])
        if np.shape(moved) != given:
            raise ValueError(
                f"chart: plus of points {x.shape} and tangent vectors {d.shape} has the shape {np.shape(moved)}: needed {given}."
                " It acts on the last axis and broadcasts the axes in front"
            )
        back = minus(moved, x)
        if np.shape(back) != (*point.shape[:-1], n, n):
            raise ValueError(
                f"chart: minus of points {given} and {x.shape} has the shape {np.shape(back)}:"
                f" needed {(*point.shape[:-1], n, n)}. It acts on the last axis and broadcasts the axes in front"
            )
        apart = np.where(np.asarray(np.isfinite(point).all(axis=-1))[..., None, None], np.abs(back - d), 0.0)
        if not (apart <= WITHIN * MOVE_STEP + ROUNDING * np.abs(x)[np.isfinite(x)].max(initial=0.0)).all():
            raise ValueError(
                f"chart: minus(plus(x, d), x) differs from d by {apart.max():.3g} for steps d of {MOVE_STEP:g}: needed d itself."
                " plus(x, d) leads from x to a point y, and minus(y, x), in this order, is the way back to d"
            )

    def step(self, b: Located, tr: Transition, me: Measurement | None) -> tuple[Located, Innovation | None]:
        """Predict, then correct; see ``BatchFilter.step``.

        Raises:
            ValueError: shapes that do not fit, or a Q or R that is no covariance.
        """
        x, (batch, p) = b.point, (b.point.shape[:-1], b.point.shape[-1])
        f = checked_function("f", tr.f, batch, p, p)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # runs that are lost are marked
            y = f(x)
            if me is not None:
                m = np.atleast_1d(np.asarray(me.z, dtype=float)).shape[-1]
                me = me._replace(h=_From(self.chart, checked_function("h", me.h, batch, m, p), y))
            local, innovation = self.inner.step(b.local, tr._replace(f=_Between(self.chart, f, x, y)), me)
            if local.health.frozen:
                y = np.where((local.health.failed_at < 0)[..., None], y, x)
            return self._centred(Located(y, local), lambda point: point), innovation

    def _centred(self, b: Located, g: Function) -> Located:
        """Move every point to g(point), and the belief into the tangent at the new estimate."""
        plus, minus = self.chart
        point = g(plus(b.point, self.inner.estimate(b.local).mean))

        def move(d: Array) -> Array:
            return minus(g(plus(_beside(b.point, d), d)), _beside(point, d))

        local = self.inner.relocate(b.local, move, lambda d: tangent(move, d, np.full(d.shape, MOVE_STEP / STEP))[1])
        well = local.health.failed_at == b.local.health.failed_at  # before and after the move
        if not well.all():
            local, point = choose(well, local, b.local), np.where(well[..., None], point, b.point)
        return Located(point, local)

    def estimate(self, b: Located) -> Gaussian:
        """Return the point (..., p), and the covariance (..., n, n) of the tangent there."""
        x = self.inner.estimate(b.local)
        return Gaussian(self.chart.plus(b.point, x.mean), x.cov)

    def relocate(self, b: Located, g: Function, jac: Callable[[Array], Array] | None = None) -> Located:
        """Move every point x to g(x), and the covariance with it. ``jac`` is not used: the chart tells the Jacobian."""
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            return self._centred(b, g)

    def diagnostics(self, b: Located) -> dict[str, Array]:
        """Return what the filter knows beside its estimate, by name, in the tangent."""
        return self.inner.diagnostics(b.local)


@dataclass(frozen=True)
class _Between:
    """The transition between two tangents: d at x -> minus(f(plus(x, d)), y) at y."""

    chart: Chart
    f: Function
    x: Array  #: (..., p)
    y: Array  #: (..., p)

    def __call__(self, d: Array) -> Array:
        return self.chart.minus(self.f(self.chart.plus(_beside(self.x, d), d)), _beside(self.y, d))


@dataclass(frozen=True)
class _From:
    """What a fix sees of a tangent vector: d at y -> h(plus(y, d))."""

    chart: Chart
    h: Function
    y: Array  #: (..., p)

    def __call__(self, d: Array) -> Array:
        return self.h(self.chart.plus(_beside(self.y, d), d))


def _beside(point: Array, d: Array) -> Array:
    """Return the point (*batch, p) with axes for the points (*batch, ..., n) of ``d``."""
    return point.reshape(*point.shape[:-1], *(1,) * (d.ndim - point.ndim), point.shape[-1])
