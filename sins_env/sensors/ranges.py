"""Pseudo-ranges and range rates to navigation satellites, with the clock of the receiver, for tight coupling.

    rho = |r_s - r| + c + m + n,    rho' = e' (v_s - v) + c' + n'

Here r and v are place and velocity of the antenna, those of the satellite are given, e points to it, and the clock c in m runs at
c' in m/s. The noise grows as the satellite sinks. See docs/mathematics/aiding.md#ranges.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, checks, earth
from sins_env.arrays import Array, Rngs
from sins_env.motion import Motion
from sins_env.sensors.aids import Sensor
from sins_env.sensors.gps import within
from sins_env.sensors.imu import GaussMarkov, standard_normal
from sins_env.sensors.limits import MAX_TIME, Field
from sins_env.specs import AidSpec, Check, correlation_time, intervals, lever_arm
from sins_env.trajectory import constellation
from sins_env.types import NavState
from sins_env.units import DEG

SPEED_OF_LIGHT = 299_792_458.0  #: m/s
MOST = constellation.PLANES * constellation.IN_PLANE


@dataclass(frozen=True)
class RangesSpec(AidSpec):
    """Errors of ranges and of the receiver's clock.

    A receiver follows the ``satellites`` that stand highest when the run begins, as long as they are above the mask. In the
    intervals ``few_s`` it has only the first ``few`` of them. ``range_m`` is the noise at the zenith.
    """

    name = "ranges"
    faults = ("few_s",)
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        # Brown & Hwang's table of clocks: a temperature-compensated crystal. White errors of ranges are optimistic.
        "tcxo": {},
        # an oven-controlled crystal of the same table
        "ocxo": {"clock_h0": 8e-20, "clock_h2": 4e-23},
        # what is left of orbits, clocks and the atmosphere wanders
        "single-frequency": {"multipath_m": 2.0},
    }
    special: ClassVar[Mapping[str, Check]] = {
        "satellites": partial(checks.whole, allowed=f"a whole number, 1 to {MOST}", least=1, most=MOST),
        "few": partial(checks.whole, allowed=f"a whole number, 0 to {MOST}", least=0, most=MOST),
        "few_s": intervals,
        "mask_deg": partial(checks.number, allowed="an angle in degrees, 0 to 80", least=0.0, most=80.0),
        "at_s": partial(checks.number, allowed=f"a number of seconds, 0 to {MAX_TIME:g}", least=0.0, most=MAX_TIME),
        "multipath_s": correlation_time,
        "lever_arm_m": lever_arm,
        **dict.fromkeys(("clock_h0", "clock_h2"), partial(checks.number, allowed="0 to 1e-9", least=0.0, most=1e-9)),
        **dict.fromkeys(("range_m", "rate_mps"), partial(checks.number, allowed="1e-4 to 1e6", least=1e-4, most=1e6)),
    }

    satellites: int = 6  #: number of satellites that the receiver follows
    range_m: float = 3.0  #: white noise of a range at the zenith; it is divided by the sine of the elevation
    rate_mps: float = 0.1  #: white noise of a range rate, in the same way
    multipath_m: float = 0.0  #: stationary sigma of a wandering error of each range
    multipath_s: float = 300.0  #: its correlation time
    clock_m: float = 100.0  #: clock at the start, 1 sigma
    clock_mps: float = 10.0  #: its rate at the start, 1 sigma
    clock_h0: float = 2e-19  #: white frequency noise of the clock, h0 in s
    clock_h2: float = 2e-20  #: random walk of its frequency, h-2 in 1/s
    mask_deg: float = 10.0  #: least elevation
    at_s: float = 0.0  #: time of the constellation when the run begins
    few_s: tuple[tuple[float, float], ...] = ()  #: intervals (start, end) with few satellites
    few: int = 3  #: number of satellites in them
    lever_arm_m: tuple[float, ...] = (0.0, 0.0, 0.0)  #: vector from the IMU to the antenna, R, F, U

    @property
    def densities(self) -> tuple[float, float]:
        """Densities of the noise that drives the clock, m^2/s, and its rate, (m/s)^2/s."""
        c2 = SPEED_OF_LIGHT**2
        return 0.5 * c2 * self.clock_h0, 2.0 * math.pi**2 * c2 * self.clock_h2

    def clock_noise(self, epoch_s: float) -> Array:
        """Return the covariance (2, 2) of what an epoch adds to clock and rate."""
        S_f, S_g = self.densities
        T = epoch_s
        return np.array([[S_f * T + S_g * T**3 / 3, S_g * T**2 / 2], [S_g * T**2 / 2, S_g * T]])

    def seen(self, sine: Array) -> Array:
        """Return the noise of a range over that at the zenith (..., S), for the sine of the elevation; at most that at 5 deg."""
        return 1.0 / np.maximum(sine, math.sin(5.0 * DEG))

    def followed(self, model: earth.Earth, pos: Array) -> NDArray[np.int64]:
        """Return the numbers (..., satellites) of those that stand highest above ``pos`` (..., 3) when the run begins."""
        place = constellation.satellites(model, np.array(self.at_s))[:, :3]
        height = constellation.up(model, pos, np.broadcast_to(place, (*pos.shape[:-1], *place.shape)))
        return np.asarray(np.argsort(-height, axis=-1)[..., : self.satellites])

    def visible(self, t: Array, sine: Array) -> NDArray[np.bool_]:
        """Return which satellites there are, (..., S), at the times ``t`` (...) and sines of elevation (..., S)."""
        there = sine >= math.sin(self.mask_deg * DEG)
        few = within(self.few_s, t)[..., None]
        return np.asarray(there & ~(few & (np.arange(sine.shape[-1]) >= self.few)))


class Ranges(Sensor[RangesSpec]):
    """A batch of receivers."""

    name = "ranges"
    specification = RangesSpec
    size, limit, what = 1, 1e9, "m, ranges with the clock of the receiver"

    def __init__(self, spec: RangesSpec, site: Any, epoch_s: float) -> None:
        super().__init__(spec, site, epoch_s)
        S = spec.satellites
        orbit = np.tile([1e8, 1e8, 1e8, 1e5, 1e5, 1e5], (S, 1))
        self.fields = {
            "ranges": Field.of(S, -self.limit, self.limit, f"{self.what}; zeros without one"),
            "range_rates": Field.of(S, -1e6, 1e6, "m/s, rates of the ranges; zeros without one"),
            "satellites": Field(
                -orbit, orbit, "m and m/s, place and velocity of each satellite in ECEF; zeros without one"
            ),
            "ranges_valid": Field.mark("1 where there is a range to the satellite at t", S),
        }
        self._lever = np.asarray(spec.lever_arm_m)

    def draw(self, rngs: Rngs) -> None:
        spec, S = self.spec, self.spec.satellites
        self._clock = standard_normal(rngs, (2,)) * [spec.clock_m, spec.clock_mps]
        noise = spec.clock_noise(self.epoch_s)
        values, axes = np.linalg.eigh(noise)
        self._drive = axes * np.sqrt(np.maximum(values, 0.0))
        rows = [rng.spawn(S + 1) for rng in self._markov]
        self._drift = [row[0] for row in rows]
        self._wander = []
        for i in range((S + 2) // 3):  # a Gauss-Markov error has three components
            self._wander.append(GaussMarkov(spec.multipath_m, spec.multipath_s, self.epoch_s))
            self._wander[-1].reset([row[1 + i] for row in rows])

    def begin(self, truth: NavState) -> None:
        self._number = self.spec.followed(self.earth, truth.pos)

    def measure(self, motion: Motion, first_epoch: int) -> Array:
        """Return ranges, rates, satellites and their sine of elevation, (runs, epochs, S, 9)."""
        spec, state = self.spec, motion.state
        runs, epochs = state.vel.shape[:2]
        t = np.arange(first_epoch + 1, first_epoch + epochs + 1) * self.epoch_s
        orbits = constellation.satellites(self.earth, spec.at_s + t)  # (epochs, 24, 6)
        followed = np.moveaxis(orbits[:, self._number], 0, 1)  # (runs, epochs, S, 6)
        C = attitude.to_dcm(state.q_nb)
        to_ecef = earth.ecef_to_enu(state.pos[..., 0], state.pos[..., 1]).mT
        arm = (C @ self._lever[:, None])[..., 0]
        spin = (C @ np.cross(motion.rate_eb_b, self._lever)[..., None])[..., 0]
        place = earth.to_ecef(self.earth, state.pos) + (to_ecef @ arm[..., None])[..., 0]
        vel = (to_ecef @ (state.vel + spin)[..., None])[..., 0]
        away = followed[..., :3] - place[..., None, :]
        distance = np.linalg.norm(away, axis=-1)
        speed = np.sum(away * (followed[..., 3:] - vel[..., None, :]), axis=-1) / distance
        sine = np.asarray((away @ to_ecef[..., :, 2:])[..., 0] / distance)
        clock = self._run_clock(epochs)
        wander = np.concatenate([one.samples(epochs) for one in self._wander], axis=-1)[..., : spec.satellites]
        unit = self.white(1.0, motion, 2 * spec.satellites).reshape(runs, epochs, spec.satellites, 2)
        factor = spec.seen(sine)
        ranges = distance + clock[..., :1] + wander + spec.range_m * factor * unit[..., 0]
        rates = speed + clock[..., 1:] + spec.rate_mps * factor * unit[..., 1]
        return np.concatenate([np.stack([ranges, rates, sine], axis=-1), followed], axis=-1)

    def _run_clock(self, epochs: int) -> Array:
        """Return clock in m and its rate in m/s at the ends of the next epochs, (runs, epochs, 2)."""
        drive = standard_normal(self._drift, (epochs, 2)) @ self._drive.T
        out = np.empty_like(drive)
        for k in range(epochs):
            self._clock = self._clock + [1.0, 0.0] * (self.epoch_s * self._clock[:, ::-1]) + drive[:, k]
            out[:, k] = self._clock
        return out

    def readings(self, motion: Motion, first_epoch: int) -> dict[str, NDArray[Any]]:
        runs, epochs = motion.state.vel.shape[:2]
        made = self.measure(motion, first_epoch)
        t = np.arange(first_epoch + 1, first_epoch + epochs + 1) * self.epoch_s
        there = self.spec.visible(np.broadcast_to(t, (runs, epochs)), made[..., 2])
        there &= self.present(first_epoch, epochs)[:, None]
        made = np.where(there[..., None], made, 0.0)
        return {
            "ranges": made[..., 0].copy(),
            "range_rates": made[..., 1].copy(),
            "satellites": made[..., 3:].copy(),
            "ranges_valid": there.astype(np.int8),
        }
