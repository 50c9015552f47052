"""Coarse alignment in the inertial frame: attitude from the drift of gravity, however the base moves.

In body axes frozen at the start, the specific force integrates to v_b(t) = integral of C_b^ib0 f dt. The same integral is
known from the earth's rotation, v_i(t) = - integral of g_i dt, plus the velocity of the base if a GPS tells it. Pairs of these
vectors give C_ib0^i, and C_b^n(t) = C_e^n C_i^e(t) C_ib0^i C_b^ib0(t).
Source: 000 (2.4.1-20), corrected; docs/mathematics/coarse_alignment.md#inertial-frame.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.types import Observation, Task
from solvers.pipeline.coarse.fits import Fit, triad
from solvers.pipeline.coarse.on_the_spot import OnTheSpot
from solvers.pipeline.coarse.spread import Spread, outer
from solvers.pipeline.strapdown import bridge_noise, carried_sample, chain, interval_increments

EARLY_SHARE = 50 / 180  #: share of the coarse phase after which two vectors take the first pair, 000 section 2.4


class InertialFrame(OnTheSpot, ABC):
    """The two integrals, batch first. The methods differ in how they keep and fit pairs of them."""

    def __init__(self, task: Task, batch: tuple[int, ...]) -> None:
        self._epoch_s, self._latitude = task.epoch_s, task.site.latitude
        model = earth.get(task.site.earth)
        self._gravity = float(earth.gravity(model, self._latitude, task.site.height))
        self._rate = model.rate
        self._enu = earth.ecef_to_enu(self._latitude, 0.0)  # the longitude of the start serves as zero
        self._k = 0
        self._q = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*batch, 4))
        self._v_b = np.zeros((*batch, 3))
        self._last: Array | None = None
        #: Covariance (..., 6, 6) of what bridged samples are off by, for the indices of the epochs that have any.
        self.bridged: dict[int, Array] = {}

    def add(self, obs: Observation) -> None:
        """Take one more epoch."""
        if (cov := bridge_noise(obs)) is not None:
            self.bridged[self._k] = np.array(cov)
        self._k += 1
        rotation, dvel_b = interval_increments(obs["dtheta"], obs["dvel"], self._last)
        self._last = carried_sample(obs["dtheta"], obs["dvel"])
        ends, steps = chain(rotation, dvel_b)
        self._integrate(steps)
        self._q = attitude.normalize(attitude.multiply(self._q, ends[..., -1, :]))
        self._keep(self._v_b, np.broadcast_to(self._gravity_integral(), self._v_b.shape), obs)

    @property
    def integrated(self) -> tuple[int, Array, Array]:
        """Number of epochs, integral of the force (..., 3) m/s, and attitude (..., 4), both in the body axes at the start."""
        return self._k, self._v_b, self._q

    def spread(self) -> Spread | None:
        """Return None: the motion of the base itself disturbs these pairs, and how much is not told."""
        return None

    def attitude(self) -> Array:
        """Return q_nb (..., 4) at the last epoch; level is known soon, azimuth as the directions of the pairs spread."""
        return attitude.from_dcm(self._C_i_n() @ self._fit() @ attitude.to_dcm(self._q))

    def _integrate(self, steps: Array) -> None:
        """Add the velocity increments (..., intervals, 3) of an epoch, in the body axes before it."""
        self._v_b = self._v_b + self._in_start_axes(steps.sum(axis=-2))

    @abstractmethod
    def _keep(self, v_b: Array, v_i: Array, obs: Observation) -> None:
        """Keep what the method needs of the pair (..., 3) at the end of this epoch."""

    @abstractmethod
    def _fit(self) -> Array:
        """Return C_ib0^i (..., 3, 3)."""

    def _in_start_axes(self, vector_b: Array) -> Array:
        """Turn a vector (..., 3) from the body axes of the last epoch into those at the start."""
        return np.matmul(attitude.to_dcm(self._q), vector_b[..., None])[..., 0]

    def _gravity_integral(self) -> Array:
        """Return v_i (3,) of a base at rest, 000 (2.4.16) with longitude 0, m/s."""
        w, t = self._rate, self._k * self._epoch_s
        level, up = np.cos(self._latitude), np.sin(self._latitude)
        return self._gravity * np.array([level * np.sin(w * t) / w, level * (1 - np.cos(w * t)) / w, t * up])

    def _C_i_n(self) -> Array:
        """Return C_e^n C_i^e(t), 000 (2.4.4)."""
        return self._enu @ earth_turn(self._rate * self._k * self._epoch_s).T


class TwoVector(InertialFrame):
    """The triad of the pairs at 50/180 of the time and at its end, anchored on the later one.

    Equation 000 (2.4.20) with no. 16 of docs/mathematics/errata.md corrected.
    """

    def __init__(self, task: Task, batch: tuple[int, ...]) -> None:
        super().__init__(task, batch)
        self._early = max(round(EARLY_SHARE * (task.coarse_s or task.duration_s) / task.epoch_s), 1)
        self._pair = self._first = (self._v_b, self._v_b)

    def _keep(self, v_b: Array, v_i: Array, obs: Observation) -> None:
        self._pair = v_b, v_i
        if self._k <= self._early:
            self._first = self._pair

    def _fit(self) -> Array:
        (v1_b, v1_i), (v2_b, v2_i) = self._first, self._pair
        if self._k <= self._early:  # one pair gives level, and any azimuth
            v1_b = v1_i = np.broadcast_to([0.0, 1.0, 0.0], v1_b.shape)
        return triad(v2_i, v1_i, v2_b, v1_b)


class AllPairs(InertialFrame):
    """Wahba's problem over all pairs since the start, weighted by their lengths.

    The disturbance of v_b has the same size at all times, so the published unit vectors give early pairs too much weight. With
    them the azimuth error after 180 s of sway is twice as large, 1.1 deg in place of 0.5 deg.
    """

    def __init__(self, task: Task, batch: tuple[int, ...], fit: Fit) -> None:
        super().__init__(task, batch)
        self._solve = fit
        self._profile = np.zeros((*batch, 3, 3))  # sum of v_i v_b'

    def _keep(self, v_b: Array, v_i: Array, obs: Observation) -> None:
        self._profile = self._profile + outer(v_i, v_b)

    def _fit(self) -> Array:
        return self._solve(self._profile)


def earth_turn(angle: float) -> Array:
    """Return C_e^i (3, 3) after the earth has turned by ``angle``, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
