"""IMU -> attitude: coarse alignment, then strapdown, error model and any filter of the zoo, open or closed loop."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.errors import unknown
from sins_env.specs import GpsSpec
from sins_env.types import NavState, Observation, Rng, Task
from solvers.pipeline import coarse as coarse_methods
from solvers.pipeline import feedback as reset
from solvers.pipeline.error_state import PHI, AlignmentErrors
from solvers.pipeline.strapdown import Strapdown, StrapdownState, cross, end_rate
from solvers.types import MISSING, Filter, Health, Measurement, NoiseLaw

Array = NDArray[np.float64]

FEEDBACK = ("open", "closed")
VERTICAL_TIME_CONSTANT_S = 5.0  #: of the loop that holds the INS's vertical velocity on the fixes'


class Aligner:
    """The estimator around a filter. A told start goes straight to the fine phase; an unknown one begins with the coarse.

    ``feedback="open"`` leaves the INS alone and corrects its output, as the thesis does; ``"closed"`` resets velocity
    and attitude after each fix; None: open, but closed for a filter that says so (one that linearises at zero error).
    ``coarse`` is the method of the coarse phase (:mod:`solvers.pipeline.coarse`),
    ``model`` and ``bias_frame`` are those of :class:`AlignmentErrors`. The vertical velocity of the INS is slaved to the
    fixes, the position is the told site.

    Raises:
        ValueError: an unknown setting.
    """

    def __init__(
        self,
        filter: Filter[Any],
        *,
        model: str = "exact",
        bias_frame: str = "body",
        feedback: str | None = None,
        coarse: str = "aided",
    ) -> None:
        if feedback is None:
            feedback = getattr(filter, "feedback", "open")
        if feedback not in FEEDBACK:
            raise unknown("feedback", feedback, FEEDBACK)
        coarse_methods.check_method(coarse)
        self.filter, self.errors = filter, AlignmentErrors(model, bias_frame)
        self.feedback, self.coarse = feedback, coarse
        self.batched: bool = getattr(filter, "batched", True)

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        self.task, self._rng = task, rng
        self._k = 0
        self._strapdown = Strapdown(
            earth.get(task.site.earth), task.epoch_s, task.n_sub, task.site.pos, hold_position=True
        )
        self._rate_ie = earth.rate_n(earth.get(task.site.earth), task.site.latitude)
        self._Q, self._R = self.errors.noise(task.prior), task.prior.R[:2, :2]
        self._law = noise_law(task.gps)
        self._lever = np.asarray(task.gps.lever_arm_m) if any(task.gps.lever_arm_m) else None
        self._coarse: coarse_methods.Coarse | None = None
        self._ins: StrapdownState | None = None
        self._belief: Any = None

    def step(self, obs: Observation) -> Array:
        """q_nb (..., 4) at the end of the epoch."""
        self._k += 1
        if self._k == 1:
            self._begin(obs["dtheta"].shape[:-2])
        if self._coarse is not None:
            self._coarse.add(obs)
            q_nb = self._coarse.attitude()
            if self._k * self.task.epoch_s >= self.task.coarse_s - 1e-9 * self.task.epoch_s:
                self._start_fine(NavState(q_nb, self._first_velocity(obs, q_nb), self._site()))
            return q_nb
        return self._fine(obs)

    def covariance(self) -> Array:
        """Covariance (..., 3, 3) rad^2 of the corrected attitude's errors, E, N, U; the told spread in the coarse phase."""
        if self._belief is None:
            return np.broadcast_to(self.task.prior.P0[:3, :3], (*self._batch, 3, 3)).copy()
        x, P = self.filter.estimate(self._belief)
        return reset.corrected_covariance(x[..., PHI], P[..., PHI, PHI])

    def health(self) -> Health | None:
        """Repairs and failures of each run so far; None in the coarse phase."""
        return None if self._belief is None else self._belief.health

    def diagnostics(self) -> dict[str, Array]:
        """What the filter knows beside its estimate, by name; nothing in the coarse phase."""
        return {} if self._belief is None else self.filter.diagnostics(self._belief)

    def _begin(self, batch: tuple[int, ...]) -> None:
        self._batch = batch
        if self.task.start is None:
            self._coarse = coarse_methods.start(self.coarse, self.task, batch)
        else:
            self._start_fine(NavState(*(np.reshape(part, (*batch, part.shape[-1])) for part in self.task.start)))

    def _site(self) -> Array:
        return np.broadcast_to(self.task.site.pos, (*self._batch, 3))

    def _start_fine(self, nav: NavState) -> None:
        self._coarse = None
        self._ins = self._strapdown.start(nav)
        self._belief = self.filter.init(self.errors.prior(self.task.prior, self._batch), self._rng)

    def _fine(self, obs: Observation) -> Array:
        assert self._ins is not None
        self._ins, motion = self._strapdown.advance(self._ins, obs["dtheta"], obs["dvel"])
        transition = self.errors.transition(motion, self._Q)
        valid = obs["gps_valid"][..., 0] == 1
        measurement = None
        if valid.any():
            arm = None if self._lever is None else self._arm_velocity(obs, self._ins.nav.q_nb)
            self._slave_vertical(obs, valid, arm)
            measurement = self._measurement(obs, valid, arm)
        self._belief, _ = self.filter.step(self._belief, transition, measurement)
        x = self.filter.estimate(self._belief).mean
        if self.feedback == "closed" and measurement is not None:
            self._feed_back(x)
            return self._ins.nav.q_nb
        return reset.corrected(self._ins.nav.q_nb, x[..., PHI])

    def _measurement(self, obs: Observation, valid: NDArray[np.bool_], arm: Array | None) -> Measurement:
        assert self._ins is not None
        residual = self._ins.nav.vel - obs["gps_vel"]
        if arm is not None:
            residual = residual + arm
        R = self._R
        if not valid.all():
            residual = np.where(valid[..., None], residual, 0.0)
            R = R + np.where(valid, 0.0, MISSING)[..., None, None] * np.eye(2)
        return self.errors.measurement(residual[..., :2], R, arm, self._law)

    def _arm_velocity(self, obs: Observation, q_nb: Array) -> Array:
        """C_hat (omega_eb x lever arm) (..., 3): what the antenna, whose velocity a fix is, moves about the IMU."""
        C = attitude.to_dcm(q_nb)
        rate = np.matmul(C, end_rate(obs["dtheta"], self.task.epoch_s)[..., None])[..., 0] - self._rate_ie
        return cross(rate, C @ np.asarray(self._lever))

    def _slave_vertical(self, obs: Observation, valid: NDArray[np.bool_], arm: Array | None) -> None:
        assert self._ins is not None
        vel = self._ins.nav.vel.copy()
        off = obs["gps_vel"][..., 2] - vel[..., 2] - (0.0 if arm is None else arm[..., 2])
        vel[..., 2] += valid * min(self.task.epoch_s / VERTICAL_TIME_CONSTANT_S, 1.0) * off
        self._ins = self._ins._replace(nav=self._ins.nav._replace(vel=vel))

    def _first_velocity(self, obs: Observation, q_nb: Array) -> Array:
        """The INS's velocity (..., 3) at the end of the coarse phase: the fix's, or zero where there is none."""
        vel = obs["gps_vel"] if self._lever is None else obs["gps_vel"] - self._arm_velocity(obs, q_nb)
        return vel * obs["gps_valid"]

    def _feed_back(self, x: Array) -> None:
        assert self._ins is not None
        nav = self._ins.nav
        vel = nav.vel.copy()
        vel[..., :2] -= x[..., :2]
        self._ins = self._ins._replace(nav=nav._replace(q_nb=reset.corrected(nav.q_nb, x[..., PHI]), vel=vel))
        self._belief = self.filter.relocate(self._belief, *reset.reset_maps(x, slice(0, 2), PHI))


def noise_law(gps: GpsSpec) -> NoiseLaw | None:
    """The law of the fixes' errors that the task tells; None: Gaussian."""
    if not (gps.contamination or gps.heavy_tail_dof):
        return None
    return NoiseLaw(gps.contamination, gps.contamination_factor, gps.heavy_tail_dof)
