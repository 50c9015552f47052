"""Gaussian particle filters with particles drawn from the prediction, by pseudo-random or quasi-random points.

Idea: the moments of f(x) from particles of the belief, the moments after a fix from particles of the prediction weighed by
the likelihood. Any likelihood will do. Quasi-random points fill space evenly, so that fewer are enough.

Source: Kotecha & Djuric (2003), doi:10.1109/TSP.2003.816758; 000 (5.2.1-13), (5.3.1-17);
docs/mathematics/filters.md#gaussian-particles.
Shapes: x (..., n), P (..., n, n), z (..., m); f and h get (..., M, n), in slices of the particle axis.
Departures, with the numbers of docs/mathematics/errata.md#chapter-5:

- Particles have exactly the mean and covariance that they stand for, in mirrored pairs (``matching``). Directions that a linear
  h does not see are not weighed (``marginal``). Otherwise the covariance drifts over thousands of fixes (58).
- Weights sum to one; 000 (5.2.9-11) divides by M once more (53).
- The quasi-random sets are moved afresh at every draw.
"""

from __future__ import annotations

from dataclasses import dataclass

from sins_env.checks import choice, keep
from solvers.filters.particles.gaussian_particles import GaussianParticles
from solvers.filters.particles.random_points import POINTS
from solvers.filters.relations import Relation
from solvers.registry import register
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

    particles: int = 2048  #: number of particles; a power of two is best for Sobol points
    points: str = "sobol"  #: "sobol", "halton" (both scrambled), or "halton_start", Halton's from a random start

    def __post_init__(self) -> None:
        super().__post_init__()
        keep(self, "points", choice, POINTS)

    @property
    def kind(self) -> str:
        return self.points


SAME_AS = {
    "gpf": (
        Relation("ckf", {"min_ess": 0.999}, on="linear", within=1e-10),  # every step falls back
    ),
    "rqmc_gpf": (),  # its particles are drawn
}
UNLIKE = {
    "rqmc_gpf": (Relation("gpf"),),
}
