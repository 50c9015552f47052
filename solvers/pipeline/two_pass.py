"""The two-pass estimator: the reference of a task, near the Cramer-Rao bound.

A single filter linearises the early epochs at its estimate of that time, which may be wrong by tens of degrees. Here a cubature
filter aligns first, until its heading is good to a degree. Then the epochs so far are filtered again. They are linearised along
the trajectory of errors x_ that ends at the estimate:

    x_k = x_k_ + d_k,   d_0 ~ N(-x_0_, P0),   d' = F(x_) d + w,   z = h(x_) + H(x_) d + v

This is one Gauss-Newton step of the maximum a posteriori problem, with the told prior unchanged. Later epochs continue in the
same way. A run whose heading was worse than a degree at that time takes another step when the time has doubled. With few fixes
the tangent would otherwise stay at a trajectory that is degrees off, and the covariance would be too small for good. Nothing is
mechanised twice: the INS of the first pass stays, and x_ follows from its error model. An epoch is kept as its error model and
its measurement, 0.3 kB per run.
Equations: docs/mathematics/bound.md#two-passes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import keep, number
from sins_env.states import Layout
from sins_env.types import Rng, Task
from sins_env.units import DEG
from solvers.filters.base import choose, mixed
from solvers.filters.brief import changed
from solvers.filters.kalman.kf import KF
from solvers.filters.sigma.ckf import CKF
from solvers.pipeline.errors.alignment import STATES
from solvers.pipeline.estimator import Aligner
from solvers.registry import register
from solvers.types import Filter, Function, Gaussian, Health, Innovation, Linear, Measurement, Transition

Epoch = tuple[Transition, Measurement | None]

GOOD_DEG = 1.0  #: standard deviation of an angle, in fact the heading, above which a run is linearised again, deg
AGAIN = 4  #: largest number of times that it is, each after twice the time of the one before
SHOTS = 2  #: corrections of the start from which the errors lead to the estimate; each leaves a tenth of the miss


class TwoPassBelief(NamedTuple):
    """The belief of the filter in use, and what the second pass needs."""

    inner: Any  #: belief of the first filter, then that of d
    nominal: Array | None  #: x_ (..., n); None in the first pass
    prior: Gaussian
    past: tuple[Epoch, ...]  #: epochs since the start, as long as they may be passed again
    rough: Mask  #: (...), runs that will be linearised again, all of them in the first pass
    passes: int = 0  #: number of times that the past was linearised

    @property
    def health(self) -> Health:
        """Health of the filter in use; repairs of the first pass are included."""
        health: Health = self.inner.health
        return health


@dataclass(frozen=True)
class TwoPassFilter:
    """A filter that starts again: the filter ``first`` for some seconds, then ``tangent`` for these again and all later ones.

    Runs whose heading is not known to a degree by then start again after twice the time, at most four times.

    Raises:
        ValueError: ``relinearise_s`` is not positive.
    """

    relinearise_s: float = 120.0  #: s, time of the first pass
    first: Filter[Any] = field(default_factory=CKF)  #: the filter of the first pass
    tangent: Filter[Any] = field(default_factory=KF)  #: the filter of d, with the tangent at d = 0
    states: Layout = STATES  #: layout of x
    batched = True

    def __post_init__(self) -> None:
        keep(self, "relinearise_s", number, "a positive number of seconds", above=0.0, infinite=True)

    def init(self, prior: Gaussian, rng: Any) -> TwoPassBelief:
        inner = self.first.init(prior, rng)
        return TwoPassBelief(inner, None, prior, (), np.ones(inner.health.failed_at.shape, dtype=bool))

    def step(self, b: TwoPassBelief, tr: Transition, me: Measurement | None) -> tuple[TwoPassBelief, Innovation | None]:
        """Take one epoch; the one at ``relinearise_s`` takes a second per thousand epochs and a few hundred runs."""
        if b.nominal is None:
            inner, innovation = self.first.step(b.inner, tr, me)
            b = b._replace(inner=inner)
        else:
            with _quiet():
                b, innovation = self._along(b, tr, me)
            if not b.rough.any():
                return b, innovation
        b = b._replace(past=(*b.past, (tr, me)))
        if tr.dt is None or len(b.past) * tr.dt < 2**b.passes * self.relinearise_s * (1 - 1e-9):
            return b, innovation
        with _quiet():
            return self._again(b), innovation

    def _again(self, b: TwoPassBelief) -> TwoPassBelief:
        """Pass the past again in the runs that are rough; runs that are lost stay lost."""
        now = self.estimate(b)
        health, nominal = b.inner.health, _start(b.past, now.mean, self.states)
        inner = self.tangent.init(Gaussian(b.prior.mean - nominal, b.prior.cov), None)
        lost = np.where(health.failed_at >= 0, health.failed_at, inner.health.failed_at)
        frozen = health.frozen or inner.health.frozen
        inner = inner._replace(health=health._replace(epoch=0, failed_at=lost, frozen=frozen))
        out = b._replace(inner=inner, nominal=nominal)
        for tr, me in b.past:
            out, _ = self._along(out, tr, me)
        if b.nominal is not None:
            better = b.rough & (out.health.failed_at < 0)
            out = out._replace(inner=mixed(better, out.inner, b.inner), nominal=choose(better, out.nominal, b.nominal))
        variance = np.diagonal(now.cov, axis1=-2, axis2=-1)[..., self.states["phi"]].max(axis=-1)
        rough = b.rough & (variance > (GOOD_DEG * DEG) ** 2) & (out.health.failed_at < 0) & (b.passes < AGAIN)
        return out._replace(past=b.past if rough.any() else (), rough=rough, passes=b.passes + 1)

    def _along(
        self, b: TwoPassBelief, tr: Transition, me: Measurement | None
    ) -> tuple[TwoPassBelief, Innovation | None]:
        before = b.nominal
        assert before is not None
        after = tr.f(before)
        moved = tr._replace(f=_shifted(tr.f, before, after))
        seen = me and me._replace(h=_shifted(me.h, after))
        inner, innovation = self.tangent.step(b.inner, moved, seen)
        return b._replace(inner=inner, nominal=after), innovation

    def estimate(self, b: TwoPassBelief) -> Gaussian:
        if b.nominal is None:
            return self.first.estimate(b.inner)
        d = self.tangent.estimate(b.inner)
        return Gaussian(b.nominal + d.mean, d.cov)

    def diagnostics(self, b: TwoPassBelief) -> dict[str, Array]:
        return {}

    def relocate(self, b: TwoPassBelief, g: Function, jac: Callable[[Array], Array]) -> TwoPassBelief:
        raise NotImplementedError("the two-pass filter runs open loop")


def _quiet() -> Any:
    """Silence warnings of lost runs, because the filters mark these."""
    return np.errstate(invalid="ignore", over="ignore", divide="ignore")


def _shifted(g: Function, at: Array, origin: Array | None = None) -> Function:
    """Return the function d -> g(at + d) - origin, for d (..., n) and, as points, (..., points, n)."""
    if isinstance(g, Linear):
        return Linear(g.matrix, g(at) if origin is None else g(at) - origin)

    def shifted(d: Array) -> Array:
        points = d.ndim > at.ndim
        y = g((at[..., None, :] if points else at) + d)
        return y if origin is None else y - (origin[..., None, :] if points else origin)

    return shifted


def _start(past: tuple[Epoch, ...], end: Array, states: Layout) -> Array:
    """Return the x_0_ (..., n) from which the misalignment leads to that of ``end``, with the biases of ``end``.

    The velocity is the told one. It enters the error model only through omega_en, so its trajectory need not be near the
    true one.
    """
    start = end.copy()
    phi = states["phi"]
    start[..., states["dv"]] = 0.0
    for _ in range(SHOTS):
        x = start
        for tr, _ in past:
            x = tr.f(x)
        start[..., phi] += end[..., phi] - x[..., phi]
    return start


@register("two_pass")
class TwoPass(Aligner):
    """The reference estimator: a cubature filter, and after 120 s a second, linear pass over all fixes from the start.

    The settings are those of the pipeline, without ``feedback``, because the loop is open. ``relinearise_s`` is the time of the
    fine phase after which the second pass begins, s.
    """

    def __init__(
        self, *, relinearise_s: float = 120.0, model: str = "exact", bias_frame: str = "body", coarse: str | None = None
    ) -> None:
        super().__init__(
            TwoPassFilter(relinearise_s), model=model, bias_frame=bias_frame, feedback="open", coarse=coarse
        )

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode.

        Raises:
            ValueError: the task navigates, or has an unknown start without a coarse phase.
        """
        if task.start is None and not task.coarse_s:
            raise ValueError(
                f"two_pass on {task.id} with an unknown start and coarse = 0; allowed: a told start, or a coarse phase"
            )
        super().reset(task, rng, num_runs)
        assert isinstance(self.filter, TwoPassFilter)
        self.filter = replace(self.filter, states=self.states)

    def __repr__(self) -> str:
        values = {**vars(self.filter), **vars(self.settings)}
        return f"TwoPass({', '.join(changed(TwoPass, values))})"
