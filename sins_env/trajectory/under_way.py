"""A course under way: speed, course and attitude that waves and smooth steps make, in closed form.

A car keeps its velocity along its own forward axis. A ship has its speed along the course and drifts sideways and up and down,
and its bow yaws about the course. See docs/mathematics/simulation.md#flight-profiles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.trajectory.plan import FlightPlan, Kinematics
from sins_env.units import DEG


@dataclass(frozen=True)
class Signal:
    """A mean with waves a sin(2 pi t / T + p), of rows (a, T in s, p in rad), and steps d (1 + tanh((t - t0) / s)) / 2.

    The rows of steps are (d, t0 in s, s in s).
    """

    mean: float = 0.0
    waves: tuple[tuple[float, float, float], ...] = ()
    steps: tuple[tuple[float, float, float], ...] = ()

    def at(self, t: Array, unit: float = 1.0) -> tuple[Array, Array]:
        """Return the values at times ``t`` s and their derivatives, times ``unit``."""
        value, rate = np.full(t.shape, self.mean), np.zeros(t.shape)
        for amplitude, period, phase in self.waves:
            w = 2.0 * np.pi / period
            value, rate = value + amplitude * np.sin(w * t + phase), rate + amplitude * w * np.cos(w * t + phase)
        for size, middle, over in self.steps:
            u = np.tanh((t - middle) / over)
            value, rate = value + 0.5 * size * (1.0 + u), rate + 0.5 * size * (1.0 - u * u) / over
        return unit * value, unit * rate


@dataclass(frozen=True)
class UnderWay(FlightPlan):
    """A plan whose single segment has the length, and whose motion is that of signals; angles in deg, velocities in m/s.

    Start, speed and heading of the plan are those of the means.
    """

    speed: Signal = Signal()
    course: Signal = Signal()
    pitch: Signal = Signal()
    roll: Signal = Signal()
    yaw: Signal = Signal()  #: heading of a ship against its course
    across: Signal = Signal()  #: velocity of a ship to the right of its course
    heave: Signal = Signal()  #: vertical velocity of a ship
    climbs: bool = False  #: whether the velocity follows the pitch, as that of a car does

    def kinematics(self, t: Array, segment: NDArray[np.intp]) -> Kinematics:
        """Return velocity and attitude with their derivatives at times ``t`` s; the results are (..., 3)."""
        t = np.asarray(np.broadcast_arrays(t, segment)[0], dtype=float)
        (s, ds), (side, dside), (up, dup) = (one.at(t) for one in (self.speed, self.across, self.heave))
        angles = (self.course, self.pitch, self.roll, self.yaw)
        (c, dc), (p, dp), (r, dr), (y, dy) = (one.at(t, DEG) for one in angles)
        sc, cc, zero = np.sin(c), np.cos(c), np.zeros(t.shape)
        sp, cp, dslope = (np.sin(p), np.cos(p), dp) if self.climbs else (zero, np.ones(t.shape), zero)
        forward, right = np.stack([cp * sc, cp * cc, sp], axis=-1), np.stack([cc, -sc, zero], axis=-1)
        rising = np.stack([-sp * sc, -sp * cc, cp], axis=-1)  # d forward = cp dc right + dslope rising
        backward = np.stack([-sc, -cc, zero], axis=-1)  # d right = dc backward
        vertical = np.array([0.0, 0.0, 1.0])

        def times(scalar: Array, vector: Array) -> Array:
            return scalar[..., None] * vector

        vel = times(s, forward) + times(side, right) + times(up, vertical)
        accel = times(ds, forward) + times(s * cp * dc, right) + times(s * dslope, rising)
        accel = accel + times(dside, right) + times(side * dc, backward) + times(dup, vertical)
        return Kinematics(vel, accel, np.stack([c + y, p, r], axis=-1), np.stack([dc + dy, dp, dr], axis=-1))

    def check_grid(self, dt: float) -> None:
        """Do nothing, because no rate jumps."""

    def summary(self) -> list[tuple[str, Array]]:
        """Return one row, "under way" with the end: time in s, speed in m/s, then heading, pitch and roll in deg."""
        end = self.kinematics(self.ends_s, np.zeros(1, dtype=np.intp))
        speed = np.linalg.norm(end.vel[0])
        return [("under way", np.concatenate([self.ends_s, [speed], end.angles[0] / DEG]))]
