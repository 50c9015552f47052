"""The true motion of a flight along the segments of a plan, exact to rounding.

Velocity and attitude are closed forms of time, and so are specific force and angular rate once the position is known.
The position follows from the velocity by Gauss-Legendre collocation with five nodes per IMU sample. Its implicit
equations are solved by fixed-point iteration, for all samples of a chunk at once. The increments are integrated at the
same nodes. The flight is the same in every run, so that one computation serves the whole batch.
See docs/mathematics/simulation.md#flight-truth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.arrays import Array, Rngs
from sins_env.motion import Motion
from sins_env.trajectory.plan import FlightPlan, Kinematics
from sins_env.types import NavState

#: Fixed-point iterations. Each gains four digits or more on a chunk of 60 km, because the radii hardly depend on latitude.
_ITERATIONS = 4
_CATCH_UP = 300  #: IMU samples computed at once on the way to a chunk that is asked for out of order


def _collocation(nodes: int) -> tuple[Array, Array, Array]:
    """Return nodes c, weights b and the matrix A of Gauss-Legendre collocation on (0, 1).

    A_ij is the integral of the j-th Lagrange polynomial from 0 to c_i.
    """
    x, w = np.polynomial.legendre.leggauss(nodes)
    c = 0.5 * (x + 1.0)
    powers = np.arange(nodes)
    A = (c[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(c[:, None] ** powers)
    return c, 0.5 * w, A


class Flight:
    """A batch of identical flights with epochs of ``epoch_s`` s and ``n_sub`` IMU samples in each.

    Raises:
        ValueError: a segment that ends between two IMU samples.
    """

    def __init__(self, plan: FlightPlan, epoch_s: float, n_sub: int) -> None:
        self.plan, self.epoch_s, self.n_sub = plan, epoch_s, n_sub
        self._dt = epoch_s / n_sub
        plan.check_grid(self._dt)
        self._earth = earth.get(plan.earth)
        self._c, self._b, self._A = _collocation(5)
        self._runs = 1
        self._rewind()

    def reset(self, rngs: Rngs) -> NavState:
        """Return the true states at t = 0, (runs, ...). A flight draws nothing; the generators give the number of runs."""
        self._runs = len(rngs)
        self._rewind()
        start = self.plan.kinematics(np.zeros(1), np.zeros(1, dtype=np.intp))
        state = NavState(attitude.from_euler(*start.angles.T), start.vel, self._pos[None])
        return NavState(*(np.broadcast_to(part, (self._runs, part.shape[-1])) for part in state))

    def chunk(self, first_epoch: int, num_epochs: int) -> Motion:
        """Return the motion in epochs first_epoch + 1 ... first_epoch + num_epochs, as read-only views."""
        if first_epoch < self._epoch:
            self._rewind()
        while self._epoch < first_epoch:
            self._advance(min(first_epoch - self._epoch, max(1, _CATCH_UP // self.n_sub)))
        motion = self._advance(num_epochs)
        state = NavState(*(self._spread(part) for part in motion.state))
        return Motion(self._spread(motion.dtheta), self._spread(motion.dvel), state, self._spread(motion.rate_eb_b))

    def earlier(self, after: NavState, t: Array, age: Array) -> tuple[NavState, Array]:
        """Return the true states and omega_eb^b at the times t - age, (runs, len(t), ...), as read-only views."""
        then = t - age
        inside = then[:, None] + age[:, None] * self._c
        moved = age[:, None] * (self._b @ self.plan.kinematics(inside, self._segment(inside)).vel)
        now = self.plan.kinematics(then, self._segment(then))
        place = after.pos[0]
        pos = earth.displace(self._earth, place, -moved, at=earth.displace(self._earth, place, -0.5 * moved))
        rate = attitude.body_rate(now.angles, now.rates) + self._turned(now, self._transport(now.vel, pos))
        state = NavState(attitude.from_euler(*now.angles.T), now.vel, pos)
        return NavState(*(self._spread(part) for part in state)), self._spread(rate)

    def _segment(self, t: Array) -> NDArray[np.intp]:
        """Return the index of the segment in which each time lies; at a border it is the one that ends."""
        return np.minimum(np.searchsorted(self.plan.ends_s, t), len(self.plan.segments) - 1)

    def _rewind(self) -> None:
        self._epoch, self._pos = 0, self.plan.site.pos

    def _spread(self, part: Array) -> Array:
        """Repeat an array for every run, as a read-only view."""
        return np.broadcast_to(part, (self._runs, *part.shape))

    def _advance(self, epochs: int) -> Motion:
        """Compute the next epochs of one flight, without a run axis."""
        first = self._epoch * self.n_sub
        edges = np.arange(first, first + epochs * self.n_sub + 1, dtype=np.float64) * self._dt
        middles = edges[:-1] + 0.5 * self._dt
        segment = self._segment(middles)
        inside = self.plan.kinematics(edges[:-1, None] + self._dt * self._c, segment[:, None])
        pos, ends = self._positions(inside.vel)
        rate, force = self._sensed(inside, pos)
        shape = (epochs, self.n_sub, 3)
        dtheta, dvel = (self._dt * np.matmul(self._b, part).reshape(shape) for part in (rate, force))
        # rates may jump at a border; there the segment that ends counts
        last = slice(self.n_sub - 1, None, self.n_sub)
        now = self.plan.kinematics(edges[1:][last], segment[last])
        q_nb = attitude.from_euler(*now.angles.T)
        rate_eb_b = attitude.body_rate(now.angles, now.rates) + self._turned(now, self._transport(now.vel, ends[last]))
        self._epoch, self._pos = self._epoch + epochs, ends[-1]
        return Motion(dtheta, dvel, NavState(q_nb, now.vel, ends[last]), rate_eb_b)

    def _positions(self, vel: Array) -> tuple[Array, Array]:
        """Integrate the velocity at the nodes to positions.

        They are at the nodes (samples, nodes, 3) and at the ends of the samples (samples, 3).
        """
        inside, ends = np.empty(vel.shape), np.empty((len(vel), 3))
        inside[..., 2], ends[:, 2] = self._integral(vel[..., 2], self._pos[2])
        inside[..., 0] = self._pos[0]
        for _ in range(_ITERATIONS):
            R_M, R_N = earth.radii(self._earth, inside[..., 0])
            inside[..., 0], ends[:, 0] = self._integral(vel[..., 1] / (R_M + inside[..., 2]), self._pos[0])
        east = vel[..., 0] / ((R_N + inside[..., 2]) * np.cos(inside[..., 0]))
        inside[..., 1], ends[:, 1] = self._integral(east, self._pos[1])
        ends[:, 1] = attitude.wrap(ends[:, 1])
        return inside, ends

    def _integral(self, rate: Array, start: float) -> tuple[Array, Array]:
        """Integrate a rate at the nodes (samples, nodes): values at the nodes and at the ends of the samples."""
        corners = np.cumsum(np.concatenate([[start], self._dt * (rate @ self._b)]))
        return corners[:-1, None] + self._dt * (rate @ self._A.T), corners[1:]

    def _transport(self, vel: Array, pos: Array) -> Array:
        """Return the transport rate omega_en in n, rad/s, (..., 3)."""
        return np.matmul(earth.transport_matrix(self._earth, pos[..., 0], pos[..., 2]), vel[..., None])[..., 0]

    @staticmethod
    def _turned(at: Kinematics, vector_n: Array) -> Array:
        """Return a vector of n in body axes."""
        C_nb = attitude.to_dcm(attitude.from_euler(*np.moveaxis(at.angles, -1, 0)))
        return np.matmul(np.swapaxes(C_nb, -1, -2), vector_n[..., None])[..., 0]

    def _sensed(self, at: Kinematics, pos: Array) -> tuple[Array, Array]:
        """Return omega_ib^b and f^b, (..., 3) each. See docs/mathematics/simulation.md#increments."""
        rate_ie, rate_en = earth.rate_n(self._earth, pos[..., 0]), self._transport(at.vel, pos)
        force = at.accel + np.cross(2.0 * rate_ie + rate_en, at.vel)
        force[..., 2] += earth.gravity(self._earth, pos[..., 0], pos[..., 2])
        rate = attitude.body_rate(at.angles, at.rates) + self._turned(at, rate_ie + rate_en)
        return rate, self._turned(at, force)
