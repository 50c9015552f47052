"""Ranges and range rates to navigation satellites, with the clock of the receiver as states: tight coupling.

The places of the satellites are given with each reading. They are taken to the local level of the INS, where errors of position
are straight; the curvature of the earth that is left out is 4 mm at 200 m. See docs/mathematics/aiding.md#ranges.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.states import Layout
from sins_env.types import Observation
from solvers.pipeline.aiding.aid import Ins, Sensor, State, field_of
from solvers.pipeline.errors.model import Parameter
from solvers.pipeline.strapdown import cross
from solvers.types import Measurement


@dataclass(frozen=True)
class Clock(Parameter):
    """A clock in m and its rate in m/s, which white noise of frequency and its random walk drive."""

    spec: Any = field(kw_only=True)

    @property
    def constant(self) -> bool:
        return False

    def carry(self, epoch_s: float) -> Array:
        return np.array([[1.0, epoch_s], [0.0, 1.0]])

    def added(self, epoch_s: float) -> Array:
        return np.asarray(self.spec.clock_noise(epoch_s))

    def start(self) -> Array:
        return np.diag([self.spec.clock_m**2, self.spec.clock_mps**2])


class Ranges(Sensor):
    """A receiver of ranges as an aid. The first half of the rows are ranges, the other their rates."""

    name = "ranges"
    _place: Array  #: (..., S, 3) m E, N, U from the INS to the satellites
    _far: Array  #: (..., S, 1) m, their distance; ranges are taken from here on, which keeps their last digits
    _vel: Array  #: (..., S, 3) m/s E, N, U

    @classmethod
    def states_of(cls, spec: Any) -> tuple[Parameter, ...]:
        clock = Clock("ranges.clock", 2, "m, m/s", std=spec.clock_m, fed=True, spec=spec)
        if not spec.multipath_m:
            return (clock,)
        wander = {"std": spec.multipath_m, "time_constant_s": spec.multipath_s}
        return clock, Parameter("ranges.multipath", spec.satellites, "m", fed=True, **wander)

    @classmethod
    def fits(cls, states: Layout) -> bool:
        return "dp" in states

    def prepare(self) -> None:
        self._lever, self._count = np.asarray(self.spec.lever_arm_m), self.spec.satellites
        self.rows = 2 * self._count
        self._earth = earth.get(self.task.site.earth)

    def read(self, obs: Observation, ins: Ins) -> Measurement | None:
        """Return the measurement at the end of an epoch; None if no run has a range."""
        now, pos = copy(self), ins.nav.pos
        satellites = field_of(obs, "satellites")
        to_n = earth.ecef_to_enu(pos[..., 0], pos[..., 1])[..., None, :, :]
        away = satellites[..., :3] - earth.to_ecef(self._earth, pos)[..., None, :]
        now._place = (to_n @ away[..., None])[..., 0]
        now._far = np.sqrt(np.sum(now._place**2, axis=-1, keepdims=True))
        now._vel = (to_n @ satellites[..., 3:, None])[..., 0]
        return super(Ranges, now).read(obs, ins)

    def told(self, obs: Observation, ins: Ins) -> tuple[Array, Mask]:
        valid = field_of(obs, "ranges_valid") == 1
        ranges = field_of(obs, "ranges") - self._far[..., 0]
        reading = np.concatenate([ranges, field_of(obs, "range_rates")], axis=-1)
        return reading, np.concatenate([valid, valid], axis=-1)

    def _seen(self, s: State) -> Seen:
        arm = (s.C @ self._lever[:, None])[..., 0]
        spin = (s.C @ cross(s.rate, np.broadcast_to(self._lever, s.rate.shape))[..., None])[..., 0]
        points = (slice(None),) * (self._place.ndim - 2) + (None,) * (s.vel.ndim + 1 - self._place.ndim)
        place, moved = self._place[points], (s.away + arm)[..., None, :]
        away, far = place - moved, self._far[points]
        distance = np.sqrt(np.sum(away * away, axis=-1, keepdims=True))
        nearer = np.sum((2.0 * place - moved) * moved, axis=-1, keepdims=True) / (distance + far)
        return Seen(arm, spin, away / distance, distance, -nearer, self._vel[points] - (s.vel + spin)[..., None, :])

    def value(self, s: State) -> Array:
        seen, clock = self._seen(s), s.own["ranges.clock"]
        ranges = seen.further[..., 0] + clock[..., :1]
        if "ranges.multipath" in s.own:
            ranges = ranges + s.own["ranges.multipath"]
        return np.concatenate([ranges, np.sum(seen.e * seen.speed, axis=-1) + clock[..., 1:]], axis=-1)

    def slopes(self, s: State) -> dict[str, Array]:
        seen = self._seen(s)
        e, zero = seen.e, np.zeros_like(seen.e)
        across = (seen.speed - e * np.sum(e * seen.speed, axis=-1, keepdims=True)) / seen.distance
        arm, spin = attitude.skew(seen.arm), attitude.skew(seen.spin)
        both = [[1.0, 0.0]] * self._count + [[0.0, 1.0]] * self._count
        found = {
            "turn": np.concatenate([e @ arm, across @ arm + e @ spin], axis=-2),
            "away": -np.concatenate([e, across], axis=-2),
            "vel": np.concatenate([zero, -e], axis=-2),
            "rate": np.concatenate([zero, e @ s.C @ attitude.skew(self._lever)], axis=-2),
            "ranges.clock": np.array(both),
        }
        if "ranges.multipath" in s.own:
            found["ranges.multipath"] = np.eye(self.rows, self._count)
        return found

    def covariance(self) -> Array:
        return self.noise()[..., None] * np.eye(self.rows)

    def noise(self) -> Array:
        factor = self.spec.seen(self._place[..., 2] / self._far[..., 0])
        return np.square(np.concatenate([self.spec.range_m * factor, self.spec.rate_mps * factor], axis=-1))


@dataclass(frozen=True)
class Seen:
    """Satellites as an antenna sees them, E, N, U."""

    arm: Array  #: (..., 3) m, from the IMU to the antenna
    spin: Array  #: (..., 3) m/s, its velocity about the IMU
    e: Array  #: (..., S, 3) unit vectors to the satellites
    distance: Array  #: (..., S, 1) m
    further: Array  #: (..., S, 1) m, the same less that of the INS
    speed: Array  #: (..., S, 3) m/s, velocity of the satellites less that of the antenna
