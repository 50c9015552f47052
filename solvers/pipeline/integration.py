"""An INS held by fixes: strapdown, an error model and any filter of the zoo, after coarse alignment where the start is unknown.

What alignment and navigation share; :mod:`solvers.pipeline.estimator` and :mod:`solvers.pipeline.estimator` say which errors
there are, what becomes of the position, and what is the answer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.types import NavState, Observation, Rng, Task
from solvers.pipeline import coarse as coarse_methods
from solvers.pipeline import feedback as reset
from solvers.pipeline.aiding.gps import noise_law
from solvers.pipeline.errors.invariant import COORDINATES, Euler, Invariant
from solvers.pipeline.errors.model import ErrorModel
from solvers.pipeline.strapdown import Strapdown, StrapdownState, cross, end_rate
from solvers.types import MISSING, Filter, Health, Measurement

FEEDBACK = ("open", "closed")


class Integration(ABC):
    """The estimator around a filter. A told start goes straight to the fine phase; an unknown one begins with the coarse.

    ``feedback``: "open" corrects the output alone, "closed" the INS after each fix; None: closed for a filter that says so.
    ``coordinates``: of the errors that the filter estimates, "euler" or "invariant"
    (:mod:`solvers.pipeline.errors.invariant`); None: as the filter says, else "euler". ``coarse`` is the method of the
    coarse phase (:mod:`solvers.pipeline.coarse`); None: the one of this estimator.

    Raises:
        ValueError: an unknown setting.
    """

    navigates: ClassVar[bool]  #: whether the answer, and the INS, has a position
    feedback_default: ClassVar[str]
    coarse_default: ClassVar[str]

    def __init__(
        self, filter: Filter[Any], errors: ErrorModel, feedback: str | None, coordinates: str | None, coarse: str | None
    ) -> None:
        if feedback is None:
            feedback = getattr(filter, "feedback", self.feedback_default)
        if feedback not in FEEDBACK:
            raise unknown("feedback", feedback, FEEDBACK)
        coarse = self.coarse_default if coarse is None else coarse
        coarse_methods.check_method(coarse)
        self.filter, self.errors = filter, errors
        self.feedback, self.coordinates, self.coarse = feedback, coordinates_of(filter, coordinates), coarse
        self.batched: bool = getattr(filter, "batched", True)

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        self.task, self._rng = task, rng
        self._k = 0
        self._earth, pos = earth.get(task.site.earth), task.site.pos
        self._strapdown = Strapdown(self._earth, task.epoch_s, task.n_sub, pos, hold_position=not self.navigates)
        self._rate_ie = earth.rate_n(self._earth, task.site.latitude)
        fixed = slice(0, self.errors.seen.stop - self.errors.seen.start)
        self._Q, self._R = self.errors.noise(task.prior), task.prior.R[fixed, fixed]
        self._law = noise_law(task.gps)
        self._lever = np.asarray(task.gps.lever_arm_m) if any(task.gps.lever_arm_m) else None
        self._coarse: coarse_methods.Coarse | None = None
        self._place: Array = np.full(3, np.nan)  # of the antenna, by the last fix of the coarse phase
        self._ins: StrapdownState | None = None
        self._bias: tuple[Array, Array] | None = None  # of gyro and accelerometer increments, fed back so far
        self._belief: Any = None
        self._coordinates = (
            Invariant(self._earth, pos, position=self.navigates) if self.coordinates == "invariant" else Euler()
        )

    def step(self, obs: Observation) -> Array:
        """The estimate at the end of the epoch."""
        self._k += 1
        if self._k == 1:
            self._begin(obs["dtheta"].shape[:-2])
        if self._coarse is not None:
            self._coarse.add(obs)
            self._place = np.where(obs["gps_valid"] == 1, obs["gps_pos"], self._place)
            nav = self._first(obs, self._coarse.attitude())
            if self._k * self.task.epoch_s >= self.task.coarse_s - 1e-9 * self.task.epoch_s:
                self._start_fine(nav)
            return self.answer(nav)
        return self.answer(self._fine(obs))

    def covariance(self) -> Array:
        """Covariance of the corrected errors: phi_ENU rad and, in navigation, velocity m/s and position m; the told one in
        the coarse phase."""
        size = 9 if self.navigates else 3
        if self._belief is None:
            return np.broadcast_to(self.task.prior.P0[:size, :size], (*self._batch, size, size)).copy()
        assert self._ins is not None
        x, P = self._coordinates.gaussian(self.filter.estimate(self._belief), self._ins.nav)
        first = self.errors.phi.start
        reported = slice(first, first + size)
        return reset.corrected_covariance(x[..., self.errors.phi], P[..., reported, reported])

    def health(self) -> Health | None:
        """Repairs and failures of each run so far; None in the coarse phase."""
        return None if self._belief is None else self._belief.health

    def diagnostics(self) -> dict[str, Array]:
        """What the filter knows beside its estimate, by name; nothing in the coarse phase."""
        return {} if self._belief is None else self.filter.diagnostics(self._belief)

    @abstractmethod
    def answer(self, nav: NavState) -> Array:
        """The action for a corrected state."""

    def aid(self, obs: Observation, valid: NDArray[np.bool_], arm: Array | None) -> None:
        """What else a fix does to the INS: nothing."""
        return None

    def _begin(self, batch: tuple[int, ...]) -> None:
        self._batch = batch
        if self.task.start is None:
            self._coarse = coarse_methods.start(self.coarse, self.task, batch)
        else:
            self._start_fine(NavState(*(np.reshape(part, (*batch, part.shape[-1])) for part in self.task.start)))

    def _start_fine(self, nav: NavState) -> None:
        self._coarse = None
        self._ins = self._strapdown.start(nav)
        prior = self._coordinates.prior(self.errors.prior(self.task.prior, self._batch), nav)
        self._belief = self.filter.init(prior, self._rng)

    def _first(self, obs: Observation, q_nb: Array) -> NavState:
        """The INS's state at the end of the coarse phase: velocity of the fix, or zero; place of the last fix, or the site."""
        vel, pos = obs["gps_vel"], self._place
        if self._lever is not None:
            about, offset = np.moveaxis(self._arm(obs, q_nb), -2, 0)
            vel, pos = vel - about, earth.displace(self._earth, pos, -offset)
        site = np.broadcast_to(self.task.site.pos, (*self._batch, 3))
        pos = np.where(np.isnan(pos), site, pos) if self.navigates else site
        return NavState(q_nb, vel * obs["gps_valid"], pos)

    def _fine(self, obs: Observation) -> NavState:
        assert self._ins is not None
        before = self._ins.nav
        self._ins, motion = self._strapdown.advance(self._ins, *self._increments(obs))
        transition = self.errors.transition(motion, self._Q)
        valid = obs["gps_valid"][..., 0] == 1
        measurement = None
        if valid.any():
            arm = None if self._lever is None else self._arm(obs, self._ins.nav.q_nb)
            self.aid(obs, valid, arm)
            measurement = self._measurement(obs, valid, arm)
        ins = self._ins.nav
        transition = self._coordinates.transition(transition, before, ins)
        self._belief, _ = self.filter.step(self._belief, transition, measurement)
        x = self._coordinates.errors(self.filter.estimate(self._belief).mean, ins)
        nav = self.errors.corrected(self._earth, ins, x)
        if self.feedback == "closed" and measurement is not None:
            self._feed_back(nav, x)
        return nav

    def _increments(self, obs: Observation) -> tuple[Array, Array]:
        """Those of the epoch without the biases fed back so far."""
        if self._bias is None:
            return obs["dtheta"], obs["dvel"]
        gyro, accel = self._bias
        return obs["dtheta"] - gyro[..., None, :], obs["dvel"] - accel[..., None, :]

    def _measurement(self, obs: Observation, valid: NDArray[np.bool_], arm: Array | None) -> Measurement:
        residual = self._residual(obs, arm)
        R = self._R
        if not valid.all():
            residual = np.where(valid[..., None], residual, 0.0)
            R = R + np.where(valid, 0.0, MISSING)[..., None, None] * np.eye(len(R))
        assert self._ins is not None
        return self._coordinates.measurement(self.errors.measurement(residual, R, arm, self._law), self._ins.nav)

    def _residual(self, obs: Observation, arm: Array | None) -> Array:
        """INS minus fix, as many components as the error model takes: velocity m/s, position m."""
        assert self._ins is not None
        nav, m = self._ins.nav, len(self._R)
        residual = nav.vel - obs["gps_vel"]
        if m > 3:
            away = earth.offset(self._earth, nav.pos, obs["gps_pos"])
            residual = np.concatenate([residual, -away], axis=-1)
        if arm is not None:
            residual = residual + arm.reshape(*arm.shape[:-2], 6)[..., : residual.shape[-1]]
        return residual[..., :m]

    def _arm(self, obs: Observation, q_nb: Array) -> Array:
        """Velocity C_hat (omega_eb x lever arm) and place C_hat lever arm of the antenna about the IMU, (..., 2, 3)."""
        C = attitude.to_dcm(q_nb)
        arm = C @ np.asarray(self._lever)
        rate = np.matmul(C, end_rate(obs["dtheta"], self.task.epoch_s)[..., None])[..., 0] - self._rate_ie
        return np.stack([cross(rate, arm), arm], axis=-2)

    def _feed_back(self, nav: NavState, x: Array) -> None:
        assert self._ins is not None
        before, self._ins = self._ins.nav, self._ins._replace(nav=nav)
        biases = self.errors.biases(x)
        if biases is not None:
            per_sample = self.task.epoch_s / self.task.n_sub
            so_far = self._bias or (0.0, 0.0)
            self._bias = so_far[0] + per_sample * biases[0], so_far[1] + per_sample * biases[1]
        maps = reset.reset_maps(x, self.errors.phi, self.errors.fed)
        self._belief = self.filter.relocate(self._belief, *self._coordinates.reset(maps, before, nav))


def coordinates_of(filter: Filter[Any], given: str | None) -> str:
    """The setting; None: what the filter asks for.

    Raises:
        ValueError: an unknown one.
    """
    coordinates: str = getattr(filter, "coordinates", "euler") if given is None else given
    if coordinates not in COORDINATES:
        raise unknown("coordinates", coordinates, COORDINATES)
    return coordinates


def refuse_navigation(task: Task, what: str) -> None:
    """Raises ValueError for a task that wants more than an attitude."""
    if task.navigate:
        raise ValueError(
            f"{what} gives the attitude alone; {task.id} navigates: allowed are the solvers made of a filter"
        )
