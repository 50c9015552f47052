"""A recording in memory: increments on a uniform clock, fixes and reference, in the frames of this package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.types import Site

LEAST_SATELLITES, MOST_RESIDUAL_M = 6, 0.03  #: limits within which a displacement can be relied on


class Gnss(NamedTuple):
    """Fixes of the antenna, on the clock of the IMU."""

    t_s: Array  #: (M,) times, s
    vel: Array | None  #: (M, 3) velocity E, N, U, m/s; None if the receiver's file holds positions only
    pos: Array  #: (M, 3) latitude rad, longitude rad, height m
    pos_std: Array | None = None  #: (M, 3) standard deviation E, N, U that the receiver states, m
    vel_std: Array | None = None  #: (M, 3) the same of the velocity, m/s


def stated(std: Array) -> Mask:
    """Return which fixes (M,) have a standard deviation in ``std`` (M, 3); zero means that the receiver states none."""
    return np.asarray((np.isfinite(std) & (std > 0)).all(axis=1))


class Readings(NamedTuple):
    """Readings of an aiding sensor, on the clock of the IMU, in the unit and the axes of its observation."""

    t_s: Array  #: (M,) times, s
    #: (M, size) readings; of an odometer the distance rolled so far; of a heading without a pitch East and North alone.
    values: Array
    unit: bool = False  #: whether they are vectors of length one, which tell a direction alone


class Reference(NamedTuple):
    """The states against which errors are taken: a smoothed solution at the IMU, not an independent truth."""

    t_s: Array  #: (L,) times, s
    q_nb: Array  #: (L, 4) attitude, Right-Forward-Up body to East-North-Up
    vel: Array | None  #: (L, 3) velocity E, N, U, m/s
    pos: Array | None  #: (L, 3) latitude rad, longitude rad, height m


class Displacements(NamedTuple):
    """Displacements of the antenna from the phase of the carrier, which neither fixes nor reference have used."""

    t_s: Array  #: (D,) ends of the intervals, s
    span_s: float  #: length of each interval, s
    enu: Array  #: (D, 3) displacement E, N, U, m
    satellites: Array  #: (D,) number of satellites
    residual_m: Array  #: (D,) RMS residual of the equations, m

    @property
    def usable(self) -> Mask:
        """Whether a displacement is redundant and consistent, (D,)."""
        return (self.satellites >= LEAST_SATELLITES) & (self.residual_m < MOST_RESIDUAL_M)


class Gap(NamedTuple):
    """A span without samples."""

    start: float  #: its start, s
    end: float  #: its end, s
    samples: int  #: number of missing samples

    def __str__(self) -> str:
        return f"{seconds(self.start)} to {seconds(self.end)} s ({self.samples} samples)"


class Stamping(NamedTuple):
    """How the stamps of the samples lay about the uniform clock."""

    jitter_s: float  #: RMS of the stamps about the clock, s
    worst_s: float  #: largest distance of a stamp from the clock, s
    batch: int  #: usual number of samples that share a stamp; 1 without batches
    evened: bool  #: whether the samples were put at their places on the fitted clock
    dropped: int  #: number of samples with a repeated stamp that were left out


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording. Sample k covers (t0 + k / rate_hz, t0 + (k + 1) / rate_hz]; arrays are shared and read-only."""

    name: str
    rate_hz: float
    t0: float  #: start of the first sample, s
    dtheta: Array  #: (N, 3) angle increments Right, Forward, Up, rad; NaN for missing samples
    dvel: Array  #: (N, 3) velocity increments Right, Forward, Up, m/s; NaN for missing samples
    site: Site
    gnss: Gnss | None = None
    lever_arm: Array | None = None  #: (3,) from the IMU to the antenna, Right, Forward, Up, m
    reference: Reference | None = None
    displacements: Displacements | None = None
    stamping: Stamping | None = None  #: how the stamps of the file lay about the clock; None for a file without stamps
    scale: str | None = None  #: "GPS" if times are absolute, seconds of GPS time since 1980-01-06; None if unknown
    bridged: tuple[Gap, ...] = ()  #: gaps that are filled with interpolated increments
    #: (G, 6, 6) covariance of what each bridge is off by in its whole length, angle in rad and velocity in m/s, R, F, U.
    bridge_cov: Array = field(default_factory=lambda: np.zeros((0, 6, 6)))
    aids: Mapping[str, Readings] = field(default_factory=dict)  #: readings of aiding sensors, by name

    @property
    def end(self) -> float:
        """End of the last sample, s."""
        return self.t0 + len(self.dtheta) / self.rate_hz

    @property
    def missing(self) -> Mask:
        """Whether a sample is missing, (N,)."""
        return np.isnan(self.dtheta[:, 0])

    @property
    def gaps(self) -> list[Gap]:
        """Gaps: the spans of missing samples, in order."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], self.missing, [False]]).astype(np.int8)))
        at = self.t0 + edges / self.rate_hz
        return [Gap(float(at[i]), float(at[i + 1]), int(edges[i + 1] - edges[i])) for i in range(0, len(edges), 2)]


def seconds(t: float) -> str:
    """Write a time to the microsecond; the seconds of a GPS week have six digits before the point."""
    return f"{t:.6f}".rstrip("0").rstrip(".")


def first_few(texts: list[str], most: int = 5) -> str:
    """Write the first ``most`` items of a list, for an error in one line."""
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return ", ".join(texts[:most]) + more


def frozen(array: Array) -> Array:
    """Make an array read-only, and return it."""
    array.flags.writeable = False
    return array
