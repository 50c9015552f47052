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

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.earth import Earth
from sins_env.states import Block, Layout
from sins_env.types import NavState
from solvers.pipeline import feedback
from solvers.pipeline.errors.model import (
    ACCEL_UNIT,
    GYRO_UNIT,
    EpochMap,
    ErrorModel,
    front,
    total,
    turn_euler,
)
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
DV, PHI, NABLA, EPS = (STATES[name] for name in ("dv", "phi", "accel_bias", "gyro_bias"))
CONSTANT = slice(PHI.stop, None)  #: states that an epoch does not change: biases, and parameters of aids


def first_order_rows(phi: Array) -> Array:
    """Return C_n^c (3, 3, ...) to first order in phi_E and phi_N, for phi (3, ...) in rad: 000 (2.3.4)."""
    x, y, z = phi
    s, c = np.sin(z), np.cos(z)
    C = np.empty((3, *phi.shape))
    C[0, 0], C[0, 1], C[0, 2] = c, s, -y
    C[1, 0], C[1, 1], C[1, 2] = -s, c, x
    C[2, 0], C[2, 1], C[2, 2] = y * c + x * s, y * s - x * c, 1.0
    return C


class AlignmentMap(EpochMap):
    """The map of ten errors, and of the parameters of aids."""

    def __init__(self, motion: EpochMotion, exact: bool, body_biases: bool) -> None:
        super().__init__(motion, motion.C if body_biases else np.eye(3))
        self._exact = exact
        # - (2 omega_ie + omega_en) x dV - d_omega_en x V as a matrix on dV; the rest is quadratic in dV
        VE, VN, VU = front(motion.vel)
        coriolis = front(motion.dt * (2 * motion.rate_ie + motion.rate_en))[2]
        east, north, up = self.transport[1, 0], self.transport[0, 1], self.transport[2, 0]
        K = np.zeros((2, 2, *np.broadcast_shapes(VE.shape, coriolis.shape)))
        K[0, 0], K[0, 1], K[1, 0], K[1, 1] = up * VN - east * VU, coriolis, -coriolis - up * VE, north * VU
        self._coriolis = K

    def advance(self, X: Array) -> Array:
        dV, phi, nabla, eps = X[DV], X[PHI], X[NABLA], X[EPS]
        if self._exact:
            C, s, c = attitude.misalignment_rows(phi)
        else:
            C = first_order_rows(phi)
        rows = C[:, :2]  # columns of C for the velocities E and N
        u = self.force - total(self.accel[:, :2] * nabla, axis=1)
        gain = self.force[:2] - total(rows * u[:, None], axis=0)  # (I - C') f + C' C_hat nabla, C at the start
        v = dV + 0.5 * gain  # mid-epoch
        r = self.rotation(C, self.turn - total(self.transport * v, axis=1), eps)
        gain -= self.turned_force(rows, r)
        out = np.empty(X.shape)
        np.add(dV, gain, out=out[DV])
        out[DV] += total(self._coriolis * v, axis=1)
        sway = self.transport[2, 0] * v[0]
        out[DV][0] -= sway * v[1]
        out[DV][1] += sway * v[0]
        if self._exact:
            turn_euler(phi, r, s, c, out=out[PHI])
        else:
            np.add(phi, r, out=out[PHI])
        out[CONSTANT] = X[CONSTANT]
        return out


@dataclass(frozen=True)
class AlignmentErrors(ErrorModel):
    """The settings of the model, which makes transitions for a filter from epochs."""

    exact: bool = True  #: whether misalignments may have any size; False: first order in the tilt
    body_biases: bool = True  #: whether biases are constant in body axes; False: in n

    core = STATES
    fed = ("dv",)

    def transition(self, motion: EpochMotion, Q: Array) -> Transition:
        return Transition(AlignmentMap(motion, self.exact, self.body_biases), Q, None, motion.dt)

    def corrected(self, model: Earth, nav: NavState, x: Array) -> NavState:
        vel = nav.vel.copy()
        vel[..., :2] -= x[..., DV]
        return nav._replace(q_nb=feedback.corrected(nav.q_nb, x[..., PHI]), vel=vel)
