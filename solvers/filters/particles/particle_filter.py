"""What the particle filters share: settings, the start, and the test for too few particles that count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.checks import choice, keep, number
from solvers.blocks.square_root import cholesky
from solvers.filters.base import BatchFilter, count, initial_gaussian, initial_health
from solvers.filters.particles.importance import LIKELIHOODS, systematic
from solvers.filters.particles.random_points import Keys, check_enough, draw, particle_count, run_keys, uniforms
from solvers.types import Gaussian, Health

PREDICT, RESAMPLE, ROUGHEN, START, SEEN = range(5)  #: what a draw is for, so that each has random numbers of its own


class Cloud(NamedTuple):
    """Weighted particles, and the random stream of each run."""

    x: Array  #: (..., M, n), the particles
    log_w: Array  #: (..., M), logarithms of weights that sum to one
    key: Keys  #: (...), key of the random stream
    ess: Array  #: (...), effective sample size of the last weighing, as a share of the particles
    health: Health


@dataclass(frozen=True)
class ParticleFilter(BatchFilter[Any]):
    """Base of the particle filters: their settings and diagnostics.

    Raises:
        ValueError: a setting outside its range; in ``init``, too few particles for the number of states.
    """

    particles: int = 2000  #: number of particles
    resample: float = 0.5  #: effective share of the particles below which they are resampled
    likelihood: str = "told"  #: likelihood of a fix: "told", the law that the task tells, or "gaussian"
    min_ess: float = 0.02  #: effective share of the particles below which they are moved to the Kalman result
    memory_mb: float = 4.0  #: memory for the temporaries of f and h; small slices stay in the cache and are the fastest

    def __post_init__(self) -> None:
        keep(self, "particles", particle_count, "pairs")
        keep(self, "likelihood", choice, LIKELIHOODS)
        keep(self, "min_ess", number, least=0.0, most=1.0)
        keep(self, "resample", number, least=self.min_ess, most=1.0)
        keep(self, "memory_mb", number, above=0.0)

    def states(self, b: Any) -> int:
        return int(b.x.shape[-1])

    def start(self, prior: Gaussian, rng: Any, share: float = 1.0) -> tuple[Gaussian, Cloud]:
        """Return the prior as arrays, and particles that carry ``share`` of its covariance."""
        x = initial_gaussian(prior)
        n, batch = x.mean.shape[-1], x.mean.shape[:-1]
        check_enough(self.particles, n, "pairs")
        S, repaired = cholesky(share * x.cov)
        keys = run_keys(rng, batch)
        particles = draw("pairs", "random", keys, 0, START, self.particles, S, x.mean)
        log_w = np.full((*batch, self.particles), -np.log(self.particles))
        b = Cloud(particles, log_w, keys, np.ones(batch), initial_health(x.mean, x.cov, batch=batch))
        return x, count(b, repaired)

    def too_few(self, number: Array, n: int) -> Mask:
        """Return a mask (...) of the runs in which too few particles count for moments; NaN is too few."""
        return ~(number >= max(self.min_ess * self.particles, 2 * n))

    def survivors(self, b: Any, w: Array, rows: Mask) -> NDArray[np.int64]:
        """Return the indices (runs, M) of the surviving particles, in the runs of the mask (...)."""
        return systematic(w[rows], uniforms(b.key[rows], b.health.epoch, RESAMPLE, 1)[:, 0])

    def diagnostics(self, b: Any) -> dict[str, Array]:
        """Return the effective sample size as a share, and the number of steps that took the Kalman result."""
        return {"ess": b.ess, "fallbacks": b.health.fallbacks.astype(float)}


def log_weights(w: Array) -> Array:
    """Return finite logarithms of weights, because a belief must be finite; NaN stays."""
    return np.log(np.maximum(w, 1e-300))
