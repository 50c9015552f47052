"""A base that stands still: how the data show it, and what it then shows of the errors of the INS.

Nobody tells that the base stands still. Over a window of ten seconds

    the increments of gyros and accelerometers scatter about their means no more than told, and so do those of its last tenth,
    their means are the earth's rate and gravity, as far as the told biases allow,
    and the fixes, which tell the velocity well enough, are zero.

A parked car that wind, an engine or people rock is not still, but it stays where it is. Over the same window the fixes are zero,
and the integral of the specific force keeps to a line, which gravity and biases make. The line fits the first nine tenths. The
velocity strays from it by at most 0.05 m/s RMS, and in the last tenth by at most five times its RMS. That RMS is the noise with
which the velocity is zero.

No inertial test alone can tell a smooth cruise from rest, hence the fixes. A base whose true noise is larger than told is never
called still. One that turns steadily and more slowly than the told biases is.

A base at rest has no velocity and no rate against the earth, with the errors of the INS and the noise n of the gyros:

    v_hat = dv + motion,   w - C_hat' omega_ie = C_hat' (C(phi) - I) omega_ie + eps + n

This n already drives the prediction: phi holds -C n dt. With the covariance M of both, K = (P H' + M) S^-1 and
S = H P H' + H M + M' H' + R. Taken as independent, the same noise would let the heading walk away from where it stands.
Source: Skog et al. (2010), doi:10.1109/TBME.2010.2060723 (likelihood ratios);
docs/mathematics/filters.md#bank-of-inertial-solutions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.kernels import helper, kernel
from sins_env.states import ERRORS, Layout
from sins_env.types import NavState, Observation, Task
from sins_env.units import ARCSEC, DEG_PER_H, UG
from solvers.pipeline.errors.model import GYRO_UNIT

WINDOW_S = 10.0  #: s, length of the window; over two seconds a constant acceleration has no scatter
FEWEST = 10  #: least number of epochs in it
SIGMAS = 5.0  #: standard deviations of a statistic up to which it is at rest
KNOWN_MPS = 0.05  #: m/s, standard deviation with which the fixes of a window must know the mean velocity
MOTION_STD = 0.01  #: m/s, velocity in an epoch of a base that is called still, and the least of one that is parked
LEAST_RATE = 1e-3 * DEG_PER_H  #: rad/s, least noise of the mean rate of an epoch, for told gyros without any

PHI, DV = ERRORS["phi"], ERRORS["dv"]


class Stillness:
    """The detector, which sees each run of a batch by itself."""

    def __init__(self, task: Task, runs: int) -> None:
        prior, imu, T = task.prior, task.imu, task.epoch_s
        self._size = max(round(WINDOW_S / T), FEWEST)
        self._window = np.full((runs, self._size, 9), np.nan)  # rotation, velocity increment, velocity of the fix
        self._k = -1
        # whole pulses give a constant rate a variance of at most a quarter of a pulse squared
        pulses = np.repeat([imu.gyro_lsb_arcsec * ARCSEC, imu.accel_lsb_mps], 3)
        white = np.diag(prior.Q)[[*range(PHI.start, PHI.stop), *range(DV.start, DV.stop)]]
        self._variance = np.concatenate([white + 0.25 * pulses**2, np.diag(prior.R)[:3]])
        model = earth.get(task.site.earth)
        means = np.sqrt(self._variance[[0, 3]] / self._size) / T
        gyro = prior.gyro_bias_std_deg_h * DEG_PER_H + means[0]
        accel = prior.accel_bias_std_ug * UG + means[1]
        reach = SIGMAS * math.sqrt(3.0)
        g = float(earth.gravity(model, task.site.latitude, task.site.height))
        self._limits = np.array([(model.rate + reach * gyro) * T, g * T, reach * accel * T])

    def seen(self, obs: Observation) -> Mask:
        """Take one more epoch, and return whether each run (runs,) has stood still over the window that it ends."""
        self._k += 1
        row = self._window[:, self._k % self._size]
        row[:, :3], row[:, 3:6] = obs["dtheta"].sum(axis=-2), obs["dvel"].sum(axis=-2)
        row[:, 6:] = np.where(obs["gps_valid"] == 1, obs["gps_vel"], np.nan)
        still: Mask = _still(self._window, self._k, self._variance, self._limits)
        return still

    def level(self) -> Array:
        """Return the standard deviation (runs,) m/s of the velocity of a base that is parked but rocked; NaN if it is not."""
        level: Array = _level(self._window, self._k, self._variance)
        return level


@kernel("(w,9),(),(9),(3)->()", "dqdd?")
def _still(window: Array, newest: int, variance: Array, limits: Array, still: Mask) -> None:
    """Return whether a base has stood still.

    The ``limits`` are the largest rotation of an epoch, the velocity increment by gravity, and how far one may be from it.
    """
    w = len(window)
    still[0] = False
    if not _stays(window, variance):
        return
    mean = np.zeros(6)
    for i in range(w):
        for j in range(6):
            mean[j] += window[i, j] / w
    known = 0.0
    for j in range(6):
        known += mean[j]
    if known != known:
        return
    first = max(w // 10, 1)
    apart, recent = np.zeros(2), np.zeros(2)
    for i in range(w):
        late = (newest - i) % w < first
        for j in range(6):
            distance = window[i, j] - mean[j]
            squared = distance * distance / max(variance[j], 1e-300)
            apart[j // 3] += squared
            if late:
                recent[j // 3] += squared
    rotation, force = 0.0, 0.0
    for j in range(3):
        rotation += mean[j] * mean[j]
        force += mean[3 + j] * mean[3 + j]
    still[0] = (
        max(apart[0], apart[1]) < 3 * (w - 1) + SIGMAS * math.sqrt(6.0 * (w - 1))
        and max(recent[0], recent[1]) < 3 * first + SIGMAS * math.sqrt(6.0 * first)
        and math.sqrt(rotation) < limits[0]
        and abs(math.sqrt(force) - limits[1]) < limits[2]
    )


@kernel("(w,9),(),(9)->()", "dqdd")
def _level(window: Array, newest: int, variance: Array, level: Array) -> None:
    """Return how far the velocity is from the line that fits it until the last tenth of the window, RMS; NaN if not parked."""
    w = len(window)
    level[0] = math.nan
    if newest < w - 1 or not _stays(window, variance):
        return
    older = w - max(w // 10, 1)
    middle, spread = 0.5 * (older - 1), older * (older * older - 1.0) / 12.0
    squares, latest = 0.0, 0.0
    for j in range(3, 6):
        v, start, slope = 0.0, 0.0, 0.0
        for i in range(older):
            v += window[(newest + 1 + i) % w, j]
            start += v / older
            slope += (i - middle) * v / spread
        v = 0.0
        for i in range(w):
            v += window[(newest + 1 + i) % w, j]
            apart = abs(v - start - slope * (i - middle))
            squares += apart * apart
            if i >= older:
                latest = max(latest, apart)
    sigma = max(math.sqrt(squares / (3 * w)), MOTION_STD)
    if sigma < KNOWN_MPS and latest < SIGMAS * sigma:
        level[0] = sigma


@helper
def _stays(window: Array, variance: Array) -> bool:
    """Return whether the fixes of the window know the velocity, and whether it is zero."""
    mean, fixes, off, far = np.zeros(3), 0, 0.0, 0.0
    for i in range(len(window)):
        there = window[i, 6] + window[i, 7] + window[i, 8]
        if there == there:
            fixes += 1
            for j in range(3):
                mean[j] += window[i, 6 + j]
                off += window[i, 6 + j] * window[i, 6 + j] / variance[6 + j]
    if fixes == 0:
        return False
    for j in range(3):
        far += mean[j] * mean[j] / (fixes * variance[6 + j])
        if variance[6 + j] > fixes * KNOWN_MPS * KNOWN_MPS:
            return False
    known: bool = off < 3 * fixes + SIGMAS * math.sqrt(6.0 * fixes) and far < 3 + SIGMAS * math.sqrt(6.0)
    return known


class Rest(NamedTuple):
    """What rest shows of the errors x at the end of an epoch: z = H x + v."""

    z: Array  #: (..., 6), velocity of the INS m/s, and its rate against the earth rad/s, in b
    H: Array  #: (..., 6, n)
    motion: Array  #: (6, 6), the part of the covariance of v that is motion
    noise: Array  #: (6, 6), the part of the covariance of v that is the gyros' noise
    cross: Array  #: (..., n, 6), covariance of the error of the prediction and v, by the same noise


def rest(task: Task, states: Layout, dtheta: Array, nav: NavState) -> Rest:
    """Return what rest shows of the errors ``states`` of an INS at ``nav``, for its rotation dtheta (..., 3) in the epoch, rad."""
    T, n = task.epoch_s, states.size
    rate = earth.rate_n(earth.get(task.site.earth), nav.pos[..., 0])
    C = attitude.to_dcm(nav.q_nb)
    z = np.concatenate([nav.vel, dtheta / T - np.matmul(C.mT, rate[..., None])[..., 0]], axis=-1)
    H, cross = np.zeros((*z.shape, n)), np.zeros((*z.shape[:-1], n, 6))
    H[..., :3, states["dv"]] = np.eye(3)
    H[..., 3:, states["phi"]] = C.mT @ attitude.skew(rate)
    H[..., 3:, states["gyro_bias"]] = GYRO_UNIT * np.eye(3)
    angle = task.prior.Q[PHI, PHI]  # of the gyros' noise over the epoch, rad^2
    cross[..., states["phi"], 3:] = -C @ angle / T
    motion, noise = np.zeros((6, 6)), np.zeros((6, 6))
    motion[:3, :3] = MOTION_STD**2 * np.eye(3)
    motion[3:, 3:] = LEAST_RATE**2 * np.eye(3)
    noise[3:, 3:] = angle / T**2
    return Rest(z, H, motion, noise, cross)
