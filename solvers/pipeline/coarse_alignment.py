"""Coarse alignment in the inertial frame: attitude from the drift of gravity, whatever the base does. equations.md D.1, D.2.

In axes frozen at the start, the body's specific force integrates to v_b(t) = integral of C_b^ib0 f dt and the same
integral is known from the earth's rotation, v_i(t) = - integral of g_i dt (+ the base's own velocity, if a GPS tells it).
Pairs of these vectors give C_ib0^i, and C_b^n(t) = C_e^n C_i^e(t) C_ib0^i C_b^ib0(t). Methods:

    two_vector   TRIAD of the pairs at 50/180 of the time and at its end (2.4.20, erratum 16)
    svd          Wahba's problem over all pairs, weighted by their length: the disturbance of v_b has the same size at all
                 times (unit vectors from 10 s on give twice the azimuth error: 1.1 deg against 0.5 after 180 s)
    aided        the same over differences across sliding windows, with the GPS velocity in v_i: neither the velocity at
                 the start nor one noisy fix can bias them
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.errors import unknown
from sins_env.types import Observation, Task
from solvers.pipeline.strapdown import carried_sample, chain, cross, end_rate, interval_increments

Array = NDArray[np.float64]

METHODS = ("two_vector", "svd", "aided")
#: what is left of the pairs before the first full window: enough to fill in directions no window has seen
EARLY_WEIGHT = 1e-4
EARLY_SHARE = 50 / 180  #: of the coarse phase at which the two-vector method takes its first vector, 000 section 2.4
WINDOW_S = 60.0  #: of the aided method, at most half of the coarse phase


def check_method(method: str) -> None:
    """Raises ValueError for an unknown method, with the nearest that exists."""
    if method not in METHODS:
        raise unknown("coarse method", method, METHODS)


class CoarseAlignment:
    """Collects the epochs of the coarse phase; batch first.

    Raises:
        ValueError: an unknown ``method``.
    """

    def __init__(self, task: Task, batch: tuple[int, ...], method: str = "svd") -> None:
        check_method(method)
        self.method, self._epoch_s, self._pos = method, task.epoch_s, task.site.pos
        model = earth.get(task.site.earth)
        latitude, _, height = self._pos
        self._gravity = float(earth.gravity(model, latitude, height))
        self._rate = model.rate
        self._rate_ie = earth.rate_n(model, latitude)
        self._lever = np.asarray(task.gps.lever_arm_m)
        self._enu = earth.ecef_to_enu(latitude, 0.0)  # the longitude of the start serves as zero
        self._k = 0
        self._q = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*batch, 4))
        self._v_b = np.zeros((*batch, 3))
        self._swept = np.zeros((*batch, 3))  # integral of C_n^i (omega_ie x v)
        self._last: Array | None = None
        self._first_pair: tuple[Array, Array] | None = None
        self._profile = np.zeros((*batch, 3, 3))  # sum of v_b v_i'
        self._early_profile = np.zeros((*batch, 3, 3))  # the same before the first window is full
        window = min(WINDOW_S, task.coarse_s / 2) if task.coarse_s else WINDOW_S
        self._lag = max(round(window / task.epoch_s), 1)
        if method == "aided":
            self._ring = np.zeros((2, self._lag, *batch, 3))
            self._ring_valid = np.zeros((self._lag, *batch, 1), dtype=bool)
            self._vel = np.zeros((*batch, 3))
        self._early = max(round(EARLY_SHARE * (task.coarse_s or task.duration_s) / task.epoch_s), 1)

    def add(self, obs: Observation) -> None:
        """One epoch more."""
        self._k += 1
        rotation, dvel_b = interval_increments(obs["dtheta"], obs["dvel"], self._last)
        self._last = carried_sample(obs["dtheta"], obs["dvel"])
        relative, _, steps = chain(rotation, dvel_b)
        self._v_b = self._v_b + np.matmul(attitude.to_dcm(self._q), steps.sum(axis=-2)[..., None])[..., 0]
        self._q = attitude.normalize(attitude.multiply(self._q, relative[..., -1, :]))
        v_i = np.broadcast_to(self._gravity_integral(self._k * self._epoch_s), self._v_b.shape)
        if self.method == "aided":
            self._add_window(self._v_b + self._antenna(obs), v_i + self._own_velocity(obs), obs["gps_valid"] == 1)
        elif self.method == "svd":
            self._profile = self._profile + self._v_b[..., :, None] * v_i[..., None, :]
        elif self._k <= self._early:
            self._first_pair = (self._v_b, v_i)

    def attitude(self) -> Array:
        """q_nb (..., 4) at the last epoch; level from the first epochs on, azimuth as the pairs spread."""
        t = self._k * self._epoch_s
        C_b0_i = self._triad(t) if self.method == "two_vector" else self._wahba()
        C = self._enu @ self._earth_turn(t) @ C_b0_i @ attitude.to_dcm(self._q)
        return attitude.from_dcm(C)

    def _gravity_integral(self, t: float) -> Array:
        """v_i(t) (3,) of a base at rest. (2.4.16), longitude 0."""
        w, latitude = self._rate, self._pos[0]
        level, up = np.cos(latitude), np.sin(latitude)
        return self._gravity * np.array([level * np.sin(w * t) / w, level * (1 - np.cos(w * t)) / w, t * up])

    def _earth_turn(self, t: float) -> Array:
        """C_i^e(t). (2.4.4)."""
        c, s = np.cos(self._rate * t), np.sin(self._rate * t)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def _own_velocity(self, obs: Observation) -> Array:
        """What the base's velocity adds to v_i: C_n^i v - C_n^i(0) v(0) + integral of C_n^i (omega_ie x v). D.2.

        The term at the start drops out of the differences. Without a fix the last velocity holds in the integral.
        """
        self._vel = np.where(obs["gps_valid"] == 1, obs["gps_vel"], self._vel)
        t = self._k * self._epoch_s
        C_n_i = (self._enu @ self._earth_turn(t)).T
        self._swept = self._swept + self._epoch_s * cross(self._rate_ie, self._vel) @ C_n_i.T
        return self._vel @ C_n_i.T + self._swept

    def _antenna(self, obs: Observation) -> Array:
        """Velocity of the antenna about the IMU in the axes of the start, (..., 3): the fixes are the antenna's."""
        if not self._lever.any():
            return np.zeros(3)
        about = cross(end_rate(obs["dtheta"], self._epoch_s), self._lever)
        return np.matmul(attitude.to_dcm(self._q), about[..., None])[..., 0]

    def _add_window(self, v_b: Array, v_i: Array, valid: NDArray[np.bool_]) -> None:
        """The difference across the window where both its ends have a fix; until one is full, the pair since the start."""
        slot = self._k % self._lag
        if self._k > self._lag:
            d_b, d_i = v_b - self._ring[0, slot], v_i - self._ring[1, slot]
            both = (valid & self._ring_valid[slot])[..., None]
            self._profile = self._profile + both * (d_b[..., :, None] * d_i[..., None, :])
        else:
            self._early_profile = self._early_profile + v_b[..., :, None] * v_i[..., None, :]
        self._ring[0, slot], self._ring[1, slot], self._ring_valid[slot] = v_b, v_i, valid

    def _wahba(self) -> Array:
        """C_ib0^i of the least-squares fit v_i = C v_b to all pairs. equations.md D.2."""
        # The pairs since the start, which the velocity there biases, fade out over the time of one more window: at once
        # they would leave windows of nearly one direction, and no azimuth.
        fade = max((1.0 - min(max(self._k / self._lag - 1.0, 0.0), 1.0)) ** 4, EARLY_WEIGHT)
        U, _, Vt = np.linalg.svd(self._profile + fade * self._early_profile)
        proper = np.linalg.det(U) * np.linalg.det(Vt)
        V = np.swapaxes(Vt, -1, -2).copy()
        V[..., 2] *= proper[..., None]
        return V @ np.swapaxes(U, -1, -2)

    def _triad(self, t: float) -> Array:
        """C_ib0^i from two pairs, anchored on the second. equations.md D.1.5."""
        assert self._first_pair is not None
        v1_b, v1_i = self._first_pair
        v2_i = np.broadcast_to(self._gravity_integral(t), self._v_b.shape)
        if self._k <= self._early:  # one pair only: level, any azimuth
            v1_b, v1_i = np.broadcast_to([0.0, 1.0, 0.0], v1_b.shape), np.broadcast_to([0.0, 1.0, 0.0], v1_b.shape)
        return _triad_axes(v2_i, v1_i) @ np.swapaxes(_triad_axes(self._v_b, v1_b), -1, -2)


def _triad_axes(main: Array, other: Array) -> Array:
    """Orthonormal axes as columns (..., 3, 3): along ``main``, along other x main, and their product."""
    first = main / np.linalg.norm(main, axis=-1, keepdims=True)
    second = cross(other, main)
    second = second / np.linalg.norm(second, axis=-1, keepdims=True)
    return np.stack([first, second, cross(first, second)], axis=-1)
