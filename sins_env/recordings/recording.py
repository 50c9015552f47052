"""One recording in memory: increments on a uniform clock, fixes and reference, in the frames of this package."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.types import Site

LEAST_SATELLITES, MOST_RESIDUAL_M = 6, 0.03  #: of a displacement that can be relied on


class Gnss(NamedTuple):
    """Fixes of the antenna, on the clock of the IMU."""

    t_s: Array  #: (M,)
    vel: Array | None  #: (M, 3) m/s East, North, Up; None where the receiver's file holds positions only
    pos: Array  #: (M, 3) latitude rad, longitude rad, height m
    pos_std: Array | None = None  #: (M, 3) m East, North, Up: what the receiver said of itself
    vel_std: Array | None = None  #: (M, 3) m/s


class Reference(NamedTuple):
    """What the recording is scored against; a smoothed solution at the IMU, not an outside truth."""

    t_s: Array  #: (L,)
    q_nb: Array  #: (L, 4) Right-Forward-Up body to East-North-Up
    vel: Array | None  #: (L, 3) m/s
    pos: Array | None  #: (L, 3) latitude rad, longitude rad, height m


class Displacements(NamedTuple):
    """How far the antenna moved, from the phase of the carrier: a witness that neither fixes nor reference have heard."""

    t_s: Array  #: (D,) ends of the intervals
    span_s: float  #: length of each
    enu: Array  #: (D, 3) m East, North, Up
    satellites: Array  #: (D,) how many they rest on
    residual_m: Array  #: (D,) RMS of their equations

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(D,) redundant and consistent."""
        return (self.satellites >= LEAST_SATELLITES) & (self.residual_m < MOST_RESIDUAL_M)


class Gap(NamedTuple):
    """Samples that are not there."""

    start: float  #: s
    end: float  #: s
    samples: int

    def __str__(self) -> str:
        return f"{seconds(self.start)} to {seconds(self.end)} s ({self.samples} samples)"


@dataclass(frozen=True, eq=False)
class Recording:
    """Sample k covers (t0 + k / rate_hz, t0 + (k + 1) / rate_hz]. Arrays are shared and read-only."""

    name: str
    rate_hz: float
    t0: float  #: s, where the first sample begins
    dtheta: Array  #: (N, 3) rad, Right-Forward-Up; NaN where samples are missing
    dvel: Array  #: (N, 3) m/s
    site: Site
    gnss: Gnss | None = None
    lever_arm: Array | None = None  #: (3,) m from the IMU to the antenna, Right-Forward-Up
    reference: Reference | None = None
    displacements: Displacements | None = None

    @property
    def end(self) -> float:
        """s, where the last sample ends."""
        return self.t0 + len(self.dtheta) / self.rate_hz

    @property
    def missing(self) -> NDArray[np.bool_]:
        """(N,) where there is no sample."""
        return np.isnan(self.dtheta[:, 0])

    @property
    def gaps(self) -> list[Gap]:
        """Every run of missing samples, in order."""
        edges = np.flatnonzero(np.diff(np.concatenate([[False], self.missing, [False]]).astype(np.int8)))
        at = self.t0 + edges / self.rate_hz
        return [Gap(float(at[i]), float(at[i + 1]), int(edges[i + 1] - edges[i])) for i in range(0, len(edges), 2)]


def seconds(t: float) -> str:
    """A time to the microsecond; seconds of a GPS week have six digits before the point."""
    return f"{t:.6f}".rstrip("0").rstrip(".")


def first_few(texts: list[str], most: int = 5) -> str:
    """A list for an error, which must stay one line."""
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return ", ".join(texts[:most]) + more


def frozen(array: Array) -> Array:
    array.flags.writeable = False
    return array
