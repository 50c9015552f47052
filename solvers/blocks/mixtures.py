"""Gaussian mixtures: weights (..., G), means (..., G, n) and covariances (..., G, n, n), with G components per run.

The functions that begin with ``spread`` let code for runs (...) work on all components (..., G) at once.
Equations: docs/mathematics/filters.md#mixtures and #split-and-merge.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.kernels import kernel
from solvers.types import Function, Gaussian, Linear, Measurement, Transition

LOG_FLOOR = -700.0  #: smallest log weight, relative to the largest; its exponential is still a normal number


@kernel("(g)->()")
def summed(terms: Array, total: Array) -> None:
    """Return the sum (...) over the components (..., G), term by term: components of weight zero behind change no bits.

    NumPy adds eight terms at a time, so its rounding depends on how many components other runs of the batch have.
    """
    total[0] = 0.0
    for g in range(len(terms)):
        total[0] += terms[g]


def normalise(log_weights: Array) -> tuple[Array, Array]:
    """Return weights (..., G) that sum to one, and the log (...) of the sum that they had."""
    top = log_weights.max(axis=-1, keepdims=True)
    weights = np.exp(np.maximum(log_weights - top, LOG_FLOOR))
    total = summed(weights)[..., None]
    return weights / total, (top + np.log(total))[..., 0]


def collapse(weights: Array, x: Gaussian) -> Gaussian:
    """Return the Gaussian with the mean and covariance of a mixture whose weights sum to one.

    Equations 004 (11-12), and 000 (3.5.25-26) with no. 41 of docs/mathematics/errata.md corrected.
    """
    return Gaussian(*_collapse(weights, x.mean, x.cov))


@kernel("(g),(g,n),(g,n,n)->(n),(n,n)")
def _collapse(weights: Array, x: Array, P: Array, mean: Array, cov: Array) -> None:
    n = len(mean)
    mean[:] = cov[:] = 0.0
    for g in range(len(weights)):
        for i in range(n):
            mean[i] += weights[g] * x[g, i]
    apart = np.empty(n)
    for g in range(len(weights)):
        for i in range(n):
            apart[i] = x[g, i] - mean[i]
        for i in range(n):
            for k in range(n):
                cov[i, k] += weights[g] * (P[g, i, k] + apart[i] * apart[k])
    for i in range(n):
        for k in range(i):
            cov[i, k] = cov[k, i] = 0.5 * (cov[i, k] + cov[k, i])


def merge(weights: Array, x: Gaussian) -> tuple[Array, Gaussian]:
    """Return one component with the weight (...), mean (..., n) and covariance (..., n, n) of all together.

    Equation 000 (3.5.21) with no. 39 of docs/mathematics/errata.md corrected.
    """
    total = summed(weights)
    return total, collapse(weights / total[..., None], x)


def effective(weights: Array) -> Array:
    """Return the effective number of components (...), which is 1 / sum of squared weights."""
    number: Array = 1.0 / summed(np.square(weights))
    return number


def split(x: Gaussian, v: Array, count: int) -> Gaussian:
    """Split ``x`` into ``count`` components of equal weight, (..., count, n), that keep its moments: 000 (3.5.16-20).

    Their means lie evenly along +-v (..., n) and carry the part v v' of the covariance, so v v' <= P is needed. The source takes
    v = sqrt(omega eta) V, with (eta, V) the largest eigenvalue and its vector, and omega in [0, 1).
    """
    s = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
    s *= math.sqrt(count / max(float(s @ s), 1.0))  # with a mean square of one
    v = v if count > 1 else np.zeros_like(v)
    mean = x.mean[..., None, :] + s[:, None] * v[..., None, :]
    cov = x.cov - v[..., :, None] * v[..., None, :]
    return Gaussian(mean, np.repeat(cov[..., None, :, :], count, axis=-3))


@dataclass(frozen=True)
class _Spread:
    """A function g of runs (*batch), made a function of components (*batch, G): the components pass as points."""

    g: Any
    axes: int  #: number of batch axes

    def __call__(self, x: Array) -> Array:
        if x.ndim <= self.axes + 2:  # (*batch, G, n)
            return self.g(x)
        batch, (G, points, n) = x.shape[: self.axes], x.shape[self.axes :]
        y = self.g(x.reshape(*batch, G * points, n))
        return y.reshape(*batch, G, points, y.shape[-1])

    @property
    def jacobian(self) -> Callable[[Array], Array] | None:
        """The Jacobian of g, if it has one."""
        return getattr(self.g, "jacobian", None)

    @property
    def value_and_jacobian(self) -> Callable[[Array], tuple[Array, Array]] | None:
        """The function for both at once, if g has it."""
        return getattr(self.g, "value_and_jacobian", None)


def spread(g: Function, axes: int) -> Function:
    """Make a function of runs one of components, with ``axes`` batch axes in front. ``Linear`` stays ``Linear``."""
    if not isinstance(g, Linear):
        return _Spread(g, axes)
    offset = g.offset if g.offset is None or g.offset.ndim == 1 else g.offset[..., None, :]
    return Linear(widen(g.matrix), offset)


def spread_transition(tr: Transition, axes: int) -> Transition:
    """Make the transition of runs one of components, with ``axes`` batch axes in front."""
    return tr._replace(f=spread(tr.f, axes), Q=widen(tr.Q))


def spread_measurement(me: Measurement, axes: int) -> Measurement:
    """Make the measurement of runs one of components, with ``axes`` batch axes in front; all see the same z."""
    return me._replace(z=me.z[..., None, :], h=spread(me.h, axes), R=widen(me.R))


def widen(matrix: Array) -> Array:
    """Give a matrix per run (..., m, n) an axis of components (..., 1, m, n); a shared one (m, n) stays."""
    return matrix[..., None, :, :] if matrix.ndim > 2 else matrix
