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
from sins_env.earth import Earth
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
        """Return the Jacobian (..., n, n) of the map at zero errors: ``advance`` to first order, line by line."""
        m, h, n = self._motion, self._h, self._states.size
        batch = m.dvel_n.shape[:-1]
        half_force = 0.5 * attitude.skew(m.dvel_n)
        accel = (h * ACCEL_UNIT) * m.C
        v, r, gain = (
            np.zeros((*batch, 3, n)) for _ in range(3)
        )  # rows of the velocity at mid-epoch, of r and of the gain
        v[..., PHI], v[..., DV], v[..., self._nabla] = half_force, np.eye(3), 0.5 * accel
        transport = h * m.transport * [1.0, 1.0, 0.0]
        d_coriolis = transport @ v
        r += d_coriolis
        r[..., PHI] -= attitude.skew(h * (m.rate_ie + m.rate_en))
        r[..., self._eps] -= (h * GYRO_UNIT) * m.C
        gain[..., PHI], gain[..., self._nabla] = 2.0 * half_force, accel
        F = np.broadcast_to(np.eye(n), (*batch, n, n)).copy()
        if self._position:
            turn, ie, shift, gravity = self._place_slopes()
            mid = np.zeros((3, n))  # rows of the position error at mid-epoch
            mid[:, DV], mid[:, DP] = 0.5 * h * np.eye(3), np.eye(3)
            r += (turn + ie) @ mid
            d_coriolis = d_coriolis + (turn + 2.0 * ie) @ mid
            gain += gravity @ mid
            F[..., DP, :] += shift @ mid
        gain += half_force @ r - attitude.skew(h * (2 * m.rate_ie + m.rate_en)) @ v + attitude.skew(m.vel) @ d_coriolis
        F[..., PHI, :] += r
        F[..., DV, :] += gain
        if self._position:
            F[..., DP, DV] += h * np.eye(3)
            F[..., DP, :] += 0.5 * h * gain
        return F

    def _place_slopes(self) -> tuple[Array, Array, Array, Array]:
        """Return what a position error changes, (..., 3, 3) each: omega_en and omega_ie of the epoch, dp, and gravity."""
        turn, ie, shift, gravity = (np.zeros((*self._motion.dvel_n.shape[:-1], 3, 3)) for _ in range(4))
        for i, unit in enumerate(np.eye(3)):
            p = unit.reshape(3, *(1,) * (self._vel.ndim - 1))
            turned, shifted = self._curved(self._vel, np.broadcast_to(p, self._vel.shape))
            turn[..., i] = np.moveaxis(turned[..., 0], 0, -1)
            shift[..., :2, i] = np.moveaxis(shifted[..., 0], 0, -1)
        ie[..., 1:, 1] = np.moveaxis(self._ie[..., 0], 0, -1)
        gravity[..., 2, 1], gravity[..., 2, 2] = self._gravity_north[..., 0], self._h * earth.FREE_AIR
        return turn, ie, shift, gravity


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
