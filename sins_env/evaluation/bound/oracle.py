"""The oracle: the bound's own linear Kalman filter, fed with the errors that a run has drawn. docs/mathematics/bound.md#oracle.

It sees the truth: F, H, Q and R at the true trajectory, the error of the told start, and the errors of sensors and fixes. Its own
error therefore has exactly the covariance P of its Riccati equation, whatever the run has drawn. It is no competitor, but the
yardstick of luck: a solver at the bound errs as it does in each run, and the mean of its squared errors is known.

Scale factors, misaligned axes, pulses and jumps of the fixes are taken out of its data, for the bound counts them as known. A start
or a bias that is not drawn from the Gaussian of the bound is exchanged for one that is. Fixes with heavy tails or contamination
have their own covariance, and the filter is then the best linear one. Errors of the gyros do not reach the velocity of an antenna
at a lever arm, where they are at most some 1e-4 m/s.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.evaluation.bound.bounds import correct
from sins_env.evaluation.bound.error_dynamics import DP, DV, PHI, ErrorDynamics, simulated, true_motion
from sins_env.evaluation.bound.fisher import LEAST_STD
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.errors import nees
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.motion import Motion
from sins_env.specs import GpsSpec, ImuSpec
from sins_env.types import NavState
from sins_env.worlds.simulated import SimulatedWorld

#: Errors of the IMU that the bound counts as known.
KNOWN_IMU = dict.fromkeys(("scale_ppm", "misalignment_arcsec", "gyro_lsb_arcsec", "accel_lsb_mps"), 0.0)
KNOWN_GPS = {"jump_mps": 0.0, "jump_s": 0.0}  #: errors of the fixes that the bound counts as known
SEED = 20110607  #: seed of the starts and biases that take the place of scripted ones


@dataclass(frozen=True, repr=False)
class Oracle:
    """Squared errors of the oracle in the first runs of a suite, and their known means.

    Errors are phi E, N, U in rad; in navigation also velocity in m/s and position in m, E, N, U each.
    """

    steady: Array  #: (R, c) mean square of each run over the steady state
    final: Array  #: (R, c) squared errors at T
    expected_steady: Array  #: (c,) mean of ``steady`` over all runs there may be
    expected_final: Array  #: (c,) mean of ``final``
    nees: Array  #: (R,) normalised squared error at T; its mean is c


class _Kept:
    """A trajectory that keeps its last chunk."""

    def __init__(self, inner: Any) -> None:
        self._inner = inner
        self.last: Motion

    def chunk(self, first: int, count: int) -> Motion:
        self.last = self._inner.chunk(first, count)
        return self.last

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


class _Drawn:
    """What the runs of a task have drawn: errors of the start, of the increments and of the fixes."""

    def __init__(self, task: EvaluationTask, spec: ImuSpec, gps: GpsSpec, runs: int) -> None:
        env: Any = task.make(
            runs, reveal_truth=True, **_without("imu", spec, KNOWN_IMU), **_without("gps", gps, KNOWN_GPS)
        )
        self._world: SimulatedWorld = env.unwrapped.episode.world
        self._kept: Any = _Kept(self._world.trajectory)
        self._world.trajectory = self._kept
        _, info = task.reset(env, range(runs))
        self._true = NavState(*(info["truth"][name] for name in ("q_nb", "vel", "pos")))
        self.env, self._told = env, env.unwrapped.task.start
        self._earth = earth.get(self._world.task.site.earth)
        self._lever = np.asarray(gps.lever_arm_m)
        self._k = 0
        self._swapped = [
            self._own_bias(triad, seed) for seed, triad in enumerate((self._world.imu.gyro, self._world.imu.accel))
        ]

    def _own_bias(self, triad: Any, seed: int) -> Array:
        """Return what is added to the increments of an epoch, (runs, 3), so that scripted biases become drawn ones."""
        script = self._world.imu.script
        if not (script.fixed_bias or script.gyro_mean_deg_h or script.accel_mean_ug):
            return np.zeros_like(triad.bias)
        drawn = triad.bias_sigma * np.random.default_rng([SEED, seed]).normal(size=triad.bias.shape)
        added: Array = (drawn - triad.bias) * self._world.task.epoch_s
        return added

    def start(self, model: ErrorDynamics) -> Array:
        """Return the errors x (runs, n) of the start. Those of biases are zero, for the drawn increments hold the biases."""
        x = np.zeros((len(self._true.vel), model.full.size))
        if self._told is None or not self._world.settings.gaussian_start:
            core = model.n - 3 * len(model.biases)
            spread = np.sqrt(np.diagonal(model.P0)) * (np.arange(model.n) < core)
            return np.random.default_rng(SEED).normal(size=(len(x), model.n)) * spread
        x[:, DV] = self._told.vel - self._true.vel
        x[:, PHI] = attitude.misalignment(self._told.q_nb, self._true.q_nb)
        x[:, DP] = earth.offset(self._earth, self._true.pos, self._told.pos)
        return x[:, model.kept]

    def epoch(self) -> tuple[Array, Array, Array]:
        """Return the errors of the next epoch: angle increments, velocity increments (runs, 3), and the fix (runs, 6)."""
        self._k += 1
        data = self._world.epoch(self._k)
        motion: Motion = self._kept.last
        j = self._k - 1 - self._world.first_epoch
        pairs = zip((data.dtheta, data.dvel), (motion.dtheta, motion.dvel), self._swapped, strict=True)
        dtheta, dvel = ((measured - true[:, j]).sum(axis=1) + added for measured, true, added in pairs)
        vel, pos = motion.state.vel[:, j], motion.state.pos[:, j]
        if self._lever.any():
            C = attitude.to_dcm(motion.state.q_nb[:, j])
            vel = vel + (C @ np.cross(motion.rate_eb_b[:, j], self._lever)[..., None])[..., 0]
            pos = earth.displace(self._earth, pos, C @ self._lever)
        return dtheta, dvel, np.concatenate([data.gps_vel - vel, earth.offset(self._earth, pos, data.gps_pos)], axis=-1)


def _without(name: str, spec: Any, known: dict[str, float]) -> dict[str, Any]:
    """Return the setting ``name`` with the known errors at zero; nothing if they are, for a flight scripts its own IMU."""
    fields = dataclasses.asdict(spec)
    return {name: {**fields, **known}} if any(fields[key] for key in known) else {}


def compute(task: EvaluationTask, runs: int) -> Oracle | None:
    """Play the oracle on the first ``runs`` runs of a task's suite; None if the task has no bound, or fixes without a variance."""
    found = simulated(task)
    spread = None if found is None else _fix_covariance(found[1].gps.spec)
    if found is None or spread is None:
        return None
    public, world = found
    model = ErrorDynamics(world)
    R = spread[np.ix_(model.shown, model.shown)]
    drawn = _Drawn(task, world.imu.spec, world.gps.spec, runs)
    x, scored, steady_from = drawn.start(model), model.scored, Criteria.of(task, public).steady_from
    motions = 1 if public.navigate else runs  # all runs of a flight have one
    estimate, P = np.zeros_like(x), np.broadcast_to(model.P0, (motions, model.n, model.n))
    steady, count = np.zeros((runs, len(scored))), 0
    variance: Array = np.zeros(len(scored))
    for part in true_motion(task, public, motions):
        F, H = model.transitions(part), model.sensitivity(part)
        Q = model.noise(part, F)
        for j, fix in enumerate(part.fix):
            dtheta, dvel, seen = drawn.epoch()
            white = np.zeros((runs, model.full.size))  # by the biases, too
            white[:, DV], white[:, PHI] = _times(part.C[:, j], dvel), -_times(part.C[:, j], dtheta)
            half = 0.5 * white[:, model.kept]
            x = _times(F[:, j], x + half) + half
            estimate, P = _times(F[:, j], estimate), F[:, j] @ P @ F[:, j].mT + Q[:, j]
            if fix:
                h, residual = H[:, j], _times(H[:, j], x - estimate) - seen[:, model.shown]
                K = np.linalg.solve(h @ P @ h.mT + R, h @ P).mT
                estimate, P = estimate + _times(K, residual), correct(P, h, R)
            if part.first + j + 1 >= steady_from:
                steady += np.square((x - estimate)[:, scored])
                variance += np.diagonal(P, axis1=-2, axis2=-1)[:, scored].mean(axis=0)
                count += 1
    drawn.env.close()
    error, at_end = (x - estimate)[:, scored], P[:, scored[:, None], scored]
    return Oracle(
        steady=steady / count,
        final=np.square(error),
        expected_steady=variance / count,
        expected_final=np.diagonal(at_end, axis1=-2, axis2=-1).mean(axis=0),
        nees=nees(error, np.broadcast_to(at_end, (runs, *at_end.shape[1:]))),
    )


def _times(A: Any, x: Any) -> Array:
    """Return A x for A (runs or 1, m, n) and x (runs, n)."""
    out: Array = (A @ x[..., None])[..., 0]
    return out


def _fix_covariance(gps: GpsSpec) -> Array | None:
    """Return the covariance (6, 6) of the errors of a fix; None if its variance is infinite."""
    if gps.heavy_tail_dof and gps.heavy_tail_dof <= 2.0:
        return None
    factor = 1.0 + gps.contamination * (gps.contamination_factor - 1.0)
    if gps.heavy_tail_dof:
        factor *= gps.heavy_tail_dof / (gps.heavy_tail_dof - 2.0)
    return np.diag(np.square(np.maximum([*gps.vel_std, *gps.pos_std], LEAST_STD))) * factor
