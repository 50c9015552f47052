"""The Cramer-Rao bound of a simulated task. docs/mathematics/bound.md#definition.

    bound_j(t) = sqrt( mean over runs of [P(t)]_jj )

P is the Riccati covariance of the navigation frame's errors (error_dynamics.py), linearised at the run's true trajectory, with
the true noise and the spread of the start that is really drawn, whatever estimators are told. It is averaged as a
covariance, never as information. It conditions on the trajectory: it bounds estimators without prior knowledge of the motion.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.evaluation.bound import cache
from sins_env.evaluation.bound.error_dynamics import ErrorDynamics, true_motion
from sins_env.evaluation.play import criteria as criteria_module
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.sensors.gps import ZeroVelocity
from sins_env.worlds.simulated import SimulatedWorld

RUNS = 16  #: of the task's suite; nothing of them but the motion enters


@dataclass(frozen=True)
class Bound:
    """1-sigma errors: phi E, N, U rad; of a navigation task also velocity m/s and position m, E, N, U each."""

    t: Array  #: (S,) s from switch-on
    sigma: Array  #: (S, 3) or (S, 9)
    steady: Array  #: (3,) or (9,) RMS over the epochs of the steady state, as the score's
    final: Array  #: (3,) or (9,) at T
    epochs: NDArray[np.int64]  #: (2,) the first of the steady state, and the last
    holds: Mask  #: () False: only a reference, for the start is not drawn from a Gaussian

    def fits(self, criteria: Criteria) -> bool:
        """Whether scores by these criteria are taken at the same epochs."""
        return self.epochs.tolist() == [criteria.steady_from, criteria.num_epochs]


_known: dict[str, Bound | None] = {}  #: by task, in this process


def find(task: EvaluationTask) -> Bound | None:
    """The bound of a task, as :func:`compute` gives it: from the user's cache, or computed (about a second) and kept there."""
    identity = json.dumps([task.name, task.env_id, dict(task.kwargs), task.suite_seed, task.windows], sort_keys=True)
    if identity not in _known:
        _known[identity] = None if task.windows else _cached(task, identity)
    return _known[identity]


def _cached(task: EvaluationTask, identity: str) -> Bound | None:
    """Another world, another definition of the task or another formula: another name in the cache."""
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
    """The bound; None for a recording, and where a car is said to stand still: how wrong that is no law of noise tells.

    ``runs`` of the suite are averaged over, of a flight, always the same, only one.
    """
    if task.windows:
        return None
    env: Any = task.make(1)
    public, world = env.unwrapped.task, env.unwrapped.episode.world
    env.close()
    if not isinstance(world, SimulatedWorld) or isinstance(world.gps, ZeroVelocity):
        return None
    model, runs = ErrorDynamics(world), 1 if public.navigate else runs
    P = np.broadcast_to(model.P0, (runs, model.n, model.n))
    variance = []
    for part in true_motion(task, public, runs):
        F, H = model.transitions(part), model.sensitivity(part)
        Q = model.noise(part, F)
        for k, fix in enumerate(part.fix):
            P = F[:, k] @ P @ F[:, k].mT + Q[:, k]
            if fix:
                P = correct(P, H[:, k], model.R)
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
        holds=np.array(world.settings.gaussian_start),
    )


def correct(P: Array, H: Array, R: Array) -> Array:
    """P after a fix, in Joseph's form: (..., n, n), (..., m, n), (m, m)."""
    S = H @ P @ H.mT + R
    K = np.linalg.solve(S, H @ P).mT
    A = np.eye(P.shape[-1]) - K @ H
    P = A @ P @ A.mT + K @ R @ K.mT
    return 0.5 * (P + P.mT)
