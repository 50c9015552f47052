"""Coarse alignment in the inertial frame with the velocity of the base, from a GPS or a zero-velocity update.

Equations: docs/mathematics/coarse_alignment.md#velocity-aid.
"""

from __future__ import annotations

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.types import Observation, Task
from solvers.pipeline.coarse.fits import Fit
from solvers.pipeline.coarse.inertial import AllPairs, earth_turn
from solvers.pipeline.coarse.spread import Readings, Spread, of_pairs, outer, profile
from solvers.pipeline.strapdown import cross, end_rate

WINDOW_S = 60.0  #: s, length of a window; it is cut to half of the coarse phase if that is shorter
#: Weight that the pairs before the first full window keep, enough for directions that no window has seen.
EARLY_WEIGHT = 1e-4


class Windows(AllPairs):
    """Wahba's problem over the differences across sliding windows, with the velocity of the base in v_i.

    Neither the velocity at the start nor a single noisy fix can bias the differences. A window counts only if both its ends
    have a fix.
    """

    def __init__(self, task: Task, batch: tuple[int, ...], fit: Fit) -> None:
        super().__init__(task, batch, fit)
        self._rate_ie = earth.rate_n(earth.get(task.site.earth), self._latitude)
        self._lever = np.asarray(task.gps.lever_arm_m)
        self._vel = np.zeros((*batch, 3))
        self._swept = np.zeros((*batch, 3))  # integral of C_n^i (omega_ie x v)
        window = min(WINDOW_S, task.coarse_s / 2) if task.coarse_s else WINDOW_S
        self._lag = max(round(window / task.epoch_s), 1)
        self._ring = np.zeros((2, self._lag, *batch, 3))
        self._ring_valid = np.zeros((self._lag, *batch, 1), dtype=bool)
        self._early_profile = np.zeros((*batch, 3, 3))  # profile of the pairs before the first window is full
        self._prior, self._spread_at = task.prior, round(task.coarse_s / task.epoch_s)
        self._seen: list[tuple[Array, ...]] = []  # of each epoch, as far as the spread is asked for

    def _keep(self, v_b: Array, v_i: Array, obs: Observation) -> None:
        """Add the difference across a window whose ends have a fix; until a window is full, the pair since the start."""
        force = v_b
        v_b, v_i, valid = v_b + self._antenna(obs), v_i + self._own_velocity(obs), obs["gps_valid"] == 1
        if self._k <= self._spread_at:
            self._seen.append((force, v_b, self._q, valid))
        slot = self._k % self._lag
        if self._k > self._lag:
            both = (valid & self._ring_valid[slot])[..., None]
            self._profile = self._profile + both * outer(v_i - self._ring[1, slot], v_b - self._ring[0, slot])
        else:
            self._early_profile = self._early_profile + outer(v_i, v_b)
        self._ring[0, slot], self._ring[1, slot], self._ring_valid[slot] = v_b, v_i, valid

    def _fit(self) -> Array:
        return self._solve(self._profile + self._fade() * self._early_profile)

    def _fade(self) -> float:
        """Return the weight of the pairs before the first full window."""
        # The velocity at the start biases the pairs since the start, so they fade out over the time of one more window.
        # If they were dropped at once, the windows left would have nearly one direction, and give no azimuth.
        return max((1.0 - min(max(self._k / self._lag - 1.0, 0.0), 1.0)) ** 4, EARLY_WEIGHT)

    def spread(self) -> Spread | None:
        """Return what the attitude is off by at the end of the coarse phase; None at other times."""
        K, L = len(self._seen), self._lag
        if not K or self._k != K or K <= L:
            return None
        force, v_b, q, valid = (np.stack(parts) for parts in zip(*self._seen, strict=True))
        C = self._fit()
        u = np.matmul(C, v_b[..., None])[..., 0]
        du = np.diff(np.matmul(C, force[..., None])[..., 0], axis=0, prepend=0.0)
        pairs = (u[L:] - u[:-L]) * (valid[L:] & valid[:-L])
        c = np.zeros(u.shape)
        c[:L] += self._fade() * u[:L]
        weighted = profile(c[:L], u[:L]) + profile(pairs, pairs)
        c[L:] += pairs
        c[:-L] -= pairs
        N = np.trace(weighted, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - weighted
        angle = self._rate * self._epoch_s * np.arange(1, K + 1)
        C_n = np.stack([earth_turn(one) for one in angle]) @ self._enu.T
        starts = np.concatenate([np.broadcast_to([1.0, 0.0, 0.0, 0.0], (1, *q.shape[1:])), q[:-1]])

        def C_b(part: slice) -> Array:
            return 0.5 * C @ (attitude.to_dcm(starts[part]) + attitude.to_dcm(q[part]))

        R = C_n @ self._prior.R[:3, :3] @ C_n.mT
        readings = Readings(c, R.reshape(K, *(1,) * (N.ndim - 2), 3, 3))
        return of_pairs(du, c, N, C_b, C_n, self._epoch_s, self._prior, readings, self.bridged)

    def _own_velocity(self, obs: Observation) -> Array:
        """Return what the velocity of the base adds to v_i, C_n^i v + integral of C_n^i (omega_ie x v), (..., 3) m/s.

        The constant term -C_n^i(0) v(0) is left out, because it drops out of the differences. Between fixes the last velocity
        holds in the integral.
        """
        self._vel = np.where(obs["gps_valid"] == 1, obs["gps_vel"], self._vel)
        C_n_i = self._C_i_n().T
        self._swept = self._swept + self._epoch_s * cross(self._rate_ie, self._vel) @ C_n_i.T
        return self._vel @ C_n_i.T + self._swept

    def _antenna(self, obs: Observation) -> Array:
        """Return the velocity of the antenna about the IMU in the body axes at the start, (..., 3) m/s."""
        if not self._lever.any():
            return np.zeros(3)
        return self._in_start_axes(cross(end_rate(obs["dtheta"], self._epoch_s), self._lever))
