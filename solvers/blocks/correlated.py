"""A transition and a measurement that share noise, made independent, so that any filter may take them.

The noise w of the transition and v of the measurement have the covariance M. With J = M R^-1, the noise w - J v is independent
of v, and x' = f(x) + w is

    x' = f(x) + J (z - h(x')) + (w - J v),   cov(w - J v) = Q - J R J'

The h on the right is taken at f(x), because J hardly moves what h shows: a zero rate by 1e-5 of itself. For linear f and h this
is the update with K = (P H' + M) S^-1 and S = H P H' + H M + M' H' + R.
Source: Jazwinski (1970), Stochastic Processes and Filtering Theory, section 7.3; docs/mathematics/aiding.md#zero-velocity.
"""

from __future__ import annotations

import numpy as np

from sins_env.arrays import Array
from solvers.blocks.moments import tangent
from solvers.types import Function, Measurement, Transition


def independent(tr: Transition, me: Measurement, M: Array) -> Transition:
    """Return the transition whose noise is independent of that of ``me``, for M (..., n, m).

    Components of ``me`` that are not present share nothing.
    """
    there = np.ones(me.z.shape, dtype=bool) if me.present is None else me.present
    J = np.where(there[..., None, :], np.linalg.solve(me.R, M.mT).mT, 0.0)
    kind = AlongTangent if hasattr(tr.f, "value_and_jacobian") else Along
    return tr._replace(f=kind(tr.f, me.h, me.z, J), Q=tr.Q - J @ me.R @ J.mT)


class Along:
    """The map x -> f(x) + J (z - h(f(x)))."""

    def __init__(self, f: Function, h: Function, z: Array, J: Array) -> None:
        self.f, self.h, self.z, self.J = f, h, z, J

    def __call__(self, x: Array) -> Array:
        y = self.f(x)
        return self._moved(y, self.h(y))

    def _moved(self, y: Array, shown: Array) -> Array:
        batch = self.z.ndim - 1
        more = tuple(range(batch, batch + y.ndim - self.z.ndim))  # axes of points or components
        z, J = np.expand_dims(self.z, more), np.expand_dims(self.J, more)
        moved: Array = y + np.matmul(J, (z - shown)[..., None])[..., 0]
        return moved


class AlongTangent(Along):
    """The same for an f with a Jacobian of its own."""

    def value_and_jacobian(self, x: Array) -> tuple[Array, Array]:
        """Return value (..., n) and Jacobian (..., n, n) at x (..., n)."""
        y, F = tangent(self.f, x, np.zeros_like(x))
        shown, H = tangent(self.h, y, np.zeros_like(y))
        batch = self.z.ndim - 1
        J = np.expand_dims(self.J, tuple(range(batch, batch + y.ndim - self.z.ndim)))
        return self._moved(y, shown), F - J @ (H @ F)
