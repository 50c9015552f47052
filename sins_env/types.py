"""The types that pass between world, estimator and score: public knowledge and observations, no truth.

See docs/tasks_and_scores.md#environment-contract and docs/tasks_and_scores.md#estimator-contract.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, NotRequired, Protocol, TypedDict

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Rngs
from sins_env.prior import Prior
from sins_env.specs import AidSpec, GpsSpec, ImuSpec

__all__ = ["Estimator", "NavState", "Observation", "Rng", "Site", "Task"]

#: The random stream of one run, or of a batch with a generator for each.
Rng = np.random.Generator | Rngs


@dataclass(frozen=True)
class Site:
    """The place of the base, and the earth model that truth and estimator share."""

    latitude: float  #: rad
    longitude: float  #: rad
    height: float = 0.0  #: m above the ellipsoid
    earth: str = "wgs84"  #: "wgs84" or "thesis"

    @property
    def pos(self) -> Array:
        """Latitude rad, longitude rad and height m, (3,)."""
        return np.array([self.latitude, self.longitude, self.height])


class NavState(NamedTuple):
    """Attitude, velocity and position, all with or without leading run axes."""

    q_nb: Array  #: (..., 4) unit quaternion, scalar first, body to navigation frame
    vel: Array  #: (..., 3) m/s East, North, Up
    pos: Array  #: (..., 3) latitude rad, longitude rad, height m


@dataclass(frozen=True)
class Task:
    """Everything that an estimator may know beforehand. The task, not the solver, states the prior."""

    id: str  #: id of the environment
    #: Place of the base. For a flight with a told start this is only its region; the start position, with its error, is
    #: in ``start``.
    site: Site
    epoch_s: float  #: length of an epoch, s
    n_sub: int  #: IMU samples per epoch
    duration_s: float  #: length of an episode with its coarse phase, s
    coarse_s: float  #: length of the coarse phase, s; 0 for a told start
    imu: ImuSpec  #: assumed errors of the inertial sensors; the true ones may differ
    gps: GpsSpec  #: assumed errors of the fixes; the true ones may differ
    prior: Prior
    start: NavState | None = None  #: told start of this episode, with its errors; None if it is unknown
    navigate: bool = False  #: whether the action is q_nb, v_n and position (10,); otherwise it is q_nb alone (4,)
    #: Whether the prior tells the attitude after the coarse phase. If not, its attitude is a default, which a coarse method that
    #: knows its own errors replaces.
    coarse_told: bool = True
    #: Assumed errors of the aiding sensors, in the order of their names. An observation holds a field of the name of each, and
    #: ``<name>_valid``.
    aids: tuple[AidSpec, ...] = ()

    @property
    def num_epochs(self) -> int:
        """Number of epochs of an episode, K."""
        return round(self.duration_s / self.epoch_s)


class Observation(TypedDict):
    """One epoch: the IMU increments over (t_{k-1}, t_k] and the fix at t_k. A batch of runs has a leading run axis.

    Fixes that are not made at the ends of epochs have ``gps_age`` (..., 1) beside them, which is t_k less the time of the
    fix, s. It is not negative: less than an epoch for a fix within this one, and more for a fix that was delivered late.
    The readings of the task's ``aids`` stand beside these fields, by their names.
    """

    t: Array  #: (..., 1) s
    dtheta: Array  #: (..., n_sub, 3) rad
    dvel: Array  #: (..., n_sub, 3) m/s
    gps_vel: Array  #: (..., 3) m/s East, North, Up; zeros without a fix
    gps_pos: Array  #: (..., 3) latitude rad, longitude rad, height m; zeros without a fix
    gps_valid: NDArray[np.int8]  #: (..., 1) 1 with a fix at t, else 0
    gps_age: NotRequired[Array]  #: (..., 1) s, t less the time of the fix
    gps_vel_std: NotRequired[Array]  #: (..., 3) m/s, standard deviation of gps_vel that the receiver states
    gps_pos_std: NotRequired[Array]  #: (..., 3) m, standard deviation of gps_pos East, North, Up
    #: (..., 6, 6) covariance of what bridged samples of the epoch are off by in sum, angle rad and velocity m/s in body axes;
    #: zeros in an epoch without any.
    bridge_cov: NotRequired[Array]


class Estimator(Protocol):
    """The contract that an estimator meets; it needs to import or inherit nothing.

    An estimator may have a method ``covariance()``, which returns that of the corrected errors: (..., 3, 3) in rad^2 in the
    order E, N, U. In navigation it is (..., 9, 9), of phi in rad, velocity in m/s and position in m. Further it may have
    ``diagnostics()``, which returns arrays by name, and ``smoother()``: docs/recordings.md#the-solution-is-a-file.
    See docs/tasks_and_scores.md#estimator-contract.
    """

    batched: bool  #: whether ``step`` takes observations with a leading run axis; it must take them without, too

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode; ``rng`` is one generator, or for a batch a sequence with one for each run."""
        ...

    def step(self, obs: Observation) -> Array:
        """Return the estimate at the end of this epoch: (..., 4), or (..., 10) if ``task.navigate``."""
        ...
