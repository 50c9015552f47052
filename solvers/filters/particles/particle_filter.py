"""What the particle filters share: settings, the start, and which runs have too few particles that count."""

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

PREDICT, RESAMPLE, ROUGHEN, START = range(4)  #: purposes of draws


class Cloud(NamedTuple):
    x: Array  #: (..., M, n)
    log_w: Array  #: (..., M), of weights that sum to one
    key: Keys  #: (...)
    ess: Array  #: (...) effective sample size of the last weighing, as a share of the particles
    health: Health


@dataclass(frozen=True)
class ParticleFilter(BatchFilter[Any]):
    """Settings that the particle filters share, and what they say of themselves."""

    particles: int = 2000
    resample: float = 0.5  #: share of the particles; with fewer that count, they are resampled
    likelihood: str = "told"  #: of the fix: the law that is "told", or "gaussian"
    min_ess: float = 0.02  #: share of the particles; with fewer that count, they are moved to the Kalman result
    memory_mb: float = 4.0  #: for the model's temporaries; small slices stay in the cache and are the fastest

    def __post_init__(self) -> None:
        keep(self, "particles", particle_count, "pairs")
        keep(self, "likelihood", choice, LIKELIHOODS)
        keep(self, "min_ess", number, least=0.0, most=1.0)
        keep(self, "resample", number, least=self.min_ess, most=1.0)
        keep(self, "memory_mb", number, above=0.0)

    def start(self, prior: Gaussian, rng: Any, share: float = 1.0) -> tuple[Gaussian, Cloud]:
        """The prior as arrays, and particles that carry ``share`` of its covariance."""
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
        """The runs in which fewer particles count than moments can be taken from; not a number is too few."""
        return ~(number >= max(self.min_ess * self.particles, 2 * n))

    def survivors(self, b: Any, w: Array, rows: Mask) -> NDArray[np.int64]:
        """Indices (runs, M) of the particles that survive in the runs of the mask (...)."""
        return systematic(w[rows], uniforms(b.key[rows], b.health.epoch, RESAMPLE, 1)[:, 0])

    def diagnostics(self, b: Any) -> dict[str, Array]:
        """Effective sample size as a share of the particles, and the steps that took the Kalman result."""
        return {"ess": b.ess, "fallbacks": b.health.fallbacks.astype(float)}


def log_weights(w: Array) -> Array:
    """Finite logarithms, for a belief must be finite; NaN stays."""
    return np.log(np.maximum(w, 1e-300))
