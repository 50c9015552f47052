"""The filter contract: what flows between the model, the blocks and the filters.

Shapes are batch first: ``...`` is any batch shape, ``()`` for one run, ``(256,)`` for a Monte Carlo. A *belief* holds
everything that a filter knows. The filter itself is a frozen dataclass of settings and keeps nothing.
Equations: docs/mathematics/filters.md#model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask

__all__ = [
    "MISSING",
    "Chart",
    "Filter",
    "Function",
    "Gaussian",
    "Health",
    "Innovation",
    "Linear",
    "Measurement",
    "Moments",
    "NoiseLaw",
    "Transition",
]


class Function(Protocol):
    """A function (..., n) -> (..., m) that acts on the last axis, such as f, h or a ``Linear``."""

    def __call__(self, x: Array, /) -> Array: ...


class Gaussian(NamedTuple):
    """A Gaussian by its moments: of the state, of a noise, or of a prior."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)


class Linear(NamedTuple):
    """The map x -> matrix x + offset. Every filter uses it exactly instead of drawing points through it."""

    matrix: Array  #: (..., m, n), or (m, n) shared by all runs
    offset: Array | None = None  #: (..., m)

    def __call__(self, x: Array) -> Array:
        y = np.matmul(self.matrix, x[..., None])[..., 0]
        return y if self.offset is None else y + self.offset


class Transition(NamedTuple):
    """The model of one epoch, x' = f(x) + w with w ~ N(0, Q), equation 000 (3.2.1).

    ``f`` takes ``(*batch, n)`` and, for sigma points, ``(*batch, points, n)``. Like ``h`` it must not depend on how often
    it is called.
    """

    f: Function
    Q: Array  #: (..., n, n), or (n, n) shared by all runs
    G: Array | None = None  #: (n, p): the directions that the noise drives; None: all states
    dt: float | None = None  #: s, length of the epoch; None: not told


class NoiseLaw(NamedTuple):
    """The distribution of the measurement noise v beyond its R, if a task tells it: contaminated, or Student-t.

    One factor s scales the whole vector: v = s v0 with v0 ~ N(0, R). Contamination has s^2 = ``factor`` in a ``share``
    of the fixes, else 1. Student-t has s^2 = dof / chi^2(dof), so that R is the scale matrix of the distribution.
    """

    share: float = 0.0  #: share of the fixes that are contaminated, 0 to 1
    factor: float = 1.0  #: variance of a contaminated fix over that of a good one
    dof: float = 0.0  #: degrees of freedom of Student-t; 0: no Student-t


MISSING = 1e15  #: least variance in R that marks a component of a fix as missing


class Chart(NamedTuple):
    """Tangent vectors about any point of a manifold, for states or fixes that are no vectors.

    A point has p numbers, such as the four of a unit quaternion, and a tangent vector has n, one for each degree of freedom.
    ``minus(plus(x, d), x)`` is d. Both act on the last axis and broadcast the axes in front.
    """

    plus: Callable[
        [Array, Array], Array
    ]  #: (..., p), (..., n) -> (..., p): plus(x, d) is the point that d leads to from x
    minus: Callable[
        [Array, Array], Array
    ]  #: (..., p), (..., p) -> (..., n): minus(y, x) is the d that leads from x to y


class Measurement(NamedTuple):
    """A fix and its model, z = h(x) + v with v ~ N(0, R), equation 000 (3.2.1).

    A component is missing if ``present`` is False, if its z is NaN, or if its variance in R is ``MISSING`` or more. A run is
    corrected by the components that are there; one without any has no fix in this epoch.
    """

    z: Array  #: (..., m), or (m,) shared by all runs
    h: Function
    R: Array  #: (..., m, m), or (m, m) shared by all runs
    law: NoiseLaw | None = None  #: distribution of v; None: Gaussian
    present: Mask | None = None  #: (..., m), or (m,): whether a component is there; None: where z is not NaN
    turns: Mask | None = None  #: (m,), whether a component is an angle in rad, whose innovation is within half a turn
    #: for a fix that is a point: z and h(x) are points (..., p), R and the innovation belong to the tangent at z; None: a vector
    chart: Chart | None = None


class Moments(NamedTuple):
    """Mean and covariance of y = g(x) for Gaussian x, and the cross covariance of x and y."""

    mean: Array  #: (..., m)
    cov: Array  #: (..., m, m)
    cross: Array  #: (..., n, m)


class Innovation(NamedTuple):
    """What a fix told beyond its prediction: z minus the predicted z, and the covariance S of this difference.

    Missing components are NaN in both.
    """

    residual: Array  #: (..., m), z minus its prediction
    cov: Array  #: (..., m, m), S with R included


class Health(NamedTuple):
    """What went wrong in each run of a batch: counted and reported, never silent."""

    epoch: int  #: number of steps taken since ``init``
    repairs: NDArray[np.int64]  #: (...), number of covariances that had to be repaired
    failed_at: NDArray[np.int64]  #: (...), the epoch at which the run was frozen; -1 while it is well
    fallbacks: NDArray[np.int64]  #: (...), number of times that a safeguard replaced the filter's own rule
    frozen: bool = False  #: whether any run of the batch is frozen; saves a search at each step


B = TypeVar("B")


class Filter(Protocol[B]):
    """What the pipeline asks of a filter: a frozen dataclass of settings, through which a belief ``b`` flows.

    ``b.health`` tells how each run fares.
    """

    def init(self, prior: Gaussian, rng: Any) -> B:
        """Make the belief at the start from a prior (..., n), (..., n, n).

        ``rng`` is one NumPy Generator, or a sequence with one per run.
        """
        ...

    def step(self, b: B, tr: Transition, me: Measurement | None) -> tuple[B, Innovation | None]:
        """Predict over one epoch, then correct with the measurement, if there is one."""
        ...

    def estimate(self, b: B) -> Gaussian:
        """Return mean (..., n) and covariance (..., n, n), whatever the belief is made of."""
        ...

    def diagnostics(self, b: B) -> dict[str, Array]:
        """Return what the filter knows beside its estimate, by name: arrays with the batch axes in front."""
        ...

    def relocate(self, b: B, g: Function, jac: Callable[[Array], Array]) -> B:
        """Move every mean, point or particle x to g(x), and every covariance P to J(x) P J(x)'.

        The pipeline does so when it feeds an estimate back into the INS: docs/mathematics/error_models.md#feedback.
        """
        ...
