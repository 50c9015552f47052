"""The estimator: the invariant filter of the zoo, with a network that scales the told noises at each fix."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from learned_noise import network
from learned_noise.network import Memory
from sins_env.arrays import Array
from sins_env.types import Rng, Task
from solvers.blocks.conditioning import condition
from solvers.blocks.moments import moments
from solvers.filters.base import count
from solvers.filters.gaussian import initial_belief, with_moments
from solvers.filters.kalman.inekf import InEKF
from solvers.pipeline.errors.navigation import DV, PHI
from solvers.pipeline.estimator import Aligner
from solvers.types import Gaussian, Health, Innovation, Measurement, Transition

WEIGHTS = Path(__file__).with_name("weights.npz")


@cache
def _weights(path: str) -> dict[str, Array]:
    return network.read(path)


class LearnedBelief(NamedTuple):
    """One Gaussian, what the network remembers, and its last answers."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    memory: Memory
    log_factors: Array  #: (..., 3) of R, of the gyros' noise and of the accelerometers'


@dataclass(frozen=True)
class LearnedFilter(InEKF):
    """The invariant extended Kalman filter, whose R at a fix and whose Q after it are the told ones times learned factors.

    Raises:
        ValueError: ``weights`` is the file of another network.
    """

    weights: str = str(WEIGHTS)  #: an NPZ file that ``learned_noise.train`` wrote

    def __post_init__(self) -> None:
        _weights(self.weights)

    def init(self, prior: Gaussian, rng: Any = None) -> LearnedBelief:
        b = initial_belief(prior)
        batch = b.mean.shape[:-1]
        return LearnedBelief(*b, network.blank(batch), np.zeros((*batch, network.ANSWERS)))

    def predict(self, b: LearnedBelief, tr: Transition) -> LearnedBelief:
        scale = np.ones(b.mean.shape)
        scale[..., PHI], scale[..., DV] = np.moveaxis(np.exp(0.5 * b.log_factors[..., 1:, None]), -2, 0)
        return super().predict(b, tr._replace(Q=scale[..., :, None] * tr.Q * scale[..., None, :]))

    def correct(self, b: LearnedBelief, me: Measurement) -> tuple[LearnedBelief, Innovation]:
        prior = Gaussian(b.mean, b.cov)
        seen, repaired = moments(me.h, prior, self.rule)
        told, predicted = (np.diagonal(cov, axis1=-2, axis2=-1) for cov in (me.R, seen.cov))
        e, spread = (me.z - seen.mean) / np.sqrt(told), (predicted / told).sum(-1) / 3.0
        log_factors, memory = network.answer(np, _weights(self.weights), b.memory, e, spread)
        R = np.exp(log_factors[..., 0, None, None]) * me.R
        x, innovation, repaired_S = condition(prior, seen._replace(cov=seen.cov + R), me.z)
        after = with_moments(b, *x)._replace(memory=memory, log_factors=log_factors)
        return count(count(after, repaired), repaired_S), innovation

    def diagnostics(self, b: LearnedBelief) -> dict[str, Array]:
        """Return the factors of the told variances of fixes, gyros and accelerometers, (...) each."""
        names = ("R_factor", "gyro_noise_factor", "accel_noise_factor")
        return dict(zip(names, np.moveaxis(np.exp(b.log_factors), -1, 0), strict=True))


class LearnedNoise(Aligner):
    """Learned noise: an invariant filter whose Q and R a recurrent network scales by what it sees of the innovations.

    It aligns with the velocity of fixes. ``weights`` is a file that ``python -m learned_noise.train`` wrote, by default the one of
    this package. ``coarse`` is the method of a coarse phase.
    """

    def __init__(self, *, weights: str = str(WEIGHTS), coarse: str | None = None) -> None:
        super().__init__(LearnedFilter(weights=weights), coarse=coarse)

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode.

        Raises:
            ValueError: the task navigates, or has aids beside the fixes.
        """
        if task.aids:
            names = ", ".join(aid.name for aid in task.aids)
            raise ValueError(
                f"learned_noise on {task.id} with the aids {names}; allowed: alignment with fixes alone, on which it was trained"
            )
        super().reset(task, rng, num_runs)
