"""Estimators that know what a recording holds, apart from its tests: the processes that play them import nothing else."""

import numpy as np
import pymap3d
from oracles import made

from sins_env import attitude

T0 = 100.0


def motion(t):
    """A bend at 3 m/s: attitude, and metres E, N, U of the IMU from the site."""
    angle = 0.1 * (t - T0)
    enu = 30.0 * np.stack([1 - np.cos(angle), np.sin(angle), 0.01 * angle], axis=-1)
    return attitude.from_euler(angle, 0.1 * np.sin(t), 0 * t), enu


def place(enu):
    return np.stack([np.ravel(part) for part in pymap3d.enu2geodetic(*enu.T, *made.SITE.pos, deg=False)], axis=-1)


class Driven:
    """The motion, but position drifts by 0.02, -0.01, 0.05 m/s, velocity is off by 0.3, 0.4, -0.1 m/s, heading by 1 deg."""

    batched = True

    def reset(self, task, rng, num_runs=1):
        assert task.navigate
        self.runs = num_runs

    def step(self, obs):
        t = T0 + 10.0 * np.arange(self.runs) + obs["t"][:, 0]
        q, enu = motion(t)
        q = attitude.multiply(attitude.from_euler(np.radians(1.0), 0.0, 0.0), q)
        pos = place(enu + (t - T0)[:, None] * np.array([0.02, -0.01, 0.05]))
        angle = 0.1 * (t - T0)
        vel = 3.0 * np.stack([np.sin(angle), np.cos(angle), np.full_like(t, 0.01)], axis=-1)
        return np.concatenate([q, vel + np.array([0.3, 0.4, -0.1]), pos], axis=-1)


class Fixed:
    """Headings of 350 deg and more, 0.1 deg from window to window; the second row fails if it is told to."""

    batched = True

    def __init__(self, bad=False):
        self.bad = bad

    def reset(self, task, rng, num_runs=1):
        self.runs = num_runs

    def step(self, obs):
        heading = np.radians(350.0 + 0.1 * np.arange(self.runs))
        q = attitude.from_euler(heading, np.radians(1.0), np.radians(-2.0))
        if self.bad:
            q[1] = np.nan
        return q


class Breaks(Fixed):
    def step(self, obs):
        raise ArithmeticError("no square root")
