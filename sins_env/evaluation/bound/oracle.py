"""The oracle: the bound's own linear Kalman filter, fed with the errors that a run has drawn. docs/mathematics/bound.md#oracle.

It sees the truth: F, H, Q and R at the true trajectory, the error of the told start, and the errors of sensors and fixes. Its own
error therefore has exactly the covariance P of its Riccati equation, whatever the run has drawn. It is no competitor, but the
yardstick of luck: a solver at the bound errs as it does in each run, and the mean of its squared errors is known.

Scale factors, misaligned axes, pulses and jumps of the fixes are taken out of its data, for the bound counts them as known. A start
or a bias that is not drawn from the Gaussian of the bound is exchanged for one that is. An error of a fix with heavy tails or
contamination is weighted as an efficient estimator would weight it (fisher.py), which gives it the covariance of the bound. Errors
of the gyros do not reach the velocity of an antenna at a lever arm, where they are at most some 1e-4 m/s.

A results file keeps the runs of the oracle as those of a solver named SOLVER, so that boards need not play it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.evaluation.bound.bounds import correct
from sins_env.evaluation.bound.error_dynamics import DP, DV, PHI, ErrorDynamics, simulated, true_motion
from sins_env.evaluation.bound.fisher import efficient
from sins_env.evaluation.play.criteria import AZIMUTH, SCORED, Criteria
from sins_env.evaluation.play.criteria import PHI as ATTITUDE
from sins_env.evaluation.play.errors import nees
from sins_env.evaluation.play.records import Records, Scorer
from sins_env.evaluation.tasks.task import EvaluationTask, run_numbers
from sins_env.motion import Motion
from sins_env.specs import GpsSpec, ImuSpec
from sins_env.types import NavState
from sins_env.worlds.simulated import SimulatedWorld

#: Errors of the IMU that the bound counts as known.
KNOWN_IMU = dict.fromkeys(("scale_ppm", "misalignment_arcsec", "gyro_lsb_arcsec", "accel_lsb_mps"), 0.0)
#: Errors of the fixes that the bound counts as known.
KNOWN_GPS = dict.fromkeys(("jump_mps", "jump_s", "spoof_mps2", "spoof_s"), 0.0)
HEADING = SCORED["euler"].start  #: index of the heading error among the components
SOLVER = __name__  #: name of its runs in a results file; no solver can have it, for an entry point has no dots
SEED = 20110607  #: seed of the starts and biases that take the place of scripted ones


@dataclass(frozen=True, repr=False)
class Oracle:
    """Squared errors of the oracle in some runs of a suite, and their known means.

    Errors are phi E, N, U in rad; in navigation also velocity in m/s and position in m, E, N, U each.
    """

    steady: Array  #: (R, c) mean square of each run over the steady state
    final: Array  #: (R, c) squared errors at T
    expected_steady: Array  #: (c,) mean of ``steady`` over all runs there may be
    expected_final: Array  #: (c,) mean of ``final``
    nees: Array  #: (R,) normalised squared error at T; its mean is c
    records: Records  #: the same runs as those of a solver; to first order the heading errs by phi U, and pitch and roll are NaN


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

    def __init__(
        self, task: EvaluationTask, spec: ImuSpec, gps: GpsSpec, runs: Sequence[int], suite_seed: int | None
    ) -> None:
        env: Any = task.make(
            len(runs), reveal_truth=True, **_without("imu", spec, KNOWN_IMU), **_without("gps", gps, KNOWN_GPS)
        )
        self._world: SimulatedWorld = env.unwrapped.episode.world
        self._kept: Any = _Kept(self._world.trajectory)
        self._world.trajectory = self._kept
        _, info = task.reset(env, runs, suite_seed)
        self._true = NavState(*(info["truth"][name] for name in ("q_nb", "vel", "pos")))
        self.env, self._told = env, env.unwrapped.task.start
        self._earth = earth.get(self._world.task.site.earth)
        self._lever = np.asarray(gps.lever_arm_m)
        self._k, self._runs, self._weighted = 0, runs, efficient(gps)
        self._swapped = [
            self._own_bias(triad, seed) for seed, triad in enumerate((self._world.imu.gyro, self._world.imu.accel))
        ]

    def _own_bias(self, triad: Any, seed: int) -> Array:
        """Return what is added to the increments of an epoch, (runs, 3), so that scripted biases become drawn ones."""
        script = self._world.imu.script
        if not (script.fixed_bias or script.gyro_mean_deg_h or script.accel_mean_ug):
            return np.zeros_like(triad.bias)
        drawn = triad.bias_sigma * self._normal(triad.bias.shape[1], seed)
        added: Array = (drawn - triad.bias) * self._world.task.epoch_s
        return added

    def _normal(self, size: int, *key: int) -> Array:
        """Return standard normal numbers (runs, size), which depend on the number of the run."""
        return np.stack([np.random.default_rng([SEED, *key, run]).normal(size=size) for run in self._runs])

    def start(self, model: ErrorDynamics) -> Array:
        """Return the errors x (runs, n) of the start. Those of biases are zero, for the drawn increments hold the biases."""
        x = np.zeros((len(self._true.vel), model.full.size))
        if self._told is None or not self._world.settings.gaussian_start:
            core = model.n - 3 * len(model.biases)
            spread = np.sqrt(np.diagonal(model.P0)) * (np.arange(model.n) < core)
            return self._normal(model.n) * spread
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
        pairs = zip(
            (data.measured["dtheta"], data.measured["dvel"]), (motion.dtheta, motion.dvel), self._swapped, strict=True
        )
        dtheta, dvel = ((measured - true[:, j]).sum(axis=1) + added for measured, true, added in pairs)
        vel, pos = motion.state.vel[:, j], motion.state.pos[:, j]
        if self._lever.any():
            C = attitude.to_dcm(motion.state.q_nb[:, j])
            vel = vel + (C @ np.cross(motion.rate_eb_b[:, j], self._lever)[..., None])[..., 0]
            pos = earth.displace(self._earth, pos, C @ self._lever)
        off = data.measured["gps_vel"] - vel, earth.offset(self._earth, pos, data.measured["gps_pos"])
        return dtheta, dvel, self._weighted(np.concatenate(off, axis=-1))


def _without(name: str, spec: Any, known: dict[str, float]) -> dict[str, Any]:
    """Return the setting ``name`` with the known errors at zero; nothing if they are, for a flight scripts its own IMU."""
    fields = dataclasses.asdict(spec)
    return {name: {**fields, **known}} if any(fields[key] for key in known) else {}


def compute(task: EvaluationTask, runs: int | Iterable[int], suite_seed: int | None = None) -> Oracle | None:
    """Play the oracle on runs of a task's suite; None if the task has no bound, or aids.

    The result is None, too, with fixes between the ends of epochs, and with fixes without a velocity.

    Args:
        task: a task.
        runs: number of runs, or their numbers.
        suite_seed: seed of the suite; None takes that of the task.
    """
    found = simulated(task)
    if found is None or found[1].aids:  # what aids have drawn is not taken apart here
        return None
    public, world = found
    if world.gps.spec.oldest_s or not world.gps.spec.velocity:
        return None
    wanted, model = run_numbers(runs), ErrorDynamics(world)
    drawn = _Drawn(task, world.imu.spec, world.gps.spec, wanted, suite_seed)
    criteria = Criteria.of(task, drawn.env.unwrapped.task)  # which tells the start now
    x, scored = drawn.start(model), model.scored
    motions = wanted[:1] if public.navigate else wanted  # all runs of a flight have one
    estimate, P = np.zeros_like(x), np.broadcast_to(model.P0, (len(motions), model.n, model.n))
    scorer, count = Scorer(criteria, len(wanted)), criteria.num_epochs - criteria.steady_from + 1
    steady, variance = np.zeros((len(wanted), len(scored))), np.zeros(len(scored))
    for part in true_motion(task, public, motions, suite_seed):
        F, H = model.transitions(part), model.sensitivity(part)
        Q = model.noise(part, F)
        errors = np.full((len(wanted), len(part.fix), criteria.components), np.nan)
        for j, fix in enumerate(part.fix):
            dtheta, dvel, seen = drawn.epoch()
            white = np.zeros((len(wanted), model.full.size))  # by the biases, too
            white[:, DV], white[:, PHI] = _times(part.C[:, j], dvel), -_times(part.C[:, j], dtheta)
            half = 0.5 * white[:, model.kept]
            x = _times(F[:, j], x + half) + half
            estimate, P = _times(F[:, j], estimate), F[:, j] @ P @ F[:, j].mT + Q[:, j]
            if fix:
                h, residual = H[:, j], _times(H[:, j], x - estimate) - seen[:, model.shown]
                K = np.linalg.solve(h @ P @ h.mT + model.R, h @ P).mT
                estimate, P = estimate + _times(K, residual), correct(P, h, model.R)
            errors[:, j, : len(scored)] = (x - estimate)[:, scored]
            k = part.first + j + 1
            if k >= criteria.steady_from:
                steady += np.square(errors[:, j, : len(scored)]) / count
                variance = variance + np.diagonal(P, axis1=-2, axis2=-1)[:, scored].mean(axis=0) / count
            if k in criteria.nees_epochs:
                _add_nees(
                    scorer, criteria.nees_epochs.index(k), errors[:, j, : len(scored)], P[:, scored[:, None], scored]
                )
        if criteria.navigates:
            errors[..., HEADING] = errors[..., AZIMUTH]
        scorer.add(errors, np.zeros(errors.shape[:2], dtype=bool))
    drawn.env.close()
    error, at_end = errors[:, -1, : len(scored)], P[:, scored[:, None], scored]
    return Oracle(
        steady=steady,
        final=np.square(error),
        expected_steady=variance,
        expected_final=np.diagonal(at_end, axis1=-2, axis2=-1).mean(axis=0),
        nees=nees(error, np.broadcast_to(at_end, (len(wanted), *at_end.shape[1:]))),
        records=scorer.records(wanted),
    )


def _add_nees(scorer: Scorer, place: int, errors: Array, P: Array) -> None:
    """Write the NEES of errors (R, c) with covariances (R or 1, c, c), that of the attitude and in navigation that of all."""
    P = np.broadcast_to(P, (len(errors), *P.shape[1:]))
    scorer.nees[:, place] = nees(errors[:, ATTITUDE], P[:, ATTITUDE, ATTITUDE])
    if scorer.criteria.navigates:
        scorer.nees_all[:, place] = nees(errors, P)


def _times(A: Any, x: Any) -> Array:
    """Return A x for A (runs or 1, m, n) and x (runs, n)."""
    out: Array = (A @ x[..., None])[..., 0]
    return out
