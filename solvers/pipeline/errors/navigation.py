"""The 15-state error model of navigation: misalignment of any size, velocity, position and biases.

    x = [phi_E, phi_N, phi_U,  dv_E, dv_N, dv_U,  dp_E, dp_N, dp_U,  eps_x, eps_y, eps_z,  nabla_x, nabla_y, nabla_z]
         rad                   m/s                m                  deg/h                 mg (1e-3 g)

The order is that of :data:`sins_env.states.ERRORS`. Quantities with a hat are the INS's, and C = C_n^c(phi):

    phi' = C_w^-1 [(I - C) omega_in + C d_omega_in - C_hat eps]
    dv'  = (I - C') f + C' C_hat nabla - (2 omega_ie + omega_en) x dv - (2 d_omega_ie + d_omega_en) x (v - dv) + d_g
    dp'  = dv + K dp,   d_omega_in = T dv + W dp

Here dp = (dlambda (R_N + h) cos L, dL (R_M + h), dh), with radii and latitude at the INS's place. K and W hold the curvature of
the earth, with the true velocity v - dv. The source has the computed velocity v. The difference counts only in open loop, after
kilometres of position error. ``position=False`` leaves out dp for a base that does not travel, which makes 12 states.
Source: 001 (5a), (5b), corrected; docs/mathematics/error_models.md#navigation-model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.earth import FREE_AIR, Earth
from sins_env.kernels import kernel
from sins_env.kernels.algebra import add, add_skew, cross3, scale, vector
from sins_env.prior import Prior
from sins_env.states import ERRORS, Block, Layout
from sins_env.types import NavState
from solvers.pipeline import feedback
from solvers.pipeline.errors.model import ACCEL_UNIT, GYRO_UNIT, EpochMap, ErrorModel, front, total, turn_euler
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Transition

STATES = Layout(
    (
        *ERRORS.only("phi", "dv", "dp").blocks,
        Block("gyro_bias", 3, "deg/h", GYRO_UNIT),
        Block("accel_bias", 3, "mg", ACCEL_UNIT),
    )
)
WITHOUT_POSITION = STATES.without("dp")
PHI, DV, DP = (STATES[name] for name in ("phi", "dv", "dp"))


class NavigationMap(EpochMap):
    """The map of fifteen errors, or of twelve without position, and of the parameters of aids."""

    def __init__(self, motion: EpochMotion, states: Layout) -> None:
        super().__init__(motion, motion.C)
        self._motion, self._states = motion, states
        self._h, self._position = motion.dt, "dp" in states
        self._eps, self._nabla = states["gyro_bias"], states["accel_bias"]
        self._coriolis = front(motion.dt * (2 * motion.rate_ie + motion.rate_en))
        self._vel = front(motion.vel)
        if self._position:
            self._place(motion)

    def _place(self, motion: EpochMotion) -> None:
        """Set what a position error of a metre changes: omega_ie, gravity, and, by the earth's curvature, omega_en and dp."""
        h, vN, vU = motion.dt, self._vel[1], self._vel[2]
        T = front(motion.transport, 2, self._ndim)
        self._curve = E, N = np.stack([T[1, 0], -T[0, 1]])  # 1 / (R_N + h), 1 / (R_M + h)
        self._tan = tan = T[2, 0] / E
        rate_ie = front(motion.rate_ie, 1, self._ndim)
        self._ie = h * N * np.stack([-rate_ie[2], rate_ie[1]])
        self._gravity_north = -h * N * front(motion.gravity_slope[..., None], 1, self._ndim)[0]
        self._scale = h * np.stack([vU * E - vN * N * tan, vU * N])  # change of scale of dp as the INS moves

    def advance(self, X: Array) -> Array:
        phi, dv, eps, nabla = X[PHI], X[DV], X[self._eps], X[self._nabla]
        C, s, c = attitude.misalignment_rows(phi)
        u = self.force - total(self.accel * nabla, axis=1)
        gain = self.force - total(C * u[:, None], axis=0)  # (I - C') f + C' C_hat nabla, C at the start
        v = dv + 0.5 * gain  # mid-epoch
        d_in = total(self.transport * v[:2], axis=1)
        d_coriolis, true = d_in, self._vel - v
        out = np.empty(X.shape)
        if self._position:
            p = X[DP] + 0.5 * self._h * dv
            turn, shift = self._curved(true, p)
            d_ie = self._ie * p[1]
            d_in += turn
            d_coriolis = d_in.copy()
            d_in[1:] += d_ie
            d_coriolis[1:] += 2 * d_ie
            gain[2] += self._gravity_north * p[1] + (self._h * earth.FREE_AIR) * p[2]
        r = self.rotation(C, self.turn - d_in, eps)
        turn_euler(phi, r, s, c, out=out[PHI])
        gain -= self.turned_force(C, r)
        gain -= attitude.cross_planes(self._coriolis, v)
        gain -= attitude.cross_planes(d_coriolis, true)
        np.add(dv, gain, out=out[DV])
        if self._position:
            np.add(X[DP], self._h * (dv + 0.5 * gain), out=out[DP])
            out[DP][:2] += shift
        constant = slice(self._eps.start, None)  # biases, and parameters of aids
        out[constant] = X[constant]
        return out

    def _curved(self, v: Array, p: Array) -> tuple[Array, Array]:
        """Return the changes by a position error p: of the rotation omega_en of the epoch (3, ...), and of dp (2, ...)."""
        E, N = self._curve
        east, north = (self._h * self._curve) * v[:2]  # angles flown
        drop, lead = E * p[2], self._tan * N * p[1]
        turn = np.empty(v.shape)
        turn[0] = north * N * p[2]
        turn[1] = -east * drop
        turn[2] = east * ((1.0 + self._tan * self._tan) * N * p[1] - self._tan * drop)
        shift = self._scale * p[:2]
        shift[0] += east * (lead / E - p[2])
        shift[1] -= north * p[2]
        return turn, shift

    def slope(self) -> Array:
        """Return the Jacobian (..., n, n) of the map at zero errors."""
        return slope(self._motion, self._states)


def slope(m: EpochMotion, states: Layout) -> Array:
    """Return the Jacobian (..., n, n) of the map of an epoch at zero errors: ``NavigationMap.advance`` to first order."""
    F: Array = _slope(
        m.C, m.dvel_n, m.vel, m.rate_ie, m.rate_en, m.transport, m.gravity_slope, m.dt, "dp" in states, states.si
    )
    return F


@kernel("(3,3),(3),(3),(3),(3),(3,3),(),(),(),(e)->(e,e)", "dddddddd?dd")
def _slope(
    C: Array, force: Array, vel: Array, rate_ie: Array, rate_en: Array, transport: Array, gravity_slope: float,
    h: float, position: bool, si: Array, F: Array,
) -> None:  # fmt: skip
    n, eps = len(si), 9 if position else 6
    nabla = eps + 3
    # rows of the velocity at mid-epoch, of d_omega in the Coriolis terms, of r, and of the gain of velocity
    v, d_coriolis, r, gain = np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, n))
    f, u = vector(force), vector(vel)
    add_skew(0.5, f, v, 0)
    add_skew(1.0, f, gain, 0)
    for i in range(3):
        v[i, 3 + i] = 1.0
        for j in range(3):
            v[i, nabla + j] = 0.5 * h * ACCEL_UNIT * C[i, j]
            gain[i, nabla + j] = h * ACCEL_UNIT * C[i, j]
    for i in range(3):
        for j in range(n):
            d_coriolis[i, j] = h * (transport[i, 0] * v[0, j] + transport[i, 1] * v[1, j])
            r[i, j] = d_coriolis[i, j]
        for j in range(3):
            r[i, eps + j] -= h * GYRO_UNIT * C[i, j]
    add_skew(-h, add(vector(rate_ie), vector(rate_en)), r, 0)
    for i in range(n):
        for j in range(n):
            F[i, j] = 1.0 if i == j else 0.0
    if position:
        E, N = transport[1, 0], -transport[0, 1]  # 1 / (R_N + h), 1 / (R_M + h)
        tan, east, north = transport[2, 0] / E, h * E * u[0], h * N * u[1]
        for k in range(6):
            j = 3 + k  # a velocity error moves the position at mid-epoch by half an epoch
            w = 0.5 * h if k < 3 else 1.0
            if k % 3 == 0:
                F[6, j] += w * h * (u[2] * E - u[1] * N * tan)
            elif k % 3 == 1:
                ie = (-h * N * rate_ie[2], h * N * rate_ie[1])
                turn = east * (1.0 + tan * tan) * N
                d_coriolis[1, j] += w * 2.0 * ie[0]
                d_coriolis[2, j] += w * (2.0 * ie[1] + turn)
                r[1, j] += w * ie[0]
                r[2, j] += w * (ie[1] + turn)
                gain[2, j] -= w * h * N * gravity_slope
                F[6, j] += w * east * tan * N / E
                F[7, j] += w * h * u[2] * N
            else:
                lever = (north * N, -east * E, -east * tan * E)
                for i in range(3):
                    d_coriolis[i, j] += w * lever[i]
                    r[i, j] += w * lever[i]
                gain[2, j] += w * h * FREE_AIR
                F[6, j] -= w * east
                F[7, j] -= w * north
    coriolis = scale(-h, add(scale(2.0, vector(rate_ie)), vector(rate_en)))
    for j in range(n):
        more = cross3(scale(0.5, f), (r[0, j], r[1, j], r[2, j]))
        more = add(more, cross3(coriolis, (v[0, j], v[1, j], v[2, j])))
        more = add(more, cross3(u, (d_coriolis[0, j], d_coriolis[1, j], d_coriolis[2, j])))
        for i in range(3):
            gain[i, j] += more[i]
    for i in range(3):
        for j in range(n):
            F[i, j] += r[i, j]
            F[3 + i, j] += gain[i, j]
            if position:
                F[6 + i, j] += 0.5 * h * gain[i, j]
        if position:
            F[6 + i, 3 + i] += h


@dataclass(frozen=True)
class NavigationErrors(ErrorModel):
    """The settings of the model, which makes transitions for a filter from epochs."""

    position: bool = True  #: whether the position errors dp are states

    @property
    def core(self) -> Layout:  # type: ignore[override]
        return STATES if self.position else WITHOUT_POSITION

    @property
    def fed(self) -> tuple[str, ...]:  # type: ignore[override]
        return self.core.without("phi").names

    def noise(self, prior: Prior) -> Array:
        """Return Q (n, n) of one epoch; white acceleration of density q gives dv and dp q [T, T^2/2; T^2/2, T^3/3]."""
        Q, T, dv, dp = prior.Q.copy(), prior.epoch_s, ERRORS["dv"], ERRORS["dp"]
        Q[dv, dp] = Q[dp, dv] = 0.5 * T * prior.Q[dv, dv]
        Q[dp, dp] = T * T / 3 * prior.Q[dv, dv]
        return self._told(Q)

    def transition(self, motion: EpochMotion, Q: Array) -> Transition:
        return Transition(NavigationMap(motion, self.states), Q, None, motion.dt)

    def corrected(self, model: Earth, nav: NavState, x: Array) -> NavState:
        pos = earth.displace(model, nav.pos, -x[..., DP]) if self.position else nav.pos
        return NavState(feedback.corrected(nav.q_nb, x[..., PHI]), nav.vel - x[..., DV], pos)

    def biases(self, x: Array) -> tuple[Array, Array]:
        return x[..., self.states["gyro_bias"]] * GYRO_UNIT, x[..., self.states["accel_bias"]] * ACCEL_UNIT
