"""The filter contract: what flows between the model, the blocks and the filters.

Shapes are batch first: ``...`` is any batch shape, ``()`` for one run, ``(256,)`` for a Monte Carlo. A *belief*
holds everything a filter knows; a filter itself is a frozen dataclass of settings and keeps nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array


class Function(Protocol):
    """(..., n) -> (..., m), acts on the last axis. A protocol, for mypy does not take ``Linear`` as a Callable."""

    def __call__(self, x: Array, /) -> Array: ...


class Gaussian(NamedTuple):
    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)


class Linear(NamedTuple):
    """The map x -> matrix x + offset, which every filter uses exactly instead of drawing points through it."""

    matrix: Array  #: (..., m, n), or (m, n) shared by all runs
    offset: Array | None = None  #: (..., m)

    def __call__(self, x: Array) -> Array:
        y = np.matmul(self.matrix, x[..., None])[..., 0]
        return y if self.offset is None else y + self.offset


class Transition(NamedTuple):
    """x' = f(x) + w, w ~ N(0, Q). ``f`` takes (*batch, n) and, for sigma points, (*batch, points, n)."""

    f: Function
    Q: Array  #: (..., n, n), or (n, n) shared by all runs
    G: Array | None = None  #: (n, p): the directions that the noise drives; None: all
    dt: float | None = None  #: s


class NoiseLaw(NamedTuple):
    """How v is distributed, beyond its R, where that is told: a mixture, or Student-t; else Gaussian.

    Both scale the whole vector: v = s v0, v0 ~ N(0, R), with s^2 = ``factor`` in a ``share`` of the fixes, or
    s^2 = dof / chi^2(dof), so that R is the scale matrix of the t distribution.
    """

    share: float = 0.0  #: of the fixes that are contaminated
    factor: float = 1.0  #: of their variance
    dof: float = 0.0  #: degrees of freedom of Student-t; 0: Gaussian


MISSING = 1e15  #: variance in R from which on a run has no fix, where others of its batch have one


class Measurement(NamedTuple):
    """z = h(x) + v, v ~ N(0, R). A run whose R begins with ``MISSING`` or more has no fix."""

    z: Array  #: (..., m)
    h: Function
    R: Array  #: (..., m, m), or (m, m) shared by all runs; beyond 1e15 in runs without a fix, where others have one
    law: NoiseLaw | None = None  #: None: Gaussian


class Moments(NamedTuple):
    """Mean and covariance of y = g(x) for Gaussian x, and the cross covariance of x and y."""

    mean: Array  #: (..., m)
    cov: Array  #: (..., m, m)
    cross: Array  #: (..., n, m)


class Innovation(NamedTuple):
    residual: Array  #: (..., m) z minus its prediction
    cov: Array  #: (..., m, m) S


class Health(NamedTuple):
    """What went wrong in each run of a batch: counted and reported, never silent."""

    epoch: int  #: steps taken since init
    repairs: NDArray[np.int64]  #: (...) covariance repairs so far
    failed_at: NDArray[np.int64]  #: (...) the epoch at which the run was frozen; -1 while it is well
    fallbacks: NDArray[np.int64]  #: (...) times that a safeguard replaced the filter's own rule
    frozen: bool = False  #: whether any run was: one look per step instead of a search


B = TypeVar("B")


class Filter(Protocol[B]):
    """A frozen dataclass of settings. The belief ``b`` flows through; ``b.health`` tells how each run fares."""

    def init(self, prior: Gaussian, rng: Any) -> B:
        """The belief at the start. ``rng``: one Generator, or a sequence with one per run."""
        ...

    def step(self, b: B, tr: Transition, me: Measurement | None) -> tuple[B, Innovation | None]:
        """Predict over one epoch, then correct with the measurement, if there is one."""
        ...

    def estimate(self, b: B) -> Gaussian:
        """Mean and covariance, whatever the belief is made of."""
        ...

    def diagnostics(self, b: B) -> dict[str, Array]:
        """What the filter knows beside its estimate, by name: arrays with the batch axes in front."""
        ...

    def relocate(self, b: B, g: Function, jac: Callable[[Array], Array]) -> B:
        """Feedback: every mean, point or particle x -> g(x), every covariance P -> J(x) P J(x)'."""
        ...
