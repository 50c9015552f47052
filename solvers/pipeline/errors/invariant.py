"""Coordinates of the errors: as the error model has them, or right-invariant on SE_2(3).

The INS's state X_hat and the true state X are (C, v, p). Their right-invariant error is Exp(xi) = X_hat X^-1:

    Exp(-theta x) = C_n^c(phi),   eta_v = v_hat - C_n^c v = J xi_v,   eta_p = p_hat - C_n^c p = J xi_p

Here v = v_hat - dv, p = p_hat - dp is in metres from the site, and J is the left Jacobian of SO(3) at -theta. Biases stay as
they are. A filter on xi sees the error model through this change of coordinates, at the INS's state of each epoch. Feedback into
the INS is the exact error of the estimate. On a flat earth at rest, without biases, an epoch is xi -> A xi exactly, and A does
not depend on the motion.
Source: Barrau & Bonnabel (2017), theorem 2, doi:10.1109/TAC.2016.2594085;
docs/mathematics/error_models.md#invariant-coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.earth import Earth
from sins_env.states import Layout
from sins_env.types import NavState
from solvers.blocks.mixtures import spread, widen
from solvers.blocks.moments import tangent
from solvers.types import Function, Gaussian, Measurement, Transition

Maps = tuple[Function, Callable[[Array], Array]]  #: a function and its Jacobian

COORDINATES = ("euler", "invariant")
SCALE = 0.1  #: size of errors for the steps of numerical Jacobians: 6e-4 deg, 1e-5 m/s and 1e-5 m
NOTHING = 1e-9  #: size of errors that count as zero for a Jacobian, because rounding leaves them after a reset
SMALL = 1e-4  #: squared angle below which series are used


class Euler:
    """The errors of the model, with the misalignment as Euler angles: every method returns its argument unchanged."""

    def prior(self, x: Gaussian, nav: NavState) -> Gaussian:
        """Return the prior in these coordinates."""
        return x

    def transition(self, tr: Transition, before: NavState, after: NavState) -> Transition:
        """Return a transition in these coordinates, with the INS's states before and after the epoch."""
        return tr

    def measurement(self, me: Measurement, nav: NavState) -> Measurement:
        """Return a measurement of the errors in these coordinates."""
        return me

    def errors(self, xi: Array, nav: NavState) -> Array:
        """Return the model's errors (..., n) for an estimate xi (..., n) of the filter."""
        return xi

    def gaussian(self, xi: Gaussian, nav: NavState) -> Gaussian:
        """Return mean and covariance of the model's errors for an estimate of the filter."""
        return xi

    def reset(self, maps: Maps, before: NavState, after: NavState) -> Maps:
        """Return a reset and its Jacobian in these coordinates, with the INS's states before and after it."""
        return maps


class Invariant(Euler):
    """Right-invariant errors of the model ``NavigationErrors``, with its layout ``states``."""

    def __init__(self, model: Earth, site_pos: Array, states: Layout) -> None:
        self._model, self._site, self._states = model, np.asarray(site_pos), states

    def at(self, nav: NavState) -> Chart:
        """Return the change of coordinates at a state of the INS."""
        if "dp" not in self._states:
            return Chart(nav.vel[..., None, :], self._states)
        return Chart(np.stack([nav.vel, earth.offset(self._model, self._site, nav.pos)], axis=-2), self._states)

    def prior(self, x: Gaussian, nav: NavState) -> Gaussian:
        D = self.at(nav).slope()
        return Gaussian(x.mean, D @ x.cov @ D.mT)

    def transition(self, tr: Transition, before: NavState, after: NavState) -> Transition:
        a, b = self.at(before), self.at(after)
        D = b.slope()
        return tr._replace(f=Through(a, tr.f, b), Q=D @ tr.Q @ D.mT)

    def measurement(self, me: Measurement, nav: NavState) -> Measurement:
        return me._replace(h=Through(self.at(nav), me.h))

    def errors(self, xi: Array, nav: NavState) -> Array:
        return self.at(nav).errors(xi)

    def gaussian(self, xi: Gaussian, nav: NavState) -> Gaussian:
        chart = self.at(nav)
        J = chart.errors_slope(xi.mean)
        return Gaussian(chart.errors(xi.mean), J @ xi.cov @ J.mT)

    def reset(self, maps: Maps, before: NavState, after: NavState) -> Maps:
        """Return the reset xi -> log(Exp(-xi_hat) Exp(xi)) and its Jacobian."""
        g = Through(self.at(before), Jacobian(*maps), self.at(after))
        return g, g.jacobian


@dataclass(frozen=True)
class Jacobian:
    """A function with its Jacobian."""

    g: Function
    jacobian: Callable[[Array], Array]

    def __call__(self, x: Array) -> Array:
        return self.g(x)


@dataclass(frozen=True)
class Through:
    """The function xi -> g(x(xi)), with its Jacobian by the chain rule."""

    before: Chart  #: coordinates of the argument
    g: Function
    after: Chart | None = None  #: coordinates of the result; None: it is no error, such as a measurement

    def __call__(self, xi: Array) -> Array:
        y = self.g(self.before.errors(xi))
        return y if self.after is None else self.after.invariant(y)

    def jacobian(self, xi: Array) -> Array:
        """Return the Jacobian (..., m, n) at xi (..., n)."""
        x = self.before.errors(xi)
        y, J = tangent(self.before.spread(self.g), x, np.full_like(x, SCALE))
        J = J @ self.before.errors_slope(xi)
        return J if self.after is None else self.after.invariant_slope(y) @ J


class Chart:
    """The change of coordinates between xi and x at a state of the INS.

    ``held`` (..., k, 3) is the velocity in m/s and, with k = 2, the place in metres from the site. The misalignment and the
    errors of velocity and place, which come first, change. The other states stay as they are.
    """

    def __init__(self, held: Array, states: Layout) -> None:
        self._held, self._ndim, self._size = held, held.ndim - 1, states.size
        self._phi, *self._rows = (states[name] for name in ("phi", "dv", "dp")[: 1 + held.shape[-2]])

    def spread(self, g: Function) -> Function:
        """Make ``g`` work for points around the components of a mixture too."""
        return spread(g, self._ndim - 1)

    def errors(self, xi: Array) -> Array:
        """Return x (..., n) for xi (..., n)."""
        return self._planes(xi, self._errors)

    def invariant(self, x: Array) -> Array:
        """Return xi (..., n) for x (..., n)."""
        return self._planes(x, self._invariant)

    def errors_slope(self, xi: Array) -> Array:
        """Return d x / d xi (..., n, n), in closed form at zero, where a closed loop keeps the errors."""
        return self._slope(self.errors, xi, 2.0 * np.eye(self._size) - self.slope())  # (I + N)^-1 = I - N

    def invariant_slope(self, x: Array) -> Array:
        """Return d xi / d x (..., n, n)."""
        return self._slope(self.invariant, x, self.slope())

    def slope(self) -> Array:
        """Return d xi / d x at zero (..., n, n)."""
        n = self._size
        D = np.broadcast_to(np.eye(n), (*self._held.shape[:-2], n, n)).copy()
        for i, rows in enumerate(self._rows):
            D[..., rows, self._phi] = -attitude.skew(self._held[..., i, :])
        return D

    def _slope(self, g: Function, x: Array, at_zero: Array) -> Array:
        """Return the Jacobian (..., n, n) of g at x; runs with a negligible x get ``at_zero``."""
        away = np.abs(x).max(axis=-1) > NOTHING
        if x.ndim == at_zero.ndim:  # components of a mixture
            at_zero = widen(at_zero)
        if not away.any():
            return at_zero
        J = np.broadcast_to(np.eye(x.shape[-1]), (*x.shape, x.shape[-1])).copy()
        changes = slice(self._rows[-1].stop)
        J[..., changes, changes] = tangent(g, x[..., changes], np.full_like(x[..., changes], SCALE))[1]
        return np.where(away[..., None, None], J, at_zero)

    def _planes(self, x: Array, g: Callable[[Array, Array], Array]) -> Array:
        if x.ndim == self._ndim:
            return self._planes(x[..., None, :], g)[..., 0, :]
        n, batch = x.ndim - 1, self._held.ndim - 2
        held = self._held.transpose(batch, batch + 1, *range(batch))[..., None]
        if x.ndim > self._ndim + 1:  # components of a mixture, and points
            held = held[..., None]
        return np.ascontiguousarray(g(x.transpose(n, *range(n)), held).transpose(*range(1, n + 1), 0))

    def _errors(self, X: Array, held: Array) -> Array:
        theta = X[self._phi]
        a1, a2, a3, _ = coefficients(theta)
        out = X.copy()
        x, y, z = theta
        phi = out[self._phi]
        phi[0] = np.arcsin(np.clip(a1 * x + a2 * y * z, -1.0, 1.0))
        phi[1] = np.arctan2(a1 * y - a2 * x * z, 1.0 - a2 * (x * x + y * y))
        phi[2] = np.arctan2(a1 * z - a2 * x * y, 1.0 - a2 * (x * x + z * z))
        for rows, value in zip(self._rows, held, strict=True):
            eta = turned(theta, X[rows], -a2, a3)
            out[rows] = value - turned(theta, value - eta, a1, a2)  # C' = Exp(theta x)
        return out

    def _invariant(self, X: Array, held: Array) -> Array:
        q = np.moveaxis(attitude.correction_quaternion(np.moveaxis(X[self._phi], 0, -1)), -1, 0)  # of C'
        q = np.where(q[0] < 0.0, -q, q)
        sine = np.sqrt(np.add.reduce(q[1:] * q[1:], axis=0))
        out = X.copy()
        theta = out[self._phi]
        theta[:] = q[1:] * np.where(sine > 1e-8, 2.0 * np.arctan2(sine, q[0]) / np.maximum(sine, 1e-8), 2.0)
        a1, a2, _, c = coefficients(theta)
        for rows, value in zip(self._rows, held, strict=True):
            eta = value - turned(theta, value - X[rows], -a1, a2)
            out[rows] = turned(theta, eta, 0.5, c)
        return out


def turned(theta: Array, y: Array, a: Array | float, b: Array) -> Array:
    """Return y + a theta x y + b theta x (theta x y) for theta and y (3, ...)."""
    once = attitude.cross_planes(theta, y)
    moved: Array = y + a * once + b * attitude.cross_planes(theta, once)
    return moved


def coefficients(theta: Array) -> tuple[Array, Array, Array, Array]:
    """Return sin t / t, (1 - cos t) / t^2, (1 - sin t / t) / t^2 and (1 - (t / 2) cot(t / 2)) / t^2 with t = |theta|.

    ``theta`` is (3, ...) in rad.
    """
    t2 = np.add.reduce(theta * theta, axis=0)
    t = np.sqrt(t2)
    a1, a2 = np.sinc(t / np.pi), 0.5 * np.sinc(0.5 * t / np.pi) ** 2
    small, safe = t2 < SMALL, np.maximum(t2, SMALL)
    a3 = np.where(small, 1 / 6 - t2 / 120, (1.0 - a1) / safe)
    c = np.where(small, 1 / 12 + t2 / 720, (1.0 - 0.5 * a1 / a2) / safe)
    return a1, a2, a3, c
