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

from sins_env import earth
from sins_env.arrays import Array
from sins_env.earth import FREE_AIR, Earth
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    add,
    add_skew,
    correction,
    cross3,
    matrix,
    misaligned,
    mix,
    multiply,
    put_quaternion,
    put_vector,
    quaternion,
    scale,
    sincos3,
    subtract,
    transpose,
    turn,
    unturned,
    vector,
)
from sins_env.prior import Prior
from sins_env.states import ERRORS, Block, Layout
from sins_env.types import NavState
from solvers.pipeline.errors.model import ACCEL_UNIT, GYRO_UNIT, ErrorModel, carried
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


@kernel("(p,e),(3,3),(3),(3),(3),(3),(3,3),(),(),()->(p,e)", "ddddddddd?d")
def _advance(
    x: Array, mean_C: Array, dvel_n: Array, vel: Array, rate_ie: Array, rate_en: Array, transport: Array,
    gravity_slope: float, h: float, position: bool, out: Array,
) -> None:  # fmt: skip
    points, n = x.shape
    changing = 9 if position else 6  # the states behind them are constant
    X = np.zeros((15, points))  # components in rows, which makes vector code; without position dp stays zero
    for j in range(changing):
        for i in range(points):
            X[j, i] = x[i, j]
    for j in range(6):
        for i in range(points):
            X[9 + j, i] = x[i, changing + j]
    force, speed, C_hat = vector(dvel_n), vector(vel), matrix(mean_C)
    T = mix(h, matrix(transport), 0.0, C_hat)
    accel, gyro = mix(h * ACCEL_UNIT, C_hat, 0.0, T), mix(h * GYRO_UNIT, C_hat, 0.0, T)
    turning = scale(h, add(vector(rate_ie), vector(rate_en)))
    coriolis = scale(h, add(scale(2.0, vector(rate_ie)), vector(rate_en)))
    middle = 0.5 * h if position else 0.0
    # what a position error of a metre changes: omega_ie, gravity, and, by the earth's curvature, omega_en and dp
    E, N = transport[1, 0], -transport[0, 1]  # 1 / (R_N + h), 1 / (R_M + h)
    tan = transport[2, 0] / E
    ie_N, ie_U, gravity_N = -h * N * rate_ie[2], h * N * rate_ie[1], -h * N * gravity_slope
    scale_E, scale_N = h * (speed[2] * E - speed[1] * N * tan), h * speed[2] * N  # of dp as the INS moves
    for i in range(points):
        phi, dv = (X[0, i], X[1, i], X[2, i]), (X[3, i], X[4, i], X[5, i])
        eps, nabla = (X[9, i], X[10, i], X[11, i]), (X[12, i], X[13, i], X[14, i])
        s, c = sincos3(phi)
        C = misaligned(s, c)
        back = transpose(C)
        # (I - C') f + C' C_hat nabla, C at the start
        gain = subtract(force, turn(back, subtract(force, turn(accel, nabla))))
        v = add(dv, scale(0.5, gain))  # mid-epoch
        p_E, p_N, p_U = X[6, i] + middle * dv[0], X[7, i] + middle * dv[1], X[8, i] + middle * dv[2]
        true = subtract(speed, v)
        east, north = h * E * true[0], h * N * true[1]  # angles flown
        drop, lead = E * p_U, tan * N * p_N
        d_en = turn(T, v)
        d_en = add(d_en, (north * N * p_U, -east * drop, east * ((1.0 + tan * tan) * N * p_N - tan * drop)))
        d_ie = 0.0, ie_N * p_N, ie_U * p_N
        w = subtract(turning, add(d_en, d_ie))
        r = subtract(subtract(turning, turn(C, w)), turn(gyro, eps))  # rotation of c against n in the epoch
        change = scale(0.5, cross3(r, force))  # (C_mid - C)' f, with nabla neglected beside f
        gain = subtract(gain, turn(back, change))
        gain = subtract(gain, add(cross3(coriolis, v), cross3(add(d_en, scale(2.0, d_ie)), true)))
        gain = add(gain, (0.0, 0.0, gravity_N * p_N + h * FREE_AIR * p_U))
        X[0, i], X[1, i], X[2, i] = add(phi, unturned(s, c, r))
        X[3, i], X[4, i], X[5, i] = add(dv, gain)
        X[6, i] += h * (dv[0] + 0.5 * gain[0]) + scale_E * p_E + east * (lead / E - p_U)
        X[7, i] += h * (dv[1] + 0.5 * gain[1]) + scale_N * p_N - north * p_U
        X[8, i] += h * (dv[2] + 0.5 * gain[2])
    for j in range(changing):
        for i in range(points):
            out[i, j] = X[j, i]
    for j in range(changing, n):
        for i in range(points):
            out[i, j] = x[i, j]


class NavigationMap:
    """The map from errors x to those after the epoch, for (*batch, n) and, with sigma points, (*batch, points, n).

    The errors are fifteen, or twelve without position. The parameters of aids, which follow them, go through
    an epoch by the matrix ``carry`` (k, k); without one they are constant.
    """

    temporaries = 0  #: number of arrays of the size of x that a call makes beside its result

    def __init__(self, motion: EpochMotion, states: Layout, carry: Array | None = None) -> None:
        self.motion, self.carry = motion, carry
        self._ndim, self._position = motion.dvel_n.ndim, "dp" in states

    def __call__(self, x: Array) -> Array:
        if x.ndim == self._ndim:
            return self(x[..., None, :])[..., 0, :]
        m = self.motion
        out: Array = _advance(
            x, m.C, m.dvel_n, m.vel, m.rate_ie, m.rate_en, m.transport, m.gravity_slope, m.dt, self._position
        )
        return carried(out, self.carry)


@helper
def fill_slope(
    C: Array, force: Array, vel: Array, rate_ie: Array, rate_en: Array, transport: Array, gravity_slope: float,
    h: float, position: bool, F: Array,
) -> None:  # fmt: skip
    """Fill F (n, n) with the Jacobian of the map of an epoch at zero errors: ``_advance`` to first order."""
    n, eps = len(F), 9 if position else 6
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
        return (*self.core.without("phi").names, *self.fed_parameters)

    def noise(self, prior: Prior) -> Array:
        """Return Q (n, n) of one epoch; white acceleration of density q gives dv and dp q [T, T^2/2; T^2/2, T^3/3]."""
        return self._told(self._integrated(prior.Q.copy(), prior.epoch_s), self._added(prior.epoch_s))

    def _integrated(self, Q: Array, epoch_s: float) -> Array:
        T, first, dv, dp = epoch_s, slice(ERRORS["dp"].start), ERRORS["dv"], ERRORS["dp"]
        Q[..., first, dp] = 0.5 * T * Q[..., first, dv]
        Q[..., dp, first] = 0.5 * T * Q[..., dv, first]
        Q[..., dp, dp] = T * T / 3 * Q[..., dv, dv]
        return Q

    def transition(self, motion: EpochMotion, Q: Array) -> Transition:
        return Transition(NavigationMap(motion, self.states, self.carry(motion.dt)), Q, None, motion.dt)

    def corrected(self, model: Earth, nav: NavState, x: Array) -> NavState:
        pos = earth.displace(model, nav.pos, -x[..., DP]) if self.position else nav.pos
        q_nb, vel = _corrected(nav.q_nb, nav.vel, x)
        return NavState(q_nb, vel, pos)

    def biases(self, x: Array) -> tuple[Array, Array]:
        return x[..., self.states["gyro_bias"]] * GYRO_UNIT, x[..., self.states["accel_bias"]] * ACCEL_UNIT


@kernel("(4),(3),(n)->(4),(3)")
def _corrected(q_nb: Array, vel: Array, x: Array, new_q: Array, new_vel: Array) -> None:
    put_quaternion(multiply(correction(vector(x)), quaternion(q_nb)), new_q)
    put_vector(subtract(vector(vel), vector(x[3:6])), new_vel)
