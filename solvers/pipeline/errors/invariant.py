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

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.earth import Earth
from sins_env.kernels import kernel
from sins_env.kernels.algebra import (
    add,
    cross3,
    dot,
    from_rotvec,
    mix,
    multiply,
    normalize,
    product,
    put_quaternion,
    put_row,
    quaternion,
    row,
    scale,
    skewed,
    subtract,
    vector,
)
from sins_env.kernels.trigonometry import sincos
from sins_env.states import Layout
from sins_env.types import NavState
from solvers.blocks.mixtures import spread, widen
from solvers.blocks.moments import tangent
from solvers.pipeline.errors.navigation import NavigationMap
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
        return tr._replace(f=Growth(a, tr.f, b), Q=b.spread_noise(tr.Q))

    def measurement(self, me: Measurement, nav: NavState) -> Measurement:
        return me._replace(h=Seen(self.at(nav), me.h))

    def errors(self, xi: Array, nav: NavState) -> Array:
        return self.at(nav).errors(xi)

    def corrected(self, xi: Array, nav: NavState) -> NavState:
        """Return the INS's state (..., ...) without the errors xi (..., n): Exp(-xi) X_hat."""
        held = self.at(nav).held
        q_nb, after = _corrected(nav.q_nb, held, xi)
        pos = nav.pos if held.shape[-2] == 1 else earth.displace(self._model, nav.pos, (after - held)[..., 1, :])
        return NavState(q_nb, after[..., 0, :], pos)

    def gaussian(self, xi: Gaussian, nav: NavState) -> Gaussian:
        chart = self.at(nav)
        J = chart.errors_slope(xi.mean)
        return Gaussian(chart.errors(xi.mean), J @ xi.cov @ J.mT)

    def reset(self, maps: Maps, before: NavState, after: NavState) -> Maps:
        """Return the reset xi -> log(Exp(-xi_hat) Exp(xi)) and its Jacobian."""
        g = Reset(self.at(before), maps[0], self.at(after), self._states)
        return g, g.jacobian


class Through:
    """The function xi -> g(x(xi)), with its Jacobian by the chain rule."""

    def __init__(self, before: Chart, g: Function, after: Chart | None = None) -> None:
        self.before = before  #: coordinates of the argument
        self.g = g
        self.after = after  #: coordinates of the result; None: it is no error, such as a measurement

    def __call__(self, xi: Array) -> Array:
        y = self.g(self.before.errors(xi))
        return y if self.after is None else self.after.invariant(y)

    def jacobian(self, xi: Array) -> Array:
        """Return the Jacobian (..., m, n) at xi (..., n)."""
        x = self.before.errors(xi)
        y, J = tangent(self.before.spread(self.g), x, np.full_like(x, SCALE))
        J = J @ self.before.errors_slope(xi)
        return J if self.after is None else self.after.invariant_slope(y) @ J


class Tangent(Through, ABC):
    """A function that is linear where xi is negligible, as a closed loop keeps it."""

    @cached_property
    @abstractmethod
    def at_zero(self) -> tuple[Array, Array]:
        """Value (..., m) and Jacobian (..., m, n) at zero, in closed form."""

    def __call__(self, xi: Array) -> Array:
        if xi.ndim > self.before.ndim:  # points, or components of a mixture
            return super().__call__(xi)
        y, J = self.at_zero
        near = y + (J @ xi[..., None])[..., 0]
        away = _away(xi)
        return np.where(away[..., None], super().__call__(xi), near) if away.any() else near

    def jacobian(self, xi: Array) -> Array:
        near = self.at_zero[1] if xi.ndim == self.before.ndim else widen(self.at_zero[1])
        away = _away(xi)
        return np.where(away[..., None, None], super().jacobian(xi), near) if away.any() else near


class Growth(Tangent):
    """The growth of xi in an epoch of ``NavigationErrors``."""

    g: NavigationMap
    after: Chart

    @cached_property
    def at_zero(self) -> tuple[Array, Array]:
        F = self.after.multiplied(self.before.divided(self.g.slope()))
        return np.zeros(F.shape[:-1]), F


class Seen(Tangent):
    """What a measurement shows of xi."""

    @cached_property
    def at_zero(self) -> tuple[Array, Array]:
        zero = np.zeros(self.before.shape)
        y, H = tangent(self.g, zero, zero)
        return y, self.before.divided(H)


class Reset(Through):
    """The reset xi -> log(Exp(-xi_hat) Exp(xi)), which ``g`` makes of the model's errors."""

    def __init__(self, before: Chart, g: Function, after: Chart, states: Layout) -> None:
        super().__init__(before, g, after)
        self._states, self._done = states, (np.empty(0), np.empty(0))

    def __call__(self, xi: Array) -> Array:
        if self._done[0] is not xi:  # a filter asks for the Jacobian at the same place
            self._done = xi, super().__call__(xi)
        return self._done[1]

    def jacobian(self, xi: Array) -> Array:
        left = self(xi)
        J, away = right_jacobian(xi, self._states), _away(left)
        if not away.any():
            return J
        return np.where(away[..., None, None], np.linalg.solve(right_jacobian(left, self._states), J), J)


class Chart:
    """The change of coordinates between xi and x at a state of the INS.

    ``held`` (..., k, 3) is the velocity in m/s and, with k = 2, the place in metres from the site. The misalignment and the
    errors of velocity and place, which come first, change. The other states stay as they are.
    """

    def __init__(self, held: Array, states: Layout) -> None:
        self.held, self._size = held, states.size
        self.ndim = held.ndim - 1  #: number of axes of one xi per run
        self.shape = (*held.shape[:-2], states.size)  #: shape of one xi per run
        self._phi, *self._rows = (states[name] for name in ("phi", "dv", "dp")[: 1 + held.shape[-2]])

    def spread(self, g: Function) -> Function:
        """Make ``g`` work for points around the components of a mixture too."""
        return spread(g, self.ndim - 1)

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
        D = np.broadcast_to(np.eye(n), (*self.held.shape[:-2], n, n)).copy()
        for i, rows in enumerate(self._rows):
            D[..., rows, self._phi] = -attitude.skew(self.held[..., i, :])
        return D

    def multiplied(self, F: Array) -> Array:
        """Return D F (..., n, m) for F (..., n, m), with the slope D of these coordinates."""
        return np.asarray(_multiplied(F, self.held))

    def spread_noise(self, Q: Array) -> Array:
        """Return D Q D' (..., n, n) for symmetric Q (..., n, n)."""
        return self.multiplied(self.multiplied(Q).mT)

    def divided(self, F: Array) -> Array:
        """Return F D^-1 (..., m, n) for F (..., m, n), with the slope D of these coordinates."""
        return np.asarray(_divided(F, self.held))

    def _slope(self, g: Function, x: Array, at_zero: Array) -> Array:
        """Return the Jacobian (..., n, n) of g at x; runs with a negligible x get ``at_zero``."""
        away = _away(x)
        if x.ndim == at_zero.ndim:  # components of a mixture
            at_zero = widen(at_zero)
        if not away.any():
            return at_zero
        J = np.broadcast_to(np.eye(x.shape[-1]), (*x.shape, x.shape[-1])).copy()
        changes = slice(self._rows[-1].stop)
        J[..., changes, changes] = tangent(g, x[..., changes], np.full_like(x[..., changes], SCALE))[1]
        return np.where(away[..., None, None], J, at_zero)

    def _planes(self, x: Array, g: Callable[[Array, Array], Array]) -> Array:
        if x.ndim == self.ndim:
            return self._planes(x[..., None, :], g)[..., 0, :]
        n, batch = x.ndim - 1, self.held.ndim - 2
        held = self.held.transpose(batch, batch + 1, *range(batch))[..., None]
        if x.ndim > self.ndim + 1:  # components of a mixture, and points
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


def _away(x: Array) -> Mask:
    """Return whether the errors x (..., n) are more than what rounding leaves, (...)."""
    return np.asarray(np.abs(x).max(axis=-1) > NOTHING)


def right_jacobian(xi: Array, states: Layout) -> Array:
    """Return J (..., n, n) with Exp(xi + d) = Exp(xi) Exp(J d) to first order in d (..., n); biases have the identity.

    J is the sum of A^k / (k + 1)! with A = [theta x, 0; xi_v x, theta x], and the same for a position. A^5 is a combination
    of A and A^3, so four terms are enough. Source: Barfoot & Furgale (2014), doi:10.1109/TRO.2014.2298059.
    """
    J: Array = _right_jacobian(xi, 2 if "dp" in states else 1)
    return J


@kernel("(n),()->(n,n)", "dqd")
def _right_jacobian(xi: Array, rows: int, J: Array) -> None:
    n = len(xi)
    for i in range(n):
        for j in range(n):
            J[i, j] = 1.0 if i == j else 0.0
    theta = vector(xi)
    t2 = dot(theta, theta)
    if t2 != t2:
        J[0, 0] = math.nan
        return
    c1, c2, c3, c4 = 1 / 2, 1 / 6, 1 / 24, 1 / 120  # of A, A^2, A^3, A^4
    if t2 >= SMALL:
        t = math.sqrt(t2)
        s, c = sincos(t)
        c1 = (4.0 - t * s - 4.0 * c) / (2.0 * t2)
        c2 = (4.0 * t - 5.0 * s + t * c) / (2.0 * t2 * t)
        c3 = (2.0 - t * s - 2.0 * c) / (2.0 * t2 * t2)
        c4 = (2.0 * t - 3.0 * s + t * c) / (2.0 * t2 * t2 * t)
    T = skewed(theta)
    T2 = product(T, T)
    turn = mix(c1 - t2 * c3, T, c2 - t2 * c4, T2)  # T^3 = -t^2 T
    for block in range(rows + 1):
        for i in range(3):
            for j in range(3):
                J[3 * block + i, 3 * block + j] += turn[3 * i + j]
    for block in range(1, rows + 1):
        V = skewed((xi[3 * block], xi[3 * block + 1], xi[3 * block + 2]))
        TV, VT = product(T, V), product(V, T)
        TVT, TTVT, TVTT = product(TV, T), product(T2, VT), product(TV, T2)
        third = mix(1.0, mix(1.0, product(T2, V), 1.0, product(V, T2)), 1.0, TVT)
        fourth = mix(1.0, mix(-t2, TV, -t2, VT), 1.0, mix(1.0, TTVT, 1.0, TVTT))
        below = mix(1.0, mix(c1, V, c2, mix(1.0, TV, 1.0, VT)), 1.0, mix(c3, third, c4, fourth))
        for i in range(3):
            for j in range(3):
                J[3 * block + i, j] = below[3 * i + j]


@kernel("(4),(k,3),(n)->(4),(k,3)")
def _corrected(q_nb: Array, held: Array, xi: Array, q: Array, after: Array) -> None:
    """Return the attitude, and the vectors C' (value - eta) of velocity and place, with C' = Exp(theta x) and eta = J xi."""
    theta = vector(xi)
    put_quaternion(normalize(multiply(from_rotvec(theta), quaternion(q_nb))), q)
    t2 = dot(theta, theta)
    a1, a2, a3 = 1.0 - t2 / 6.0, 0.5 - t2 / 24.0, 1 / 6 - t2 / 120.0
    if t2 == t2 and t2 >= SMALL:
        t = math.sqrt(t2)
        s, c = sincos(t)
        a1, a2, a3 = s / t, (1.0 - c) / t2, (t - s) / (t2 * t)
    for i in range(len(held)):
        part = (xi[3 * i + 3], xi[3 * i + 4], xi[3 * i + 5])
        once = cross3(theta, part)
        eta = add(part, add(scale(-a2, once), scale(a3, cross3(theta, once))))
        rest = subtract(row(held, i), eta)
        once = cross3(theta, rest)
        put_row(add(rest, add(scale(a1, once), scale(a2, cross3(theta, once)))), after, i)


@kernel("(n,m),(k,3)->(n,m)")
def _multiplied(F: Array, held: Array, out: Array) -> None:
    for j in range(F.shape[1]):
        for i in range(len(F)):
            out[i, j] = F[i, j]
        for k in range(len(held)):
            change = cross3(row(held, k), (F[0, j], F[1, j], F[2, j]))
            for i in range(3):
                out[3 * k + 3 + i, j] -= change[i]


@kernel("(m,n),(k,3)->(m,n)")
def _divided(F: Array, held: Array, out: Array) -> None:
    for i in range(len(F)):
        for j in range(F.shape[1]):
            out[i, j] = F[i, j]
        for k in range(len(held)):
            f = (F[i, 3 * k + 3], F[i, 3 * k + 4], F[i, 3 * k + 5])
            change = cross3(f, row(held, k))  # f' (held x) = (f x held)'
            for j in range(3):
                out[i, j] += change[j]


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
