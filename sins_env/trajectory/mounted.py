"""A trajectory as an IMU sees it that sits crooked in the vehicle, and the motion of a car whose tyres slip sideways."""

from __future__ import annotations

from typing import Any

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.motion import Motion, Trajectory
from sins_env.types import NavState

MOST_AGE = 4  #: epochs before a chunk whose slip is kept, for fixes that were made in them


class Turned:
    """A motion whose axes are turned against those of ``inner``, of which all else is asked."""

    def __init__(self, inner: Trajectory) -> None:
        self.inner = inner

    def __getattr__(self, name: str) -> Any:
        if name == "inner":  # a copy that has no fields yet
            raise AttributeError(name)
        return getattr(self.inner, name)


class Slipping(Turned):
    """The motion of a car whose tyres slip sideways, along the path of ``inner``.

    In a turn the nose of the car points inwards of its velocity, by ``slip_angle`` times the acceleration to the right:
    v_right = -slip_angle a_right v_forward with a_right = -rate_up v_forward. Within an epoch the angle changes linearly, and at
    t = 0 it is zero. See docs/mathematics/aiding.md#faults.

    Args:
        inner: motion of a car whose velocity is along its forward axis.
        slip_angle: rad for each m/s^2.
        epoch_s: length of an epoch, s.
    """

    def __init__(self, inner: Trajectory, slip_angle: float, epoch_s: float) -> None:
        super().__init__(inner)
        self._slip_angle, self._epoch_s = slip_angle, epoch_s

    def state(self, nav: NavState) -> NavState:
        """Return the states of the car at t = 0."""
        self._from, self._angles = 0, np.zeros((len(nav.vel), 1))
        return nav

    def earlier(self, after: NavState, t: Array, age: Array) -> tuple[NavState, Array]:
        """Return the states (runs, len(t), ...) of the car and omega_eb^b at the times t - age."""
        state, rate_eb_b = self.inner.earlier(after, t, age)
        angle, slope = self._angle(t - age), self._angle(t - age, slope=True)
        turned = state._replace(q_nb=attitude.multiply(state.q_nb, _turn(angle)))
        return turned, _in_turned(angle, rate_eb_b) - _up(slope)

    def chunk(self, first_epoch: int, num_epochs: int) -> Motion:
        """Return the motion of the car in a chunk of epochs."""
        motion = self.inner.chunk(first_epoch, num_epochs)
        forward = (attitude.to_dcm(motion.state.q_nb).mT @ motion.state.vel[..., None])[..., 1, 0]
        ends = -self._slip_angle * motion.rate_eb_b[..., 2] * forward
        kept = self._angles[:, -MOST_AGE - 1 :]
        self._from, self._angles = first_epoch + 1 - kept.shape[1], np.concatenate([kept, ends], axis=1)
        change = np.diff(self._angles, axis=1)[:, -num_epochs:]
        n_sub = motion.dtheta.shape[2]
        middle = (ends - change)[..., None] + change[..., None] * (np.arange(n_sub) + 0.5) / n_sub
        return Motion(
            _in_turned(middle, motion.dtheta) - _up(change / n_sub)[:, :, None],
            _in_turned(middle, motion.dvel),
            motion.state._replace(q_nb=attitude.multiply(motion.state.q_nb, _turn(ends))),
            _in_turned(ends, motion.rate_eb_b) - _up(change / self._epoch_s),
        )

    def _angle(self, t: Array, slope: bool = False) -> Array:
        """Return the angle (runs, len(t)) at times of the last chunk, or its derivative, rad/s."""
        place = t / self._epoch_s - self._from
        before = np.clip(np.ceil(place - 1e-9).astype(np.int64) - 1, 0, self._angles.shape[1] - 2)
        change = np.diff(self._angles, axis=1)[:, before]
        return change / self._epoch_s if slope else self._angles[:, before] + (place - before) * change


def _up(value: Array) -> Array:
    """Return vectors (..., 3) along the upward axis."""
    return np.stack([0.0 * value, 0.0 * value, value], axis=-1)


def _turn(angle: Array) -> Array:
    """Return quaternions (..., 4) that turn vectors of axes with the nose to the right by ``angle`` into those without."""
    return attitude.from_rotvec(_up(-angle))


def _in_turned(angle: Array, vector: Array) -> Array:
    """Return vectors (..., 3) along axes with the nose to the right by ``angle``."""
    turned: Array = (attitude.to_dcm(_turn(angle)).mT @ vector[..., None])[..., 0]
    return turned


class Mounted(Turned):
    """The motion of an IMU in a vehicle that moves along ``inner``.

    Args:
        inner: motion of the vehicle, in its own axes.
        mounting: quaternions (runs, 4) that turn vectors of the IMU's axes into those of the vehicle.
    """

    def __init__(self, inner: Trajectory, mounting: Array) -> None:
        super().__init__(inner)
        self._mounting = mounting
        self._to_imu = attitude.to_dcm(mounting).mT

    def state(self, nav: NavState) -> NavState:
        """Return the states (runs, 3 or 4) of the IMU for those of the vehicle."""
        return nav._replace(q_nb=attitude.multiply(nav.q_nb, self._mounting))

    def earlier(self, after: NavState, t: Array, age: Array) -> tuple[NavState, Array]:
        """Return the states (runs, len(t), ...) of the IMU and omega_eb^b at the times t - age."""
        state, rate_eb_b = self.inner.earlier(after, t, age)
        turned = state._replace(q_nb=attitude.multiply(state.q_nb, self._mounting[:, None]))
        return turned, (self._to_imu[:, None] @ rate_eb_b[..., None])[..., 0]

    def chunk(self, first_epoch: int, num_epochs: int) -> Motion:
        """Return the motion of the IMU in a chunk of epochs."""
        motion = self.inner.chunk(first_epoch, num_epochs)
        samples, epochs = self._to_imu[:, None, None], self._to_imu[:, None]
        return Motion(
            (samples @ motion.dtheta[..., None])[..., 0],
            (samples @ motion.dvel[..., None])[..., 0],
            motion.state._replace(q_nb=attitude.multiply(motion.state.q_nb, self._mounting[:, None])),
            (epochs @ motion.rate_eb_b[..., None])[..., 0],
        )
