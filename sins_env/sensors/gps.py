"""GPS fixes: velocity and position of the antenna plus errors, with outages, outliers, jumps and spoofing.

See docs/mathematics/simulation.md#fixes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask, Rngs
from sins_env.earth import displaced, radii_at
from sins_env.kernels import kernel
from sins_env.kernels.algebra import add, put_vector, times, vector
from sins_env.motion import Motion
from sins_env.sensors.imu import standard_normal
from sins_env.sensors.limits import MAX_AGE_S, MAX_SPEED, MAX_STD, POS_HIGH, POS_LOW, Field, clip
from sins_env.specs import AidSpec, GpsSpec

#: Velocity (runs, epochs, 3) in m/s, position (runs, epochs, 3), and 1 or 0 for a fix or none (runs, epochs, 1).
Fixes = tuple[Array, Array, NDArray[np.int8]]

#: The fields of an observation that have a fix.
FIELDS = {
    "gps_vel": Field.of(3, -MAX_SPEED, MAX_SPEED, "m/s, velocity fix East, North, Up at t; zeros without a fix"),
    "gps_pos": Field.of(3, POS_LOW, POS_HIGH, "latitude rad, longitude rad, height m; zeros without a fix"),
    "gps_valid": Field.mark("1 where there is a fix at t"),
}

#: The field that stands beside them if fixes are not made at the ends of epochs.
AGE = {"gps_age": Field.of(1, 0.0, MAX_AGE_S, "s, t less the time of the fix; zero without a fix")}

#: The fields that stand beside them if the receiver states the noise of each fix.
STD = {
    "gps_vel_std": Field.of(3, 0.0, MAX_STD, "m/s, standard deviation of gps_vel E, N, U; zeros without a fix"),
    "gps_pos_std": Field.of(3, 0.0, MAX_STD, "m, standard deviation of gps_pos E, N, U; zeros without a fix"),
}

GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  #: its multiples modulo 1 fill (0, 1) evenly
#: Assumed noise of zero-velocity updates: the base stands still but for disturbances, at a surveyed place.
ZERO_VELOCITY = GpsSpec(vel_std_mps=0.03, pos_std_m=1.0)


def epochs_per_fix(spec: GpsSpec | AidSpec, epoch_s: float) -> int:
    """Return the number of epochs of ``epoch_s`` s from one fix, or reading of an aid, to the next.

    Raises:
        ValueError: fixes that do not fall on the ends of epochs.
    """
    if spec.rate_hz is None:
        return 1
    ratio = 1.0 / (spec.rate_hz * epoch_s)
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9 * ratio:
        near = 1.0 / (max(round(ratio), 1) * epoch_s)
        name = getattr(spec, "name", "GPS")
        raise ValueError(
            f"{name} rate {spec.rate_hz:g} Hz with epochs of {epoch_s:g} s: fixes must fall on the ends of epochs; "
            f"allowed: {1 / epoch_s:g} Hz divided by a whole number, for instance {near:g} Hz"
        )
    return round(ratio)


def within(intervals: Iterable[tuple[float, float]], t: NDArray[np.floating[Any]]) -> Mask:
    """Return which of the times ``t`` (...), s, lie in one of the intervals, which are open at their start."""
    inside = np.zeros(t.shape, dtype=bool)
    for start, end in intervals:
        inside |= (t > start) & (t <= end)
    return inside


def received(spec: GpsSpec | AidSpec, t: NDArray[np.floating[Any]]) -> Mask:
    """Return which of the times ``t`` (...), s, lie outside the outages."""
    return ~within(spec.outages_s, t)


def zero_velocity_fixes(there: Mask, runs: int, pos: Array) -> Fixes:
    """Return zero-velocity updates at the known place ``pos``, in the form of :meth:`Gps.fixes`.

    ``there`` (epochs,) says which epochs end with one.
    """
    valid = np.broadcast_to(there[:, None], (runs, len(there), 1))
    return np.zeros((runs, len(there), 3)), valid * pos, valid.astype(np.int8)


def in_fields(fixes: Fixes) -> dict[str, NDArray[Any]]:
    """Return fixes as fields of observations, clipped to their limits in place."""
    vel, pos, valid = fixes
    for name, values in (("gps_vel", vel), ("gps_pos", pos)):
        clip(name, values, FIELDS)
    return {"gps_vel": vel, "gps_pos": pos, "gps_valid": valid}


def _horizontal(draws: Array) -> Array:
    """Return horizontal unit vectors (runs, 3) E, N, U whose directions are ``draws`` (runs,) of a full turn."""
    direction = 2 * np.pi * draws
    return np.stack([np.sin(direction), np.cos(direction), 0 * direction], axis=-1)


class ZeroVelocity:
    """Zero-velocity updates of a parked base without a receiver. Its own motion is their error."""

    def __init__(self, spec: GpsSpec, epoch_s: float, pos: Array) -> None:
        self.spec, self._every, self._pos = spec, epochs_per_fix(spec, epoch_s), pos

    def reset(self, streams: Sequence[Rngs]) -> None:
        """Do nothing, for these updates draw no errors."""

    def fixes(self, motion: Motion, first_epoch: int) -> Fixes:
        """Return the updates of a chunk of epochs, in the form of :meth:`Gps.fixes`."""
        runs, epochs = motion.state.vel.shape[:2]
        there = np.arange(first_epoch + 1, first_epoch + epochs + 1) % self._every == 0
        return zero_velocity_fixes(there, runs, self._pos)


class Gps:
    """A batch of receivers.

    Errors are drawn at every epoch, with a fix or without, so that another rate leaves the other errors as they were.
    """

    def __init__(self, spec: GpsSpec, epoch_s: float, duration_s: float, model: earth.Earth) -> None:
        self.spec, self.epoch_s, self._earth = spec, epoch_s, model
        self._every = epochs_per_fix(spec, epoch_s)
        self._duration = duration_s
        self._lever = np.asarray(spec.lever_arm_m)

    def reset(self, streams: Sequence[Rngs]) -> None:
        """Begin the runs. ``streams`` holds three generators for each: for noise, for outliers, and for jumps and spoofing."""
        self._noise, self._outliers, faults = zip(*streams, strict=True)
        draws, spec = np.stack([rng.random(4) for rng in faults]), self.spec
        self._jump = spec.jump_mps * _horizontal(draws[:, 0])
        self._jump_start, self._jump_end = self._spans(spec.jump_s, draws[:, 1])
        self._pull = spec.spoof_mps2 * _horizontal(draws[:, 2])
        self._pull_start, self._pull_end = self._spans(spec.spoof_s, draws[:, 3])

    def _spans(self, given: float | tuple[float, float], draws: Array) -> tuple[Array, Array]:
        """Return start and end (runs,) of an interval, s, or of a duration that begins at random by ``draws`` in (0, 1)."""
        if isinstance(given, tuple):
            start, end = np.full((2, len(draws)), np.array(given)[:, None])
            return start, end
        start = draws * max(self._duration - given, 0.0)
        return start, start + given

    def schedule(self, first_epoch: int, epochs: int) -> tuple[Mask, Array]:
        """Return which of the epochs after ``first_epoch`` hold a fix, and its age at their ends, s, (epochs,) each.

        The ages are the same in every run. A clock that does not keep step with the epochs spreads them evenly.
        """
        number = np.arange(first_epoch + 1, first_epoch + epochs + 1, dtype=np.float64)
        age = self.spec.age_s + self.spec.age_jitter_s * (GOLDEN * number % 1.0)
        made = number * self.epoch_s - age
        return (number % self._every == 0) & received(self.spec, made) & (made > -1e-9), age

    def fixes(self, motion: Motion, first_epoch: int) -> Fixes:
        """Return the fixes of a chunk of epochs that begins after ``first_epoch``.

        They are velocity (runs, epochs, 3), position (runs, epochs, 3) and validity (runs, epochs, 1). An epoch without
        a fix has zeros. The states of the ``motion`` are those at the times of the fixes.
        """
        runs, epochs = motion.state.vel.shape[:2]
        present, age = self.schedule(first_epoch, epochs)
        t = np.arange(first_epoch + 1, first_epoch + epochs + 1) * self.epoch_s - age
        vel, pos = motion.state.vel, motion.state.pos
        if self._lever.any():
            C_nb = attitude.to_dcm(motion.state.q_nb)
            vel = vel + np.matmul(C_nb, np.cross(motion.rate_eb_b, self._lever)[..., None])[..., 0]
            pos = earth.displace(self._earth, pos, C_nb @ self._lever)
        if self.spec.spoof_mps2:
            spoofed = (t > self._pull_start[:, None]) & (t <= self._pull_end[:, None])
            since = np.where(spoofed, t - self._pull_start[:, None], 0.0)[..., None]
            pulled = since * self._pull[:, None]
            vel, pos = vel + pulled, earth.displace(self._earth, pos, 0.5 * since * pulled)
        inside = (t > self._jump_start[:, None]) & (t <= self._jump_end[:, None])
        vel, pos = _fixed(
            vel,
            pos,
            self._errors(runs, epochs),
            self.spec.vel_std,
            self.spec.pos_std,
            self._jump[:, None],
            inside,
            present,
            self._earth.a,
            self._earth.e2,
        )
        if not self.spec.velocity:
            vel = np.zeros_like(vel)
        return vel, pos, np.broadcast_to(present[:, None], (runs, epochs, 1)).astype(np.int8)

    def _errors(self, runs: int, epochs: int) -> Array:
        """Draw the errors of each fix over their standard deviations, (runs, epochs, 6).

        They are Gaussian, and contamination or heavy tails scale all six by one factor.
        """
        unit = standard_normal(self._noise, (epochs, 6))
        dof, share = self.spec.heavy_tail_dof, self.spec.contamination
        if share:
            hit = np.stack([rng.random(epochs) for rng in self._outliers]) < share
            unit *= np.where(hit, np.sqrt(self.spec.contamination_factor), 1.0)[..., None]
        if dof:
            chi2 = np.stack([rng.chisquare(dof, epochs) for rng in self._outliers])
            unit *= np.sqrt(dof / chi2)[..., None]
        return unit


@kernel("(3),(3),(6),(3),(3),(3),(),(),(),()->(3),(3)", "dddddd??dddd")
def _fixed(
    vel: Array,
    pos: Array,
    unit: Array,
    vel_std: Array,
    pos_std: Array,
    jump: Array,
    jumps: bool,
    present: bool,
    a: float,
    e2: float,
    fixed_vel: Array,
    fixed_pos: Array,
) -> None:
    """Return the velocity and the position of a fix; zeros without one.

    Args:
        vel: true velocity of the antenna.
        pos: its true position.
        unit: errors of velocity and position over their standard deviations.
        vel_std: standard deviation of the velocity, m/s.
        pos_std: standard deviation of the position, m.
        jump: jump of the velocity, m/s.
        jumps: whether this fix is in the jump.
        present: whether there is a fix.
        a: semi-major axis of the ellipsoid, m.
        e2: its squared eccentricity.
    """
    if not present:
        fixed_vel[:], fixed_pos[:] = 0.0, 0.0
        return
    v, here = add(vector(vel), times(vector(vel_std), vector(unit))), vector(pos)
    put_vector(add(v, vector(jump)) if jumps else v, fixed_vel)
    R_M, R_N = radii_at(a, e2, here[0])
    put_vector(displaced(here, here, times(vector(pos_std), vector(unit[3:])), R_M, R_N), fixed_pos)
