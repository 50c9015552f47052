"""GPS fixes, or zero-velocity updates in their place: velocity and position of an antenna with a lever arm.

The states of the error model say what a fix shows: the velocity for the states ``dv``, and the position if there are states
``dp``. If the model has no vertical velocity, that of the INS is pulled towards the fixes. A fix that was made before the end of
its epoch is compared with the INS at that time (:mod:`solvers.pipeline.rewind`).
Equations: 000 (2.3.20); docs/mathematics/error_models.md#measurement and #lever-arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.kernels import kernel
from sins_env.specs import GpsSpec
from sins_env.states import FIX, Layout
from sins_env.types import NavState, Observation, Task
from solvers.pipeline.aiding.aid import Ins
from solvers.pipeline.errors.model import ACCEL_UNIT, Parameter
from solvers.pipeline.rewind import Earlier, rewound
from solvers.pipeline.strapdown import cross, end_rate
from solvers.types import MISSING, Linear, Measurement, NoiseLaw

VERTICAL_TIME_CONSTANT_S = 5.0  #: time constant of the loop that pulls the vertical velocity of the INS to the fixes


class Gps:
    """The fixes as an aid. A fix is compared with the velocity and place of the antenna that the INS computes.

    An INS waits for its first fix if it begins without a told attitude, and ``start`` makes its state of it.
    """

    name: ClassVar[str] = "gps"

    def __init__(self, task: Task, states: Layout) -> None:
        self._site, self._epoch_s = task.site.pos, task.epoch_s
        self._earth = earth.get(task.site.earth)
        self._rate_ie = earth.rate_n(self._earth, task.site.latitude)
        self._lever = np.asarray(task.gps.lever_arm_m) if any(task.gps.lever_arm_m) else None
        self._law, self._fix = noise_law(task.gps), Fix(states, task.gps.velocity)
        self.shown = self._fix.shown  #: the states that a fix shows
        self._rows = rows = FIX.places(self.shown)
        self._R, self.rows = task.prior.R[np.ix_(rows, rows)], len(rows)
        self._position, self._vertical = "dp" in states, states.only("dv").size == 3
        self._oldest = task.gps.oldest_s
        self._pull = min(self._epoch_s / VERTICAL_TIME_CONSTANT_S, 1.0)
        self._place: Array = np.full(3, np.nan)  # place of the antenna at the last fix of the coarse phase

    @staticmethod
    def parameters(task: Task) -> tuple[Parameter, ...]:
        """Return no states, because the told errors of fixes are white."""
        return ()

    def start(self, obs: Observation, q_nb: Array) -> NavState:
        """Return the velocity of the fix or zero, and the place of the last fix or the site.

        The site is always the place if the error model has no position, because the base then does not travel.
        """
        self._place = np.where(obs["gps_valid"] == 1, obs["gps_pos"], self._place)
        vel, pos = obs["gps_vel"], self._place
        if "gps_age" in obs:  # the velocity stays as it was, for the horizontal force is not known without a heading
            pos = earth.displace(self._earth, pos, obs["gps_age"] * vel)
        if self._lever is not None:
            about, offset = np.moveaxis(self._arm(obs, q_nb), -2, 0)
            vel, pos = vel - about, earth.displace(self._earth, pos, -offset)
        site = np.broadcast_to(self._site, (*q_nb.shape[:-1], 3))
        pos = np.where(np.isnan(pos), site, pos) if self._position else site
        return NavState(q_nb, vel * obs["gps_valid"], pos)

    def hold(self, obs: Observation, ins: Ins) -> NavState:
        """Return the INS, with its vertical velocity pulled towards a fix unless the error model has it as a state."""
        nav = ins.nav
        if self._vertical:
            return nav
        valid = np.asarray(obs["gps_valid"][..., 0] == 1)
        if not np.count_nonzero(valid):
            return nav
        off = self._compared(obs, ins, valid)[0]
        return NavState(nav.q_nb, _pulled(nav.vel, off, valid, self._pull), nav.pos)

    def read(self, obs: Observation, ins: Ins) -> Measurement | None:
        """Return INS minus fix; None if no run has a fix.

        Raises:
            ValueError: a fix that is older than the increments that are kept.
        """
        valid = np.asarray(obs["gps_valid"][..., 0] == 1)
        seen = np.count_nonzero(valid)
        if not seen:
            return None
        off, arm, made = self._compared(obs, ins, valid)
        residual, R = off[..., self._fix.rows], self._noise(obs, valid)
        if seen < valid.size:
            residual = np.where(valid[..., None], residual, 0.0)
            R = R + np.where(valid, 0.0, MISSING)[..., None, None] * np.eye(self.rows)
        return self._fix.measurement(residual, R, arm, self._law, made)

    def _noise(self, obs: Observation, valid: Mask) -> Array:
        """Return the covariance of a fix, (rows, rows), or (..., rows, rows) by what the receiver states of it."""
        if "gps_pos_std" not in obs:
            return self._R
        std = np.concatenate([obs["gps_vel_std"], obs["gps_pos_std"]], axis=-1)[..., self._rows]
        variance = np.where(valid[..., None], std**2, np.diag(self._R))
        return variance[..., None] * np.eye(len(self._R))

    def _compared(self, obs: Observation, ins: Ins, valid: Mask) -> tuple[Array, Array | None, Made | None]:
        """Return INS minus fix, the arm of the antenna, or None without one, and when the fix was made.

        INS minus fix is the velocity in m/s and, if the error model has states of it, the position in m. The arm is velocity
        C_hat (omega_eb x lever arm) and place C_hat lever arm of the antenna about the IMU, (..., 2, 3).
        """
        nav, arm, made = ins.nav, None, None
        if "gps_age" in obs:
            made = self._made(obs, ins, valid)
            nav = made.ins.nav
        if self._lever is not None:
            arm = self._arm(obs, nav.q_nb, None if made is None else made.ins.rate)
        off = nav.vel - obs["gps_vel"]
        if self._position:
            away = earth.offset(self._earth, nav.pos, obs["gps_pos"])
            off = np.concatenate([off, -away], axis=-1)
        return off if arm is None else off + arm.reshape(*arm.shape[:-2], 6)[..., : off.shape[-1]], arm, made

    def _made(self, obs: Observation, ins: Ins, valid: Mask) -> Made:
        """Return when fixes were made, and the INS then."""
        if ins.samples is None:
            raise ValueError("a fix with gps_age; allowed: with the increments of the epochs since then")
        age = np.where(valid, obs["gps_age"][..., 0], 0.0)
        sample_s = self._epoch_s / obs["dtheta"].shape[-2]
        most = max(2 * self._epoch_s, self._oldest)
        if not (np.all(age >= 0.0) and np.all(age <= most + 1e-9)):
            wrong = float(age.flat[np.argmax((age < 0.0) | (age > most))])
            raise ValueError(f"gps_age = {wrong:g} s; allowed: 0 to {most:g} s, two epochs or what the task tells")
        return Made(age, rewound(self._earth, ins.nav, *ins.samples, sample_s, age))

    def _arm(self, obs: Observation, q_nb: Array, rate_eb: Array | None = None) -> Array:
        """Return velocity C_hat (omega_eb x lever arm) and place C_hat lever arm of the antenna about the IMU, (..., 2, 3).

        Without ``rate_eb`` (..., 3) rad/s, the rate is that at the end of the epoch.
        """
        C = attitude.to_dcm(q_nb)
        arm = C @ np.asarray(self._lever)
        if rate_eb is not None:
            return np.stack([cross(np.matmul(C, rate_eb[..., None])[..., 0], arm), arm], axis=-2)
        rate = np.matmul(C, end_rate(obs["dtheta"], self._epoch_s)[..., None])[..., 0] - self._rate_ie
        return np.stack([cross(rate, arm), arm], axis=-2)


@kernel("(3),(k),(),()->(3)", "dd?dd")
def _pulled(vel: Array, off: Array, valid: bool, share: float, out: Array) -> None:
    """Fill in the velocity of the INS, with the vertical one pulled towards a fix that it is ``off``."""
    out[0], out[1] = vel[0], vel[1]
    out[2] = vel[2] - share * off[2] if valid and off[2] == off[2] else vel[2]  # NaN: missing


class Made(NamedTuple):
    """When a fix was made."""

    age: Array  #: (...) s before the end of the epoch
    ins: Earlier  #: the INS then


class Fix:
    """The states of a layout that a fix shows: ``dv``, unless it is a position alone, and ``dp`` if the layout has it.

    Raises:
        ValueError: a fix that shows no state.
    """

    def __init__(self, states: Layout, velocity: bool = True) -> None:
        self.shown = states.only(*(name for name in FIX.names if name in states and (velocity or name != "dv")))
        if not self.shown.names:
            raise ValueError("fixes without a velocity; allowed: in navigation, where the position is a state")
        places = FIX.places(self.shown)
        self.rows = slice(int(places[0]), int(places[-1]) + 1)  #: place among velocity and position
        self._seen, self._phi = states.span(*self.shown.names), states["phi"]
        self._H, self._states = np.eye(states.size)[self._seen], states

    def measurement(
        self, residual: Array, R: Array, arm: Array | None = None, law: NoiseLaw | None = None, made: Made | None = None
    ) -> Measurement:
        """Return the measurement of ``residual`` (..., m), INS minus fix: velocity m/s and position m, 000 (2.3.20).

        h picks the states that a fix shows. A lever arm adds a part that depends on phi: ``arm`` (..., k, 3) holds
        C_hat (omega_eb x lever arm) and, with a position, C_hat lever arm. Both are already in the residual.
        """
        if made is not None:
            return Measurement(residual, self._before(made, arm), R, law)
        if arm is None:
            return Measurement(residual, Linear(self._H), R, law)
        return Measurement(residual, Antenna(self._H, self._seen, self._phi, arm, self.rows), R, law)

    def _before(self, made: Made, arm: Array | None) -> AntennaBefore:
        """Return what a fix shows that was made before the end of the epoch.

        A model with two accelerometer biases leaves out what they add, 0.1 mm/s for 1 mg and 10 ms.
        """
        states, d = self._states, made.age[..., None, None]
        H = np.broadcast_to(self._H, (*made.age.shape, *self._H.shape)).copy()
        if "dp" in states:
            H[..., self.shown["dp"], states["dv"]] = -d * np.eye(3)
        force = np.stack([-made.ins.gained, made.ins.moment], axis=-2)
        moved = made.ins.C * (ACCEL_UNIT if states.only("accel_bias").size == 3 else 0.0)
        drawn = np.stack([d * moved, -0.5 * d * d * moved], axis=-3)
        return AntennaBefore(
            self._H,
            self._seen,
            self._phi,
            force if arm is None else arm + force,
            self.rows,
            H,
            drawn,
            states["accel_bias"],
        )


@dataclass(frozen=True)
class Antenna:
    """What a fix of an antenna with a lever arm shows, h(x) = H x + (I - C') a, with its Jacobian."""

    H: Array  #: (m, n), the states that a fix shows
    seen: slice  #: place of these states
    phi: slice
    arm: Array  #: (*batch, 2, 3), the vectors a of velocity and position
    rows: slice  #: place of H among velocity and position

    def __call__(self, x: Array) -> Array:
        return x[..., self.seen] + arm_error(x[..., self.phi], self.arm)[..., self.rows]

    def jacobian(self, x: Array) -> Array:
        """Return H and, in the columns of phi, C' [a x] C_w: (..., m, n) for x (..., n)."""
        phi = x[..., self.phi]
        turned = attitude.misalignment_dcm(phi).mT[..., None, :, :] @ attitude.skew(self.turned(x))
        slope = turned @ attitude.misalignment_rate_matrix(phi)[..., None, :, :]
        J = np.broadcast_to(self.of(x, self.linear), (*x.shape[:-1], *self.H.shape)).copy()
        J[..., self.phi] += slope.reshape(*slope.shape[:-3], -1, 3)[..., self.rows, :]
        return J

    @property
    def linear(self) -> Array:
        """The part of the Jacobian that does not depend on x."""
        return self.H

    def turned(self, x: Array) -> Array:
        """Return the vectors that C' turns, (..., k, 3)."""
        return self.of(x, self.arm)

    def of(self, x: Array, part: Array) -> Array:
        """Return an array with the batch axes of the runs with an axis for points, if x (..., n) are points."""
        runs = self.arm.ndim - 2
        return np.expand_dims(part, runs) if x.ndim > runs + 1 and part.ndim > 2 else part


@dataclass(frozen=True)
class AntennaBefore(Antenna):
    """What a fix made before the end of the epoch shows, h(x) = H x + a - C' (a + B nabla).

    The vectors a have -F and G of :mod:`solvers.pipeline.rewind` in them, and B nabla is what the biases add to these.
    """

    then: Array  #: (*batch, m, n), takes the place of H
    drawn: Array  #: (*batch, k, 3, 3), the matrices B for biases in their unit
    bias: slice

    @property
    def linear(self) -> Array:
        return self.then

    def __call__(self, x: Array) -> Array:
        back = np.matmul(self.turned(x), attitude.misalignment_dcm(x[..., self.phi]))  # rows, as in arm_error
        apart = self.of(x, self.arm) - back
        linear = np.matmul(self.of(x, self.then), x[..., None])[..., 0]
        return linear + apart.reshape(*apart.shape[:-2], -1)[..., self.rows]

    def turned(self, x: Array) -> Array:
        nabla = x[..., None, self.bias, None]
        drawn = self.of(x, self.drawn)[..., : nabla.shape[-2]]
        return self.of(x, self.arm) + np.matmul(drawn, nabla)[..., 0]

    def jacobian(self, x: Array) -> Array:
        """Return dh / dx (..., m, n) at x (..., n)."""
        J = super().jacobian(x)
        slope = attitude.misalignment_dcm(x[..., self.phi]).mT[..., None, :, :] @ self.of(x, self.drawn)
        J[..., self.bias] -= slope.reshape(*slope.shape[:-3], -1, 3)[..., self.rows, : self.bias.stop - self.bias.start]
        return J


def noise_law(gps: GpsSpec) -> NoiseLaw | None:
    """Return the law of the errors of fixes that the task tells; None: Gaussian."""
    if not (gps.contamination or gps.heavy_tail_dof):
        return None
    return NoiseLaw(gps.contamination, gps.contamination_factor, gps.heavy_tail_dof)


def arm_error(phi: Array, arm: Array) -> Array:
    """Return (I - C') a for the vectors ``arm`` (*batch, k, 3), side by side: (*batch, [points,] 3 k) for phi (..., 3)."""
    if phi.ndim >= arm.ndim:
        arm = arm[..., None, :, :]
    apart = arm - np.matmul(arm, attitude.misalignment_dcm(phi))  # rows: (C' a)' = a' C
    return apart.reshape(*apart.shape[:-2], -1)
