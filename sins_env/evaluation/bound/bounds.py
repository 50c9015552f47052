"""The Cramer-Rao bound of a simulated task. docs/mathematics/bound.md#definition.

    bound_j(t) = sqrt( mean over runs of [P(t)]_jj )

P is the Riccati covariance of the errors in the navigation frame (error_dynamics.py), linearised at the true trajectory
of the run. It uses the true noise and the spread from which the start is really drawn, whatever estimators are told. P is
averaged as a covariance, never as information. The bound is conditional on the trajectory: it holds for estimators
without prior knowledge of the motion.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.evaluation.bound import cache
from sins_env.evaluation.bound.error_dynamics import ErrorDynamics, simulated, true_motion
from sins_env.evaluation.play import criteria as criteria_module
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import EvaluationTask

RUNS = 16  #: number of runs of the task's suite to average over; only their motion enters


@dataclass(frozen=True, repr=False)
class Bound:
    """Smallest 1-sigma errors: phi E, N, U in rad; in navigation also velocity in m/s and position in m, E, N, U each."""

    t: Array  #: (S,) times, s from switch-on
    sigma: Array  #: (S, 3) or (S, 9) bound at these times
    steady: Array  #: (3,) or (9,) RMS of the bound over the epochs of the steady state, the same as the score's
    final: Array  #: (3,) or (9,) bound at T
    epochs: NDArray[np.int64]  #: (2,) first epoch of the steady state, and the last epoch
    holds: Mask  #: () whether the start is drawn from a Gaussian; if not, the bound is only a reference

    def __repr__(self) -> str:
        east, north, azimuth = np.degrees(self.steady[:3]) * 3600
        return f"<Bound: {azimuth:.4g} arcsec in azimuth, {east:.3g} east, {north:.3g} north in the steady state>"

    def fits(self, criteria: Criteria) -> bool:
        """Return whether scores by these criteria are taken at the same epochs."""
        return self.epochs.tolist() == [criteria.steady_from, criteria.num_epochs]


known: dict[str, Bound | None] = {}  #: bounds that this process has found already, by identity of the task


def find(task: EvaluationTask) -> Bound | None:
    """Return the bound of a task from the user's cache, or compute it in about a second and keep it there.

    It is None if :func:`compute` gives None.
    """
    identity = json.dumps([task.name, task.env_id, dict(task.kwargs), task.suite_seed, task.windows], sort_keys=True)
    if identity not in known:
        known[identity] = None if task.windows else _cached(task, identity)
    return known[identity]


def _cached(task: EvaluationTask, identity: str) -> Bound | None:
    """Load or compute the bound. Its name in the cache depends on the task, what its world delivers, and these formulas."""
    key = hashlib.sha256(f"{identity} {digest(task)}".encode())
    for path in [*sorted(Path(__file__).parent.glob("*.py")), Path(criteria_module.__file__)]:
        key.update(path.read_bytes())
    name = f"bound-{key.hexdigest()[:32]}"
    kept = cache.load(name)
    if kept is not None and set(kept) == {f.name for f in fields(Bound)}:
        return Bound(**kept)
    bound = compute(task)
    if bound is not None:
        cache.save(name, vars(bound))
    return bound


def compute(task: EvaluationTask, runs: int = RUNS) -> Bound | None:
    """Compute the bound of a task as the mean over the first ``runs`` runs of its suite.

    A flight takes one run, for its trajectory is always the same. The result is None if ``simulated`` gives None.
    """
    found = simulated(task)
    if found is None:
        return None
    public, world = found
    model, runs = ErrorDynamics(world), 1 if public.navigate else runs
    P = np.broadcast_to(model.P0, (runs, model.n, model.n))
    variance = []
    for part in true_motion(task, public, runs):
        F = model.transitions(part)
        Q, readings = model.noise(part, F), model.readings(part)
        for k in range(len(part.fix)):
            P = F[:, k] @ P @ F[:, k].mT + Q[:, k]
            for _, there, H, R in readings:
                if there[k]:
                    P = correct(P, H[:, k], R)
            variance.append(np.diagonal(P, axis1=-2, axis2=-1)[:, model.scored].mean(axis=0))
    criteria = Criteria.of(task, public)
    stride, first = criteria.history_stride, criteria.steady_from
    curve = np.array(variance)
    return Bound(
        t=np.asarray(criteria.history_t, dtype=float),
        sigma=np.sqrt(curve[stride - 1 :: stride]),
        steady=np.sqrt(curve[first - 1 :].mean(axis=0)),
        final=np.sqrt(curve[-1]),
        epochs=np.array([first, criteria.num_epochs]),
        holds=np.array(world.settings.gaussian_start and all(term.holds for _, term in model.aids.values())),
    )


def correct(P: Array, H: Array, R: Array) -> Array:
    """Return P after a fix, in Joseph's form: P (..., n, n), H (..., m, n), R (m, m)."""
    S = H @ P @ H.mT + R
    K = np.linalg.solve(S, H @ P).mT
    A = np.eye(P.shape[-1]) - K @ H
    P = A @ P @ A.mT + K @ R @ K.mT
    return 0.5 * (P + P.mT)
