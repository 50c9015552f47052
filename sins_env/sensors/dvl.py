"""Doppler log (DVL): the velocity over ground, or through the water, along its own axes.

    y = (1 + k) (I - [alpha x]) (C' (v - c) + omega_eb x l) + n

The scale error k and the mounting angles alpha are constants of a run. The current c, E and N, is zero for a bottom track and
wanders for a water track. A log may lose the bottom, in stated or in drawn intervals. See docs/mathematics/aiding.md#doppler-log.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np

from sins_env import checks
from sins_env.arrays import Array, Mask, Rngs
from sins_env.motion import Motion
from sins_env.sensors.aids import Sensor
from sins_env.sensors.gps import within
from sins_env.sensors.imu import standard_normal
from sins_env.sensors.limits import MAX_SPEED
from sins_env.specs import AidSpec, Check, correlation_time, durations_or_intervals, lever_arm
from sins_env.units import PPM

TRACKS = ("bottom", "water")  #: allowed values of ``track``
WITHOUT_LOCK = ("nothing", "water")  #: allowed values of ``without_lock``


@dataclass(frozen=True)
class DvlSpec(AidSpec):
    """Errors of a Doppler log. Scale error and mounting angles are 1-sigma values; each run draws its own.

    Without the lock on the bottom a log reads nothing, or switches to the water and does not say so.
    """

    name = "dvl"
    faults = ("lock_lost_s", "lock_held_s", "without_lock")
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "bottom": {},
        "water": {"track": "water"},
        # Water Linked A50: long-term accuracy of 1 %, or 0.1 % in the version "Performance"
        "a50": {"scale_ppm": 10_000.0},
        "a50-performance": {"scale_ppm": 1000.0},
        # DP-D300A: 0.3 % and 3 mm/s
        "dp-d300a": {"scale_ppm": 3000.0, "noise_mps": 0.003},
    }
    special: ClassVar[Mapping[str, Check]] = {
        "track": partial(checks.choice, allowed=TRACKS),
        "lever_arm_m": lever_arm,
        "current_s": correlation_time,
        "lock_lost_s": durations_or_intervals,
        "lock_held_s": correlation_time,
        "without_lock": partial(checks.choice, allowed=WITHOUT_LOCK),
    }

    noise_mps: float = 0.01  #: white noise of each axis
    scale_ppm: float = 2000.0  #: scale error
    mounting_mrad: float = 3.0  #: angles of its axes about R, F, U of the IMU
    lever_arm_m: tuple[float, ...] = (0.0, 0.0, 0.0)  #: vector from the IMU to the log, R, F, U
    track: str = "bottom"  #: "bottom" or "water"
    current_mps: float = 0.2  #: stationary sigma of each component of the current, for a water track
    current_s: float = 1800.0  #: its correlation time
    #: intervals (start, end) without lock on the bottom, or the mean length of losses that each run draws
    lock_lost_s: float | tuple[tuple[float, float], ...] = 0.0
    lock_held_s: float = 60.0  #: mean time from the end of a drawn loss to the next
    without_lock: str = "nothing"  #: what a log gives then: "nothing", or "water", its velocity through the water

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lock_lost_s and self.track == "water":
            lost = checks.shown(self.lock_lost_s)
            raise ValueError(f'DvlSpec.lock_lost_s = {lost} with track = "water"; allowed: with track = "bottom"')


class Dvl(Sensor[DvlSpec]):
    """A batch of Doppler logs."""

    name = "dvl"
    specification = DvlSpec
    size, limit, what = 3, 2 * MAX_SPEED, "m/s, velocity along the axes Right, Forward, Up of the Doppler log"

    def draw(self, rngs: Rngs) -> None:
        unit, spec = standard_normal(rngs, (4,)), self.spec
        self._scale = 1.0 + spec.scale_ppm * PPM * unit[:, 0]
        self._mounting = 1e-3 * spec.mounting_mrad * unit[:, 1:]
        in_water = spec.track == "water" or spec.without_lock == "water"
        self._current = self.wandering(spec.current_mps if in_water else 0.0, spec.current_s)
        self._losses, self._lost_before = [rng.spawn(1)[0] for rng in rngs], np.zeros(len(unit), dtype=bool)

    def measure(self, motion: Motion, first_epoch: int) -> Array:
        spec, epochs = self.spec, motion.state.vel.shape[1]
        lost = self._lost(first_epoch, epochs)[..., None]
        current = self._current.samples(epochs) * [1.0, 1.0, 0.0]
        if spec.track == "bottom":
            current = np.where(lost, current, 0.0)
        y = self.body_velocity(motion, np.asarray(spec.lever_arm_m), current)
        y = y - np.cross(self._mounting[:, None], y)
        y = self._scale[:, None, None] * y + self.white(spec.noise_mps, motion)
        return y if spec.without_lock == "water" else np.where(lost, np.nan, y)

    def _lost(self, first_epoch: int, epochs: int) -> Mask:
        """Return in which epochs after ``first_epoch`` the runs have no lock on the bottom, (runs, epochs)."""
        spec, shape = self.spec, (len(self._losses), epochs)
        if isinstance(spec.lock_lost_s, tuple):
            return np.broadcast_to(within(spec.lock_lost_s, self.ends(first_epoch, epochs)), shape)
        lost = np.zeros(shape, dtype=bool)
        if not spec.lock_lost_s:
            return lost
        draws, now = np.stack([rng.random(epochs) for rng in self._losses]), self._lost_before
        loses, regains = (-math.expm1(-self.epoch_s / mean) for mean in (spec.lock_held_s, spec.lock_lost_s))
        for k in range(epochs):
            now = np.where(now, draws[:, k] >= regains, draws[:, k] < loses)
            lost[:, k] = now
        self._lost_before = now
        return lost
