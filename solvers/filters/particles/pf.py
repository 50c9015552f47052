"""Particle filter: sampling importance resampling, with systematic resampling and roughening.

Idea: particles follow the model with its noise, and a fix weighs them by its likelihood. If few of them count any more, those
are copied and spread a little. The belief of this filter may have any shape.

Source: Gordon, Salmond & Smith (1993), doi:10.1049/ip-f-2.1993.0015; Liu & West (2001),
doi:10.1007/978-1-4757-3437-9_10; 004 section 3.2; docs/mathematics/filters.md#particles.
Shapes: particles (..., M, n), log weights (..., M); f and h get (..., M, n), in slices of the particle axis.
Departures:

- Roughening is Liu and West's kernel, which shrinks towards the mean by as much as it spreads and so keeps the covariance.
  Without it biases, which no noise drives, end on one value.
- With ``matched``, draws have the moments that they stand for. Noise adds exactly Q, and copying and spreading keep mean and
  covariance.
- If fewer than the share ``min_ess`` or fewer than 2n particles count, all are moved together to the Kalman result of their
  moments. Such a step is counted as a fallback.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import flag, keep, number
from solvers.blocks.conditioning import condition
from solvers.blocks.mixtures import effective, normalise
from solvers.blocks.square_root import cholesky, semidefinite_root
from solvers.filters.base import count
from solvers.filters.inputs import wrapped
from solvers.filters.particles.importance import (
    bandwidth,
    cloud_images,
    fit,
    law_for,
    log_density,
    stand_in,
    through,
)
from solvers.filters.particles.particle_filter import PREDICT, ROUGHEN, Cloud, ParticleFilter, log_weights
from solvers.filters.particles.planes import cloud_moments, roughened, taken
from solvers.filters.particles.random_points import normals
from solvers.registry import register
from solvers.types import Function, Gaussian, Innovation, Measurement, Transition


@register("pf")
@dataclass(frozen=True)
class PF(ParticleFilter):
    """The particle filter."""

    roughening: float | None = None  #: width of the kernel as a share of the spread; None: the best for a Gaussian
    matched: bool = True  #: whether draws get the moments that they stand for

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.roughening is not None:
            keep(
                self, "roughening", number, "a number >= 0 (copies stay copies) and < 1, or None", least=0.0, below=1.0
            )
        keep(self, "matched", flag)

    def init(self, prior: Gaussian, rng: Any = None) -> Cloud:
        """Draw particles of the prior; ``rng`` is one Generator, or a sequence with one per run."""
        return self.start(prior, rng)[1]

    def predict(self, b: Cloud, tr: Transition) -> Cloud:
        """Move each particle by f, with noise of its own."""
        x = through(tr.f, b.x, self.memory_mb)
        S, repaired = semidefinite_root(tr.Q)
        S = driven_columns(S)
        N = normals("random", b.key, b.health.epoch, PREDICT, S.shape[-1], self.particles)
        noisy = roughened(x, np.zeros(x.shape[-1]), 1.0, N.mT, S)
        if self.matched:
            w = np.exp(b.log_w)
            y = cloud_moments(x, w)
            noisy, unfit = fit(noisy, y._replace(cov=y.cov + tr.Q), w)
            b = count(b, unfit)
        return count(b._replace(x=noisy), repaired)

    def correct(self, b: Cloud, me: Measurement) -> tuple[Cloud, Innovation]:
        """Weigh the particles; if few of them count, resample and roughen them, or move all to the Kalman result."""
        before, y = np.exp(b.log_w), through(me.h, b.x, self.memory_mb)
        prior, seen = cloud_images(me.h, b.x, y, before)
        law = law_for(self.likelihood, me.law)
        w, _ = normalise(b.log_w + log_density(wrapped(me.z[..., None, :] - y, me.turns), me.R, law, exact=True))
        number = effective(w)
        few = self.too_few(number, b.x.shape[-1])
        x, rows = b.x, (number < self.resample * self.particles) & ~few
        ess = np.where(np.isfinite(number), number / self.particles, 0.0)
        b = count(b._replace(ess=ess), fallbacks=few)
        repaired = np.zeros(few.shape, dtype=bool)
        if rows.any():
            new, repaired[rows] = self.renewed(b, w, rows)
            x = _replaced(x, rows, new)
            w[rows] = 1.0 / self.particles
        if few.any():
            R = stand_in(me.z - seen.mean, seen.cov, me.R, law)
            kalman, _, repaired_S = condition(prior, seen._replace(cov=seen.cov + R), me.z)
            moved, unfit = fit(b.x, kalman, before)
            x, w = np.where(few[..., None, None], moved, x), np.where(few[..., None], before, w)
            for mask in (repaired_S, unfit):
                repaired |= few & (mask is not None and mask)
        after = count(b._replace(x=x, log_w=log_weights(w)), repaired)
        return after, Innovation(me.z - seen.mean, seen.cov + me.R)

    def renewed(self, b: Cloud, w: Array, rows: Mask) -> tuple[Array, Mask]:
        """Return roughened copies (runs, M, n) of the surviving particles, in the runs of the mask, and the repaired runs."""
        M, n = b.x.shape[-2:]
        x = _chosen(b.x, rows)
        target = cloud_moments(x, _chosen(w, rows))
        x = taken(x, self.survivors(b, w, rows))
        S, repaired = cholesky(target.cov)
        h = bandwidth(M, n) if self.roughening is None else self.roughening
        if h:
            N = normals("random", b.key[rows], b.health.epoch, ROUGHEN, M, n)
            x = roughened(x, target.mean, math.sqrt(1.0 - h * h), N, h * S)
        if self.matched:
            x, repaired = fit(x, target)
        return x, np.zeros(len(x), dtype=bool) if repaired is None else repaired

    def estimate(self, b: Cloud) -> Gaussian:
        """Return the weighted mean (..., n) and covariance (..., n, n)."""
        return cloud_moments(b.x, np.exp(b.log_w))

    def move(self, b: Cloud, g: Function, jac: Callable[[Array], Array]) -> Cloud:
        return b._replace(x=through(g, b.x, self.memory_mb))


def driven_columns(S: Array) -> Array:
    """Return a root (..., n, n) without its zero columns, (..., n, k); the run with most columns gives k.

    The columns that another run lacks are behind its own, and zero. Random numbers are drawn column by column, so that a run
    draws the same ones in every batch.
    """
    zero = ~(S != 0.0).any(axis=-2)
    order = np.argsort(zero, axis=-1, kind="stable")
    k = int((~zero).sum(axis=-1).max())
    return np.take_along_axis(S, order[..., None, :], axis=-1)[..., :k]


def _chosen(a: Array, rows: Mask) -> Array:
    """Return the runs of the mask (...), a copy only if they are not all."""
    return a.reshape(-1, *a.shape[rows.ndim :]) if rows.all() else a[rows]


def _replaced(x: Array, rows: Mask, new: Array) -> Array:
    """Return x with ``new`` in the runs of the mask (...)."""
    if rows.all():
        return new.reshape(x.shape)
    x = x.copy()
    x[rows] = new
    return x


SAME_AS = {
    "pf": (),  # its particles are drawn
}
