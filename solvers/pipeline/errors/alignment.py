"""The 10-state error model of alignment: how the INS's velocity error and misalignment grow over an epoch.

    x = [dV_E, dV_N,  phi_E, phi_N, phi_U,  nabla_x, nabla_y,  eps_x, eps_y, eps_z]
         m/s          rad                   mg (1e-3 g)        deg/h

The default is exact for misalignments of any size. Quantities with a hat are the INS's, C = C_n^c(phi) and C_w are those of
docs/mathematics/frames.md#misalignment:

    phi' = C_w^-1 [(I - C) omega_in + C d_omega_en - C_hat eps]
    dV'  = (I - C') f + C' C_hat nabla - (2 omega_ie + omega_en) x dV - d_omega_en x (V - dV),   rows E and N.

The setting ``model="thesis"`` takes C to first order in the tilt and C_w = I, as (2.3.4) and (2.3.19) do. A tilt of 1 deg then
biases the azimuth by 270 arcsec after 360 s. ``bias_frame="nav"`` takes the biases as constant in n, as the thesis does.
Source: 000 (2.3.19), corrected; docs/mathematics/error_models.md#alignment-model and #first-order-model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sins_env.arrays import Array
from sins_env.earth import Earth
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    Matrix,
    Vector,
    add,
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
    turn,
    unturned,
    vector,
)
from sins_env.states import Block, Layout
from sins_env.types import NavState
from solvers.pipeline.errors.model import ACCEL_UNIT, GYRO_UNIT, ErrorModel, carried
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Transition

#: The states: velocity errors E and N, misalignment, accelerometer biases R and F, gyro biases R, F and U.
STATES = Layout(
    (
        Block("dv", 2, "m/s"),
        Block("phi", 3, "rad"),
        Block("accel_bias", 2, "mg", ACCEL_UNIT),
        Block("gyro_bias", 3, "deg/h", GYRO_UNIT),
    )
)
DV, PHI = STATES["dv"], STATES["phi"]  # the kernels below count the states: dV 0-1, phi 2-4, nabla 5-6, eps 7-9


@helper
def first_order(phi: Vector, s: Vector, c: Vector) -> Matrix:
    """Return C_n^c to first order in phi_E and phi_N, with the sines and cosines of phi: 000 (2.3.4)."""
    return (
        c[2], s[2], -phi[1],
        -s[2], c[2], phi[0],
        phi[1] * c[2] + phi[0] * s[2], phi[1] * s[2] - phi[0] * c[2], 1.0,
    )  # fmt: skip


@kernel("(p,n),(3),(3),(3,3),(3),(3),(3,3),(),()->(p,n)", "dddddddd?d")
def _advance(
    x: Array, dvel_n: Array, vel: Array, bias_C: Array, rate_ie: Array, rate_en: Array, transport: Array, h: float,
    exact: bool, out: Array,
) -> None:  # fmt: skip
    points, n = x.shape
    X = np.empty((n, points))  # components in rows, which makes vector code
    for j in range(n):
        for i in range(points):
            X[j, i] = x[i, j]
    force, T = vector(dvel_n), mix(h, matrix(transport), 0.0, matrix(transport))
    accel, gyro = mix(h * ACCEL_UNIT, matrix(bias_C), 0.0, T), mix(h * GYRO_UNIT, matrix(bias_C), 0.0, T)
    rate, earth_rate = add(vector(rate_ie), vector(rate_en)), vector(rate_ie)
    turning = scale(h, rate)
    # - (2 omega_ie + omega_en) x dV - d_omega_en x V as a matrix on dV; the rest is quadratic in dV
    coriolis = h * (earth_rate[2] + rate[2])
    K = T[6] * vel[1] - T[3] * vel[2], coriolis, -coriolis - T[6] * vel[0], T[1] * vel[2]
    for i in range(points):
        phi = X[2, i], X[3, i], X[4, i]
        s, c = sincos3(phi)
        C = misaligned(s, c) if exact else first_order(phi, s, c)
        nabla, eps = (X[5, i], X[6, i], 0.0), (X[7, i], X[8, i], X[9, i])
        u = subtract(force, turn(accel, nabla))
        gain_E = force[0] - (C[0] * u[0] + C[3] * u[1] + C[6] * u[2])  # (I - C') f + C' C_hat nabla, C at the start
        gain_N = force[1] - (C[1] * u[0] + C[4] * u[1] + C[7] * u[2])
        v_E, v_N = X[0, i] + 0.5 * gain_E, X[1, i] + 0.5 * gain_N  # mid-epoch
        w = subtract(turning, turn(T, (v_E, v_N, 0.0)))
        r = subtract(subtract(turning, turn(C, w)), turn(gyro, eps))  # rotation of c against n in the epoch
        change = scale(0.5, cross3(r, force))  # (C_mid - C)' f, with nabla neglected beside f
        gain_E -= C[0] * change[0] + C[3] * change[1] + C[6] * change[2]
        gain_N -= C[1] * change[0] + C[4] * change[1] + C[7] * change[2]
        sway = T[6] * v_E
        X[0, i] += gain_E + K[0] * v_E + K[1] * v_N - sway * v_N
        X[1, i] += gain_N + K[2] * v_E + K[3] * v_N + sway * v_E
        X[2, i], X[3, i], X[4, i] = add(phi, unturned(s, c, r) if exact else r)
    for i in range(points):
        for j in range(n):
            out[i, j] = X[j, i]


class AlignmentMap:
    """The map from ten errors x to those after the epoch, for (*batch, n) and, with sigma points, (*batch, points, n).

    The parameters of aids, which follow the ten, go through an epoch by the matrix ``carry`` (k, k).
    """

    temporaries = 0  #: number of arrays of the size of x that a call makes beside its result

    def __init__(self, motion: EpochMotion, exact: bool, body_biases: bool, carry: Array | None = None) -> None:
        self._carry = carry
        self._ndim = motion.dvel_n.ndim
        C = motion.C if body_biases else np.eye(3)
        self._epoch = motion.dvel_n, motion.vel, C, motion.rate_ie, motion.rate_en, motion.transport, motion.dt, exact

    def __call__(self, x: Array) -> Array:
        if x.ndim == self._ndim:
            return self(x[..., None, :])[..., 0, :]
        out: Array = _advance(x, *self._epoch)
        return carried(out, self._carry)


@dataclass(frozen=True)
class AlignmentErrors(ErrorModel):
    """The settings of the model, which makes transitions for a filter from epochs."""

    exact: bool = True  #: whether misalignments may have any size; False: first order in the tilt
    body_biases: bool = True  #: whether biases are constant in body axes; False: in n

    core = STATES
    fed = ("dv",)

    def transition(self, motion: EpochMotion, Q: Array) -> Transition:
        carry = self.carry(motion.dt)
        return Transition(AlignmentMap(motion, self.exact, self.body_biases, carry), Q, None, motion.dt)

    def corrected(self, model: Earth, nav: NavState, x: Array) -> NavState:
        q_nb, vel = _corrected(nav.q_nb, nav.vel, x)
        return NavState(q_nb, vel, nav.pos)


@kernel("(4),(3),(n)->(4),(3)")
def _corrected(q_nb: Array, vel: Array, x: Array, new_q: Array, new_vel: Array) -> None:
    put_quaternion(multiply(correction(vector(x[2:5])), quaternion(q_nb)), new_q)
    put_vector((vel[0] - x[0], vel[1] - x[1], vel[2]), new_vel)
