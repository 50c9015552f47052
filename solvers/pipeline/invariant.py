"""Coordinates of the errors: as the error model has them, or right-invariant on SE_2(3).

The INS's state X_hat and the true X are (C, v, p); their right-invariant error is Exp(xi) = X_hat X^-1:

    Exp(-theta x) = C_n^c(phi),   eta_v = v_hat - C_n^c v = J xi_v,   eta_p = p_hat - C_n^c p = J xi_p

with v = v_hat - dv, p = p_hat - dp, J the left Jacobian of SO(3) at -theta; p is in metres from the site. Biases stay as they
are. A filter on xi sees the error model through this change of coordinates, at the INS's state of each epoch; what goes back
into the INS is the exact error of its estimate. Where the earth is flat and at rest and there are no biases, an epoch is
xi -> A xi exactly, with A independent of the motion (Barrau & Bonnabel 2017, theorem 2, doi:10.1109/TAC.2016.2594085).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.earth import Earth
from sins_env.types import NavState
from solvers.blocks.moments import tangent
from solvers.pipeline.strapdown import cross_planes
from solvers.types import Function, Gaussian, Measurement, Transition

Array = NDArray[np.float64]
Maps = tuple[Function, Callable[[Array], Array]]

COORDINATES = ("euler", "invariant")
SMALL = 1e-4  #: squared angle below which series are used


class Euler:
    """The errors of the model, with the misalignment as Euler angles."""

    def prior(self, x: Gaussian, nav: NavState) -> Gaussian:
        return x

    def transition(self, tr: Transition, before: NavState, after: NavState) -> Transition:
        return tr

    def measurement(self, me: Measurement, nav: NavState) -> Measurement:
        return me

    def errors(self, xi: Array, nav: NavState) -> Array:
        """The model's errors of a filter's estimate."""
        return xi

    def gaussian(self, xi: Gaussian, nav: NavState) -> Gaussian:
        return xi

    def reset(self, maps: Maps, before: NavState, after: NavState) -> Maps:
        return maps


class Invariant(Euler):
    """Right-invariant errors of the model ``NavigationErrors``."""

    def __init__(self, model: Earth, site_pos: Array, position: bool) -> None:
        self._model, self._site, self._position = model, np.asarray(site_pos), position

    def at(self, nav: NavState) -> Chart:
        if not self._position:
            return Chart(nav.vel[..., None, :])
        return Chart(np.stack([nav.vel, earth.offset(self._model, self._site, nav.pos)], axis=-2))

    def prior(self, x: Gaussian, nav: NavState) -> Gaussian:
        D = self.at(nav).slope(x.mean.shape[-1])
        return Gaussian(x.mean, D @ x.cov @ D.mT)

    def transition(self, tr: Transition, before: NavState, after: NavState) -> Transition:
        a, b = self.at(before), self.at(after)
        D = b.slope(tr.Q.shape[-1])
        return tr._replace(f=lambda xi: b.invariant(tr.f(a.errors(xi))), Q=D @ tr.Q @ D.mT)

    def measurement(self, me: Measurement, nav: NavState) -> Measurement:
        chart = self.at(nav)
        return me._replace(h=lambda xi: me.h(chart.errors(xi)))

    def errors(self, xi: Array, nav: NavState) -> Array:
        return self.at(nav).errors(xi)

    def gaussian(self, xi: Gaussian, nav: NavState) -> Gaussian:
        mean, J = tangent(self.at(nav).errors, xi.mean, np.zeros_like(xi.mean))
        return Gaussian(mean, J @ xi.cov @ J.mT)

    def reset(self, maps: Maps, before: NavState, after: NavState) -> Maps:
        """xi -> log(Exp(-xi_hat) Exp(xi)) and its Jacobian."""
        a, b = self.at(before), self.at(after)

        def g(xi: Array) -> Array:
            return b.invariant(maps[0](a.errors(xi)))

        return g, lambda xi: tangent(g, xi, np.zeros_like(xi))[1]


class Chart:
    """xi <-> x at an INS's state: ``held`` (..., k, 3), its velocity and, with k = 2, its place in metres from the site."""

    def __init__(self, held: Array) -> None:
        self._held, self._ndim = held, held.ndim - 1

    def errors(self, xi: Array) -> Array:
        """x (..., n) of xi (..., n)."""
        return self._planes(xi, self._errors)

    def invariant(self, x: Array) -> Array:
        """xi (..., n) of x (..., n)."""
        return self._planes(x, self._invariant)

    def slope(self, n: int) -> Array:
        """d xi / d x at zero (..., n, n)."""
        D = np.broadcast_to(np.eye(n), (*self._held.shape[:-2], n, n)).copy()
        for i in range(self._held.shape[-2]):
            D[..., 3 + 3 * i : 6 + 3 * i, :3] = -attitude.skew(self._held[..., i, :])
        return D

    def _planes(self, x: Array, g: Callable[[Array, Array], Array]) -> Array:
        if x.ndim == self._ndim:
            return self._planes(x[..., None, :], g)[..., 0, :]
        n, batch = x.ndim - 1, self._held.ndim - 2
        held = self._held.transpose(batch, batch + 1, *range(batch))[..., None]
        if x.ndim > self._ndim + 1:  # components of a mixture, and points
            held = held[..., None]
        return np.ascontiguousarray(g(x.transpose(n, *range(n)), held).transpose(*range(1, n + 1), 0))

    def _errors(self, X: Array, held: Array) -> Array:
        theta = X[:3]
        a1, a2, a3, _ = coefficients(theta)
        out = X.copy()
        x, y, z = theta
        out[0] = np.arcsin(np.clip(a1 * x + a2 * y * z, -1.0, 1.0))
        out[1] = np.arctan2(a1 * y - a2 * x * z, 1.0 - a2 * (x * x + y * y))
        out[2] = np.arctan2(a1 * z - a2 * x * y, 1.0 - a2 * (x * x + z * z))
        for i, value in enumerate(held):
            rows = slice(3 + 3 * i, 6 + 3 * i)
            eta = turned(theta, X[rows], -a2, a3)
            out[rows] = value - turned(theta, value - eta, a1, a2)  # C' = Exp(theta x)
        return out

    def _invariant(self, X: Array, held: Array) -> Array:
        q = np.moveaxis(attitude.correction_quaternion(np.moveaxis(X[:3], 0, -1)), -1, 0)  # of C'
        q = np.where(q[0] < 0.0, -q, q)
        sine = np.sqrt(np.add.reduce(q[1:] * q[1:], axis=0))
        out = X.copy()
        theta = out[:3]
        theta[:] = q[1:] * np.where(sine > 1e-8, 2.0 * np.arctan2(sine, q[0]) / np.maximum(sine, 1e-8), 2.0)
        a1, a2, _, c = coefficients(theta)
        for i, value in enumerate(held):
            rows = slice(3 + 3 * i, 6 + 3 * i)
            eta = value - turned(theta, value - X[rows], -a1, a2)
            out[rows] = turned(theta, eta, 0.5, c)
        return out


def turned(theta: Array, y: Array, a: Array | float, b: Array) -> Array:
    """y + a theta x y + b theta x (theta x y), components in front."""
    once = cross_planes(theta, y)
    moved: Array = y + a * once + b * cross_planes(theta, once)
    return moved


def coefficients(theta: Array) -> tuple[Array, Array, Array, Array]:
    """sin t / t, (1 - cos t) / t^2, (1 - sin t / t) / t^2 and (1 - (t / 2) cot(t / 2)) / t^2 of t = |theta|, (3, ...)."""
    t2 = np.add.reduce(theta * theta, axis=0)
    t = np.sqrt(t2)
    a1, a2 = np.sinc(t / np.pi), 0.5 * np.sinc(0.5 * t / np.pi) ** 2
    small, safe = t2 < SMALL, np.maximum(t2, SMALL)
    a3 = np.where(small, 1 / 6 - t2 / 120, (1.0 - a1) / safe)
    c = np.where(small, 1 / 12 + t2 / 720, (1.0 - 0.5 * a1 / a2) / safe)
    return a1, a2, a3, c
