"""Gyro dead reckoning from the told attitude, for a batch of runs at once, without an import of sins_env."""

import numpy as np

EARTH_RATE = 7.292115e-5  # rad/s


class GyroReckoning:
    """Turns the told attitude by every gyro increment and removes the earth's rotation; it keeps the error of the start.

    With ``earth=False`` the attitude also drifts by up to 15 deg/h.
    """

    batched = True  # observations have a leading run axis, or none for a single run

    def __init__(self, earth: bool = True):
        self.earth = earth

    def reset(self, task, rng, num_runs=1):
        told = np.array([1.0, 0.0, 0.0, 0.0]) if task.start is None else np.array(task.start.q_nb)
        self.q_nb = np.tile(told, (num_runs, 1)) if task.start is None and num_runs > 1 else told
        rate = EARTH_RATE * np.array([0.0, np.cos(task.site.latitude), np.sin(task.site.latitude)])  # E, N, U
        self.back = quaternion(-rate * task.epoch_s * self.earth)

    def step(self, obs):
        for dtheta in np.moveaxis(obs["dtheta"], -2, 0):
            self.q_nb = product(self.q_nb, quaternion(dtheta))
        self.q_nb = product(self.back, self.q_nb)
        return self.q_nb / np.linalg.norm(self.q_nb, axis=-1, keepdims=True)


def quaternion(turn):
    """Return the quaternion (..., 4), scalar first, of a rotation vector (..., 3) in rad."""
    half = np.linalg.norm(turn, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), turn / 2 * np.sinc(half / np.pi)], axis=-1)


def product(p, q):
    """Return the Hamilton product of two quaternions (..., 4)."""
    (a, b, c, d), (e, f, g, h) = np.moveaxis(p, -1, 0), np.moveaxis(q, -1, 0)
    parts = a * e - b * f - c * g - d * h, a * f + b * e + c * h - d * g, a * g - b * h + c * e + d * f
    return np.stack([*parts, a * h + b * g - c * f + d * e], axis=-1)
