"""GPS fixes, or zero-velocity updates in their place: velocity and position of an antenna with a lever arm.
docs/mathematics/error_models.md#lever-arm.

The error model's states say what a fix shows: its velocity as far as there are states ``dv``, and its position where there
are states ``dp``. A model without a vertical velocity has that of the INS slaved to the fixes.
"""

from __future__ import annotations

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.specs import GpsSpec
from sins_env.states import FIX, Layout
from sins_env.types import NavState, Observation, Task
from solvers.pipeline.errors.model import Parameter
from solvers.pipeline.strapdown import cross, end_rate
from solvers.types import MISSING, Linear, Measurement, NoiseLaw

VERTICAL_TIME_CONSTANT_S = 5.0  #: of the loop that slaves the INS's vertical velocity to the fixes


class Gps:
    """The aid. A fix is compared with the INS's velocity and place at the antenna, as the INS computes them."""

    def __init__(self, task: Task, states: Layout) -> None:
        self._site, self._epoch_s = task.site.pos, task.epoch_s
        self._earth = earth.get(task.site.earth)
        self._rate_ie = earth.rate_n(self._earth, task.site.latitude)
        self._lever = np.asarray(task.gps.lever_arm_m) if any(task.gps.lever_arm_m) else None
        self._law, self._fix = noise_law(task.gps), Fix(states)
        rows = FIX.places(self._fix.shown)
        self._R = task.prior.R[np.ix_(rows, rows)]
        self._position, self._vertical = "dp" in states, states.only("dv").size == 3
        self._place: Array = np.full(3, np.nan)  # of the antenna, by the last fix of the coarse phase

    @staticmethod
    def parameters(task: Task) -> tuple[Parameter, ...]:
        return ()

    def start(self, obs: Observation, q_nb: Array) -> NavState:
        """Velocity of the fix, or zero; place of the last fix, or the site, where the base does not travel in any case."""
        self._place = np.where(obs["gps_valid"] == 1, obs["gps_pos"], self._place)
        vel, pos = obs["gps_vel"], self._place
        if self._lever is not None:
            about, offset = np.moveaxis(self._arm(obs, q_nb), -2, 0)
            vel, pos = vel - about, earth.displace(self._earth, pos, -offset)
        site = np.broadcast_to(self._site, (*q_nb.shape[:-1], 3))
        pos = np.where(np.isnan(pos), site, pos) if self._position else site
        return NavState(q_nb, vel * obs["gps_valid"], pos)

    def hold(self, obs: Observation, nav: NavState) -> NavState:
        """Slaves the vertical velocity to the fixes, unless it is a state."""
        valid = _valid(obs)
        if self._vertical or not valid.any():
            return nav
        vel = nav.vel.copy()
        off = self._off(obs, nav, self._arm_of(obs, nav))[..., 2]
        vel[..., 2] -= valid * min(self._epoch_s / VERTICAL_TIME_CONSTANT_S, 1.0) * off
        return nav._replace(vel=vel)

    def measure(self, obs: Observation, nav: NavState) -> Measurement | None:
        """INS minus fix."""
        valid = _valid(obs)
        if not valid.any():
            return None
        arm, R = self._arm_of(obs, nav), self._R
        residual = self._off(obs, nav, arm)[..., : len(R)]
        if not valid.all():
            residual = np.where(valid[..., None], residual, 0.0)
            R = R + np.where(valid, 0.0, MISSING)[..., None, None] * np.eye(len(R))
        return self._fix.measurement(residual, R, arm, self._law)

    def _off(self, obs: Observation, nav: NavState, arm: Array | None) -> Array:
        """INS minus fix at the antenna: velocity m/s, and position m where there are states of it."""
        off = nav.vel - obs["gps_vel"]
        if self._position:
            away = earth.offset(self._earth, nav.pos, obs["gps_pos"])
            off = np.concatenate([off, -away], axis=-1)
        return off if arm is None else off + arm.reshape(*arm.shape[:-2], 6)[..., : off.shape[-1]]

    def _arm_of(self, obs: Observation, nav: NavState) -> Array | None:
        return None if self._lever is None else self._arm(obs, nav.q_nb)

    def _arm(self, obs: Observation, q_nb: Array) -> Array:
        """Velocity C_hat (omega_eb x lever arm) and place C_hat lever arm of the antenna about the IMU, (..., 2, 3)."""
        C = attitude.to_dcm(q_nb)
        arm = C @ np.asarray(self._lever)
        rate = np.matmul(C, end_rate(obs["dtheta"], self._epoch_s)[..., None])[..., 0] - self._rate_ie
        return np.stack([cross(rate, arm), arm], axis=-2)


class Fix:
    """The states of a layout that a fix shows: ``dv``, and ``dp`` if there is one."""

    def __init__(self, states: Layout) -> None:
        self.shown = states.only(*(name for name in FIX.names if name in states))
        self._seen, self._phi = states.span(*self.shown.names), states["phi"]
        self._H = np.eye(states.size)[self._seen]

    def measurement(
        self, residual: Array, R: Array, arm: Array | None = None, law: NoiseLaw | None = None
    ) -> Measurement:
        """INS minus fix (..., m), velocity m/s and position m: [I 0] x, plus the lever arm's part turned by phi. (2.3.20).

        ``arm`` (..., k, 3): C_hat (omega_eb x lever arm) and, with a position, C_hat lever arm, both already added to the
        INS's values in ``residual``.
        """
        if arm is None:
            return Measurement(residual, Linear(self._H), R, law)
        m = residual.shape[-1]

        def h(x: Array) -> Array:
            return x[..., self._seen] + arm_error(x[..., self._phi], arm)[..., :m]

        return Measurement(residual, h, R, law)


def noise_law(gps: GpsSpec) -> NoiseLaw | None:
    """The law of the fixes' errors that the task tells; None: Gaussian."""
    if not (gps.contamination or gps.heavy_tail_dof):
        return None
    return NoiseLaw(gps.contamination, gps.contamination_factor, gps.heavy_tail_dof)


def arm_error(phi: Array, arm: Array) -> Array:
    """(I - C') a of the vectors ``arm`` (*batch, k, 3), one after another: (*batch, [points,] 3 k) for phi (..., 3)."""
    if phi.ndim >= arm.ndim:
        arm = arm[..., None, :, :]
    apart = arm - np.matmul(arm, attitude.misalignment_dcm(phi))  # rows: (C' a)' = a' C
    return apart.reshape(*apart.shape[:-2], -1)


def _valid(obs: Observation) -> Mask:
    return np.asarray(obs["gps_valid"][..., 0] == 1)
