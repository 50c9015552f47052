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

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.earth import Earth
from sins_env.kernels import kernel
from sins_env.states import Layout
from sins_env.types import NavState
from solvers.blocks.mixtures import spread, widen
from solvers.blocks.moments import tangent
from solvers.blocks.square_root import some
from solvers.pipeline.errors import group, group_slopes
from solvers.pipeline.errors.group import divide_slope, multiply_slope
from solvers.pipeline.errors.group_slopes import right_jacobian
from solvers.pipeline.errors.navigation import NavigationMap, fill_slope
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Function, Gaussian, Linear, Measurement, Transition

Maps = tuple[Function, Callable[[Array], Array]]  #: a function and its Jacobian

COORDINATES = ("euler", "invariant", "equivariant")
SCALE = 0.1  #: size of errors for the steps of numerical Jacobians: 6e-4 deg, 1e-5 m/s and 1e-5 m
NOTHING = 1e-9  #: size of errors that count as zero for a Jacobian, because rounding leaves them after a reset


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

    def noise(self, M: Array, nav: NavState) -> Array:
        """Return the covariance M (..., n, m) of small errors of the model with anything, in these coordinates."""
        return M

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
        # of the last two states, which an epoch asks for repeatedly
        self._recent: tuple[tuple[NavState, Chart], ...] = ()

    def at(self, nav: NavState) -> Chart:
        """Return the change of coordinates at a state of the INS."""
        recent = self._recent
        if recent and recent[0][0] is nav:
            return recent[0][1]
        if len(recent) > 1 and recent[1][0] is nav:
            return recent[1][1]
        held = nav.vel[..., None, :]
        if "dp" in self._states:
            held = np.stack([nav.vel, earth.offset(self._model, self._site, nav.pos)], axis=-2)
        chart = self.chart(nav, held)
        self._recent = ((nav, chart), *self._recent[:1])
        return chart

    def chart(self, nav: NavState, held: Array) -> Chart:
        """Make the change of coordinates at a state of the INS, with what its group holds of it."""
        return Chart(held, self._states)

    def prior(self, x: Gaussian, nav: NavState) -> Gaussian:
        D = self.at(nav).slope()
        return Gaussian(x.mean, D @ x.cov @ D.mT)

    def transition(self, tr: Transition, before: NavState, after: NavState) -> Transition:
        a, b = self.at(before), self.at(after)
        return Transition(Growth(a, tr.f, b), b.spread_noise(tr.Q), tr.G, tr.dt)

    def measurement(self, me: Measurement, nav: NavState) -> Measurement:
        return Measurement(me.z, Seen(self.at(nav), me.h), me.R, me.law, me.present, me.turns, me.chart)

    def noise(self, M: Array, nav: NavState) -> Array:
        return self.at(nav).slope() @ M

    def errors(self, xi: Array, nav: NavState) -> Array:
        return self.at(nav).errors(xi)

    def corrected(self, xi: Array, nav: NavState) -> NavState:
        """Return the INS's state (..., ...) without the errors xi (..., n): Exp(-xi) X_hat."""
        held = self.at(nav).held
        q_nb, after = group.corrected(nav.q_nb, held, xi)
        pos = nav.pos if held.shape[-2] == 1 else earth.displace(self._model, nav.pos, (after - held)[..., 1, :])
        return NavState(q_nb, after[..., 0, :], pos)

    def gaussian(self, xi: Gaussian, nav: NavState) -> Gaussian:
        chart = self.at(nav)
        x = chart.errors(xi.mean)
        J = chart.errors_slope(xi.mean, x)
        return Gaussian(x, J @ xi.cov @ J.mT)

    def reset(self, maps: Maps, before: NavState, after: NavState) -> Maps:
        """Return the reset xi -> log(Exp(-xi_hat) Exp(xi)) and its Jacobian."""
        g = Reset(self.at(before), maps[0], self.at(after))
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
        return self.value_and_jacobian(xi)[1]

    def value_and_jacobian(self, xi: Array) -> tuple[Array, Array]:
        """Return the value (..., m) and the Jacobian (..., m, n) at xi (..., n)."""
        x = self.before.errors(xi)
        y, J = tangent(self.before.spread(self.g), x, np.full_like(x, SCALE))
        J = J @ self.before.errors_slope(xi, x)
        if self.after is None:
            return y, J
        value = self.after.invariant(y)
        return value, self.after.invariant_slope(value, y) @ J


class Tangent(Through, ABC):
    """A function that is linear where xi is negligible, as a closed loop keeps it."""

    _zero: tuple[Array | float, Array] | None = None

    @property
    def at_zero(self) -> tuple[Array | float, Array]:
        """Value (..., m) and Jacobian (..., m, n) at zero; a value of zero may be a number."""
        if self._zero is None:
            self._zero = self.closed_form()
        return self._zero

    @abstractmethod
    def closed_form(self) -> tuple[Array | float, Array]:
        """Return value and Jacobian at zero."""

    def __call__(self, xi: Array) -> Array:
        if xi.ndim > self.before.ndim:  # points, or components of a mixture
            return super().__call__(xi)
        near, far = self._near(xi), away(xi)
        return np.where(far[..., None], super().__call__(xi), near) if some(far) else near

    def value_and_jacobian(self, xi: Array) -> tuple[Array, Array]:
        far, mixture = away(xi), xi.ndim > self.before.ndim
        near = widen(self.at_zero[1]) if mixture else self.at_zero[1]
        if not some(far):
            return self(xi) if mixture else self._near(xi), near
        y, J = super().value_and_jacobian(xi)
        J = np.where(far[..., None, None], J, near)
        return y if mixture else np.where(far[..., None], y, self._near(xi)), J

    def _near(self, xi: Array) -> Array:
        """Return the value (..., m) at a negligible xi (..., n)."""
        y, J = self.at_zero
        change: Array = np.matmul(J, xi[..., None])[..., 0]
        return change if isinstance(y, float) else y + change


class Growth(Tangent):
    """The growth of xi in an epoch of ``NavigationErrors``."""

    g: NavigationMap
    after: Chart

    def closed_form(self) -> tuple[float, Array]:
        F = self.after.growth(self.before, self.g.motion)
        carry = self.g.carry
        if carry is not None:  # the rows of parameters are those of the identity
            F[..., -len(carry) :, -len(carry) :] = carry
        return 0.0, F


class Seen(Tangent):
    """What a measurement shows of xi."""

    def closed_form(self) -> tuple[Array | float, Array]:
        if isinstance(self.g, Linear):
            offset = 0.0 if self.g.offset is None else self.g.offset
            return offset, self.before.divided(self.g.matrix)
        zero = np.zeros(self.before.shape)
        y, H = tangent(self.g, zero, zero)
        return y, self.before.divided(H)


class Reset(Through):
    """The reset xi -> log(Exp(-xi_hat) Exp(xi)), which ``g`` makes of the model's errors."""

    def __init__(self, before: Chart, g: Function, after: Chart) -> None:
        super().__init__(before, g, after)
        self._done: tuple[Array, Array] | None = None

    def __call__(self, xi: Array) -> Array:
        if self._done is None or self._done[0] is not xi:  # a filter asks for the Jacobian at the same place
            self._done = xi, super().__call__(xi)
        return self._done[1]

    def value_and_jacobian(self, xi: Array) -> tuple[Array, Array]:
        left = self(xi)
        J, far = self.before.right_jacobian(xi), away(left)
        if not some(far):
            return left, J
        return left, np.where(far[..., None, None], np.linalg.solve(self.before.right_jacobian(left), J), J)


@kernel("(3,3),(3),(3),(3),(3),(3,3),(),(),(e),(h,3),(h,3)->(e,e)")
def _growth(
    C: Array, force: Array, vel: Array, rate_ie: Array, rate_en: Array, transport: Array, gravity_slope: float,
    h: float, xi: Array, before: Array, after: Array, F: Array,
) -> None:  # fmt: skip
    fill_slope(C, force, vel, rate_ie, rate_en, transport, gravity_slope, h, len(after) == 2, F)
    divide_slope(F, before)
    multiply_slope(F, after)


class Chart:
    """The change of coordinates between xi and x at a state of the INS.

    ``held`` (..., k, 3) is the velocity in m/s and, with k = 2, the place in metres from the site. The misalignment and the
    errors of velocity and place, which come first, change. The other states stay as they are.
    """

    def __init__(self, held: Array, states: Layout) -> None:
        self.held, self._states = held, states
        self.ndim = held.ndim - 1  #: number of axes of one xi per run
        self._known: tuple[Array, Array] | None = None  # the last xi and its errors, for which feedback asks again

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one xi per run."""
        return *self.held.shape[:-2], self._states.size

    def spread(self, g: Function) -> Function:
        """Make ``g`` work for points around the components of a mixture too."""
        return spread(g, self.ndim - 1)

    def errors(self, xi: Array) -> Array:
        """Return x (..., n) for xi (..., n)."""
        if self._known is None or self._known[0] is not xi:
            self._known = xi, np.asarray(group.errors(xi, self._held(xi)))
        return self._known[1]

    def invariant(self, x: Array) -> Array:
        """Return xi (..., n) for x (..., n)."""
        return np.asarray(group.logarithm(x, self._held(x)))

    def errors_slope(self, xi: Array, x: Array) -> Array:
        """Return d x / d xi (..., n, n) at xi (..., n) and its errors x (..., n)."""
        return np.asarray(group_slopes.errors_slope(xi, x, self._held(x)))

    def invariant_slope(self, xi: Array, x: Array) -> Array:
        """Return d xi / d x (..., n, n) at xi (..., n) and its errors x (..., n)."""
        return np.asarray(group_slopes.logarithm_slope(xi, x, self._held(x)))

    def slope(self) -> Array:
        """Return d xi / d x at zero (..., n, n)."""
        n, phi = self._states.size, self._states["phi"]
        D = np.broadcast_to(np.eye(n), (*self.held.shape[:-2], n, n)).copy()
        for i, name in enumerate(("dv", "dp")[: self.held.shape[-2]]):
            D[..., self._states[name], phi] = -attitude.skew(self.held[..., i, :])
        return D

    def growth(self, before: Chart, m: EpochMotion) -> Array:
        """Return the Jacobian (..., n, n) of xi at zero over an epoch, from the coordinates ``before`` to these: D1 F D0^-1."""
        si = self._states.si
        F: Array = _growth(
            m.C, m.dvel_n, m.vel, m.rate_ie, m.rate_en, m.transport, m.gravity_slope, m.dt, si, before.held, self.held
        )
        return F

    def right_jacobian(self, xi: Array) -> Array:
        """Return J (..., n, n) with Exp(xi + d) = Exp(xi) Exp(J d) to first order in d (..., n)."""
        return right_jacobian(xi, self._states)

    def divided(self, H: Array) -> Array:
        """Return H D^-1 (..., m, n) for H (..., m, n), with the slope D of these coordinates."""
        return np.asarray(group.divided(H, self.held))

    def spread_noise(self, Q: Array) -> Array:
        """Return D Q D' (..., n, n) for symmetric Q (..., n, n), with the slope D of these coordinates."""
        return np.asarray(group.spread_noise(Q, self.held))

    def _held(self, x: Array) -> Array:
        """Return the vectors for points or components x (..., n), with axes of one for these."""
        if x.ndim == self.ndim:
            return self.held
        return self.held.reshape(*self.held.shape[:-2], *(1,) * (x.ndim - self.ndim), *self.held.shape[-2:])


@kernel("(n)->()", "d?")
def away(x: Array, far: Mask) -> None:
    """Return whether the errors x (..., n) are more than what rounding leaves, (...); NaN is not."""
    far[0] = False
    for i in range(len(x)):
        if x[i] != x[i]:
            return
    for i in range(len(x)):
        far[0] = far[0] or abs(x[i]) > NOTHING
