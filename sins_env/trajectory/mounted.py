"""A trajectory as an IMU sees it that sits crooked in the vehicle."""

from __future__ import annotations

from typing import Any

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.motion import Motion, Trajectory
from sins_env.types import NavState


class Mounted:
    """The motion of an IMU in a vehicle that moves along ``inner``.

    Args:
        inner: motion of the vehicle, in its own axes.
        mounting: quaternions (runs, 4) that turn vectors of the IMU's axes into those of the vehicle.
    """

    def __init__(self, inner: Trajectory, mounting: Array) -> None:
        self.inner, self._mounting = inner, mounting
        self._to_imu = attitude.to_dcm(mounting).mT

    def __getattr__(self, name: str) -> Any:
        if name == "inner":  # a copy that has no fields yet
            raise AttributeError(name)
        return getattr(self.inner, name)

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
