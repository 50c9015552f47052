"""The coarse method that the data ask for: whether the base rests, sways or travels is seen, not told.

    travels   the velocities of fixes, or along the body, lead away from the start; the method in motion with these velocities
    sways     the velocities of the fixes explain the specific force better than rest does; a method with velocities
    rests     else; the usual method of the estimator

The fine phase of a base that travels begins with a reading of its velocity, and not before its heading is known to five degrees.
Until then the coarse phase goes on, and every ten seconds the heading's spread is computed again.

A base travels from the epoch on at which its way exceeds ten metres and what the noise of the readings can feign. The rest is
judged at the end of the coarse phase, by what is left of the pairs of velocities: with those of the fixes, and with none. If
neither explains the force, the base moves in a way that nothing shows, and the attitude is told to be unknown. If the task
tells no heading of a base at rest, one that seems to rest is aligned as one that sways. Each run is judged by itself.
"""

from __future__ import annotations

import warnings

import numpy as np

from sins_env import earth
from sins_env.arrays import Array, Mask
from sins_env.prior import ANY_HEADING_STD_DEG, SWITCH_ON_STD_DEG
from sins_env.types import NavState, Observation, Task
from sins_env.units import DEG, DEG_PER_H, UG
from solvers.pipeline.coarse.aided import Windows
from solvers.pipeline.coarse.fits import by_svd
from solvers.pipeline.coarse.inertial import InertialFrame
from solvers.pipeline.coarse.methods import METHODS, Coarse
from solvers.pipeline.coarse.motion import (
    Body,
    InMotion,
    Position,
    Velocity,
    body_sensor,
    pull,
    turns,
    without_polynomials,
)
from solvers.pipeline.coarse.spread import DV, PHI, Spread, profile, told_by

WAY_M = 10.0  #: m, way within which a base may sway
SIGMAS = 5.0  #: standard deviations of the noise that a way has to exceed, too
FEWEST = 10  #: least number of fixes that show a sway
UNEXPLAINED_MPS = 1.0  #: m/s, RMS of what is left of the pairs of a base whose motion nothing shows
KNOWN_DEG = 5.0  #: deg, standard deviation of the heading with which a fine phase may begin after motion
LOOK_S = 10.0  #: s, from one look at that to the next, and before the first if the task has no coarse phase
PATIENCE_S = 60.0  #: s, in which a base that moves may turn before there is a warning, if the task has no coarse phase


class FromData:
    """The usual method of an estimator, and beside it those in motion, one of which takes over in the runs that ask for it."""

    def __init__(self, task: Task, batch: tuple[int, ...], usual: str) -> None:
        self._task, self._k = task, 0
        self._look = max(round(LOOK_S / task.epoch_s), 1)  # epochs from one to the next
        self._end = round(task.coarse_s / task.epoch_s) or self._look
        self._warn_from = self._end if task.coarse_s else round(PATIENCE_S / task.epoch_s)
        self._usual = METHODS[usual](task, batch)
        self._by_fixes: InMotion = (Velocity if task.gps.velocity else Position)(task, batch, open_ended=True)
        self._by_body = None if body_sensor(task) is None else Body(task, batch, open_ended=True)
        self._way, self._squares = np.zeros((*batch, 3)), np.zeros((*batch, 1))
        self._last = np.zeros((*batch, 3)), np.full((*batch, 1), np.nan)  # velocity and time of the last fix
        self._first = np.full((*batch, 3), np.nan)  # place of the first fix
        #: Whether the task tells no heading of a base at rest, so that only a method with a spread of its own will do.
        self._untold = task.prior.attitude_std_deg[2] >= ANY_HEADING_STD_DEG
        self._noise = max(task.prior.gps_vel_std_mps)
        #: Runs (...) in which the velocities of fixes, those along the body, or nothing that is known explain the motion.
        self.fixes, self.body, self.unexplained = (np.zeros(batch, dtype=bool) for _ in range(3))
        self._asked = self._known = np.zeros(batch, dtype=bool)  # whether the heading is looked at, and known
        self._spread: Spread | None = None

    @property
    def travels(self) -> Mask:
        """In which runs (...) the base does not stay where it is."""
        return self.fixes | self.body | self.unexplained

    @property
    def due(self) -> Mask:
        """In which runs (...) the fine phase may begin."""
        return self._known

    def add(self, obs: Observation) -> None:
        """Take one more epoch."""
        self._k += 1
        self._usual.add(obs)
        if isinstance(self._usual, InertialFrame) and isinstance(self._by_fixes, Velocity):
            self._by_fixes.follow(self._usual, obs)
        else:
            self._by_fixes.add(obs)
        self._go(obs)
        if self._by_body is not None:
            self._by_body.add(obs)
            self.body = (self.body | (self._by_body.way > WAY_M)) & ~self.fixes
        if self._k >= self._end:
            self._decide(obs)

    def _decide(self, obs: Observation) -> None:
        """Judge the motion from time to time, and in the runs that travel the heading at the next reading."""
        if (self._k - self._end) % self._look == 0:
            self._judge()
            self._asked = np.ones(self.fixes.shape, dtype=bool)
        travels, valid = self.travels, obs["gps_valid"][..., 0] == 1
        now = self._asked & travels & (valid | self.body)
        self._known = self._asked & ~travels
        if now.any():
            if self._by_body is not None:
                self._by_body.settle()
            spread = self._of_all()
            sigma = np.sqrt(told_by(spread, self._task.prior)[..., PHI.stop - 1, PHI.stop - 1]) / DEG
            self._known = self._known | (now & (sigma < KNOWN_DEG))
            unknown = now & ~self._known
            if unknown.any() and self._warn_from <= self._k < self._warn_from + self._look:
                self._warn(unknown, sigma)
        self._asked = self._asked & ~now

    def _go(self, obs: Observation) -> None:
        """Follow the way of the fixes, by their velocities, or without these by their places."""
        valid = obs["gps_valid"] == 1
        if self._task.gps.velocity:
            vel, (before, at), t = obs["gps_vel"], self._last, self._k * self._task.epoch_s
            h = np.where(valid & ~np.isnan(at), t - at, 0.0)
            self._way = self._way + 0.5 * h * (before + np.where(valid, vel, 0.0))
            self._squares = self._squares + (self._noise * h) ** 2
            self._last = np.where(valid, vel, before), np.where(valid, t, at)
        else:
            self._first = np.where(valid & np.isnan(self._first), obs["gps_pos"], self._first)
            away = earth.offset(earth.get(self._task.site.earth), self._first, obs["gps_pos"])
            self._way = np.where(valid, away, self._way)
            self._squares = np.full_like(self._squares, 2.0 * max(self._task.prior.gps_pos_std_m) ** 2)
        limit = WAY_M + SIGMAS * np.sqrt(self._squares[..., 0])
        self.fixes = self.fixes | (np.hypot(self._way[..., 0], self._way[..., 1]) > limit)

    def _judge(self) -> None:
        """Judge sway, and whether anything explains the force."""
        force, u, v, _, _, valid = self._by_fixes.seen()
        at_rest = self._at_rest(len(u), u.ndim)
        left = left_over(at_rest, force, np.ones_like(valid))
        if self._task.gps.velocity:
            number = valid.sum(axis=(0, -1))
            fixed, rest = left_over(u, v, valid), left_over(at_rest, force, valid)
            if not isinstance(self._usual, Windows):
                any_velocity = np.abs(self._last[0]).sum(axis=-1) + np.abs(self._way).sum(axis=-1) > 0.0
                chance = (
                    SIGMAS * 2.0 * fixed * self._noise / np.sqrt(np.maximum(number, 1))
                )  # of rest^2 - fixed^2, at rest
                sways = (number >= FEWEST) & (rest**2 > fixed**2 + chance) & any_velocity
                self.fixes = self.fixes | (~self.body & sways)
            left = np.where(self.fixes, fixed, np.where(number >= FEWEST, np.minimum(fixed, rest), left))
        else:
            left = np.where(self.fixes, 0.0, left)
        self.fixes = self.fixes | (~self.body & self._untold)
        self.unexplained = ~self.body & (left > max(UNEXPLAINED_MPS, SIGMAS * self._usual_rms(len(u))))

    def _usual_rms(self, epochs: int) -> float:
        """Return about what the told errors of fixes and IMU leave of pairs over so many epochs, m/s."""
        task, prior = self._task, self._task.prior
        t, g = epochs * task.epoch_s, float(earth.gravity(earth.get(task.site.earth), *task.site.pos[[0, 2]]))
        walk = np.sqrt(epochs * np.array([prior.Q[PHI, PHI].max(), prior.Q[DV, DV].max()]))
        tilt = 0.5 * prior.gyro_bias_std_deg_h * DEG_PER_H * t + walk[0]
        return float(
            np.sqrt(3.0) * np.hypot(self._noise, np.hypot(prior.accel_bias_std_ug * UG * t + walk[1], g * t * tilt))
        )

    def _at_rest(self, epochs: int, ndim: int) -> Array:
        """Return the vectors (K, 1, ..., 3) in i of pairs of a base at rest."""
        task = self._task
        model, place = earth.get(task.site.earth), task.site.pos
        angles = model.rate * task.epoch_s * np.arange(1, epochs + 1)
        pulled = np.matmul(np.stack([turns(place, one).T for one in angles]), pull(model, place, np.zeros(3)))
        sums = task.epoch_s * (np.cumsum(pulled, axis=0) - 0.5 * pulled)
        return sums.reshape(epochs, *(1,) * (ndim - 2), 3)

    def attitude(self) -> Array:
        """Return q_nb (..., 4) at the last epoch."""
        q_nb = self._usual.attitude()
        for chosen, method in self._others():
            q_nb = np.where(chosen[..., None], method.attitude(), q_nb)
        return q_nb

    def _others(self) -> list[tuple[Mask, Coarse]]:
        """Return the methods that have taken over runs, with these runs."""
        pairs = [(self.fixes, self._by_fixes), (self.body, self._by_body)]
        return [(chosen, method) for chosen, method in pairs if method is not None and chosen.any()]

    def state(self, nav: NavState) -> NavState:
        """Return the state of the INS, which in runs that travel has the velocity and the place of their method."""
        for chosen, method in self._others():
            own = method.state(nav)
            nav = NavState(*(np.where(chosen[..., None], new, old) for new, old in zip(own, nav, strict=True)))
        return nav

    def spread(self) -> Spread | None:
        """Return what the attitude is off by; None where the usual method knows none in all runs."""
        return self._of_all() if self.travels.any() else self._usual.spread()

    def _of_all(self) -> Spread:
        """Return what the attitude is off by in runs of all kinds."""
        usual = self._usual.spread()
        told = independent(self._task.prior.P0[PHI, PHI]) if usual is None else usual
        for chosen, method in self._others():
            own = method.spread()
            assert own is not None
            told = replaced(told, chosen, own)
        if self.unexplained.any():
            told = replaced(told, self.unexplained, independent(np.diag(np.square(DEG * np.array(SWITCH_ON_STD_DEG)))))
        return told

    def _warn(self, unknown: Mask, sigma: Array) -> None:
        """Warn of runs (...) whose heading is not known, with its standard deviation in deg."""
        begin = f"coarse phase, {self._k * self._task.epoch_s:g} s:"
        if (unknown & self.unexplained).any():
            text = (
                f"{begin} neither rest nor any velocity that is measured explains the specific force; heading unknown"
            )
        else:
            text = (
                f"{begin} the velocity of the base changes too little to show its heading, known to "
                f"{sigma[unknown].max():.3g} deg; the phase goes on until turns or changes of speed do"
            )
        warnings.warn(text, RuntimeWarning, stacklevel=2)


def independent(noise: Array) -> Spread:
    """Return a spread with the covariance ``noise`` (3, 3) rad^2, which has nothing to do with the biases."""
    return Spread(np.zeros((3, 3)), np.zeros((3, 3)), noise)


def replaced(told: Spread, chosen: Mask, own: Spread) -> Spread:
    """Return a spread with another one in the ``chosen`` runs (...)."""
    return Spread(*(np.where(chosen[..., None, None], new, old) for new, old in zip(own, told, strict=True)))


def left_over(u: Array, v: Array, valid: Mask) -> Array:
    """Return the RMS (...) of u - c - C v over the valid pairs (K, ..., 3), with the best c and rotation C."""
    shape = np.broadcast_shapes(u.shape, v.shape)
    u, v = (valid * without_polynomials(np.broadcast_to(x, shape), valid, 0) for x in (u, v))
    r = u - np.matmul(by_svd(profile(u, v)), v[..., None])[..., 0]
    return np.asarray(np.sqrt((r * r).sum(axis=(0, -1)) / np.maximum(valid.sum(axis=(0, -1)), 1)))
