"""What passes between the world, the estimators and the score: public knowledge and observations, no truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypedDict

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.prior import Prior
from sins_env.specs import GpsSpec, ImuSpec

Rng = np.random.Generator | Sequence[np.random.Generator]


@dataclass(frozen=True)
class Site:
    """Where the base stands, and the earth model that truth and estimator share."""

    latitude: float  #: rad
    longitude: float  #: rad
    height: float = 0.0  #: m above the ellipsoid
    earth: str = "wgs84"  #: "wgs84" or "thesis"

    @property
    def pos(self) -> Array:
        """Latitude rad, longitude rad, height m: (3,)."""
        return np.array([self.latitude, self.longitude, self.height])


class NavState(NamedTuple):
    """Attitude, velocity and position; all with or without leading run axes."""

    q_nb: Array  #: (..., 4) unit quaternion, scalar first, body to navigation frame
    vel: Array  #: (..., 3) m/s East, North, Up
    pos: Array  #: (..., 3) latitude rad, longitude rad, height m


@dataclass(frozen=True)
class Task:
    """All that an estimator may know beforehand. The task, not the solver, states the prior."""

    id: str
    site: Site  #: of a flight from a told start the region; where it starts the start tells, with its error
    epoch_s: float
    n_sub: int  #: IMU samples per epoch
    duration_s: float  #: coarse phase included
    coarse_s: float  #: 0 for a told start
    imu: ImuSpec  #: as told, not necessarily as true
    gps: GpsSpec  #: as told
    prior: Prior
    start: NavState | None = None  #: the told start of this episode; None when it is unknown
    navigate: bool = False  #: the action is q_nb, v_n and position (10); False: q_nb alone (4)

    @property
    def num_epochs(self) -> int:
        return round(self.duration_s / self.epoch_s)


class Observation(TypedDict):
    """One epoch: every IMU increment of (t_{k-1}, t_k] and the fix at t_k. Leading run axis in vector form."""

    t: Array  #: (..., 1) s
    dtheta: Array  #: (..., n_sub, 3) rad
    dvel: Array  #: (..., n_sub, 3) m/s
    gps_vel: Array  #: (..., 3) m/s East, North, Up; zeros without a fix
    gps_pos: Array  #: (..., 3) latitude rad, longitude rad, height m; zeros without a fix
    gps_valid: NDArray[np.int8]  #: (..., 1) 1 when there is a fix at t


class Estimator(Protocol):
    """The whole of the plug-in contract; nothing needs to be imported to meet it.

    ``batched``: True if ``step`` takes observations with a leading run axis (it must take them without, too).
    ``rng`` is one Generator, or for a batch a sequence with one per run.
    An optional ``covariance()`` returns that of the corrected errors: (..., 3, 3) rad^2 in the order E, N, U; in navigation
    (..., 9, 9) of phi rad, velocity m/s and position m.
    """

    batched: bool

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None: ...

    def step(self, obs: Observation) -> Array: ...
