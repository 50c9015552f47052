"""Gaussian particle filters with particles of the prediction: from pseudo-random points, and from quasi-random ones.

Idea: the moments of f(x) from particles of the belief, the moments after a fix from particles of the prediction weighed by
the likelihood; any likelihood will do. Quasi-random points fill space evenly, so that fewer do.

Source: Kotecha & Djuric (2003), doi:10.1109/TSP.2003.816758; 000 (5.2.1-13), (5.3.1-17); errata 53-58.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., M, n), in slices of the particle axis.
Departures: particles with the mean and covariance they are meant to have, in mirrored pairs (``matching``), no weight for
what a linear h does not see (``marginal``): without these the covariance drifts away over thousands of fixes. Weights sum
to one, where 000 (5.2.9-11) divides by M once more. The quasi-random sets are moved afresh at every draw.
"""

from __future__ import annotations

from dataclasses import dataclass

from sins_env.checks import choice, keep
from solvers.filters.particles.gaussian_particles import GaussianParticles
from solvers.filters.particles.random_points import POINTS
from solvers.filters.registry import register
from solvers.types import Gaussian, NoiseLaw


@register("gpf")
@dataclass(frozen=True)
class GPF(GaussianParticles):
    """The Gaussian particle filter."""

    def proposal(self, prior: Gaussian, kalman: Gaussian, law: NoiseLaw | None) -> Gaussian:
        return prior


@register("rqmc_gpf")
@dataclass(frozen=True)
class RQMCGPF(GPF):
    """The Gaussian particle filter with randomised quasi-random points."""

    particles: int = 2048  #: a power of two is best for Sobol points
    points: str = "sobol"  #: scrambled "sobol" or "halton", or "halton_start": Halton's from a random start, as in 000

    def __post_init__(self) -> None:
        super().__post_init__()
        keep(self, "points", choice, POINTS)

    @property
    def kind(self) -> str:
        return self.points
