"""Gaussian mixtures: weights (..., G), means (..., G, n), covariances (..., G, n, n); G components per run.

``spread`` lets what was written for runs (...) work on all components (..., G) at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sins_env.arrays import Array
from solvers.blocks.square_root import symmetrize
from solvers.types import Function, Gaussian, Linear, Measurement, Transition

LOG_FLOOR = -700.0  #: smallest log weight before normalisation, relative to the largest: exp still has it


def normalise(log_weights: Array) -> tuple[Array, Array]:
    """Weights (..., G) that sum to one, and the log of the sum that they had (...)."""
    top = log_weights.max(axis=-1, keepdims=True)
    weights = np.exp(np.maximum(log_weights - top, LOG_FLOOR))
    total = weights.sum(axis=-1, keepdims=True)
    return weights / total, (top + np.log(total))[..., 0]


def collapse(weights: Array, x: Gaussian) -> Gaussian:
    """The Gaussian with the mean and covariance of the mixture; the weights sum to one. # 004 (11-12), 3.5.25-26 corrected"""
    mean = (weights[..., None, :] @ x.mean)[..., 0, :]
    apart = x.mean - mean[..., None, :]
    *batch, G, n, _ = x.cov.shape
    within = (weights[..., None, :] @ x.cov.reshape(*batch, G, n * n))[..., 0, :].reshape(*mean.shape, n)
    cov = within + (apart * weights[..., None]).mT @ apart
    return Gaussian(mean, symmetrize(cov))


def merge(weights: Array, x: Gaussian) -> tuple[Array, Gaussian]:
    """One component with the weight, mean and covariance of all: (...), and Gaussian (..., n). # 000 (3.5.21) corrected"""
    total = weights.sum(axis=-1)
    return total, collapse(weights / total[..., None], x)


def effective(weights: Array) -> Array:
    """The number of components that matter, 1 / sum of squared weights (...)."""
    number: Array = 1.0 / np.square(weights).sum(axis=-1)
    return number


def split(x: Gaussian, v: Array, count: int) -> Gaussian:
    """``count`` components of equal weight, (..., count, n), with the moments of ``x``. # 000 (3.5.16-20)

    Their means lie evenly along +-v (..., n) and carry the part v v' of the covariance, which must not exceed it;
    000 takes v = sqrt(omega eta) V, with (eta, V) the largest eigenpair and omega in [0, 1).
    """
    s = np.linspace(-1.0, 1.0, count) if count > 1 else np.zeros(1)
    s *= math.sqrt(count / max(float(s @ s), 1.0))  # mean square one
    v = v if count > 1 else np.zeros_like(v)
    mean = x.mean[..., None, :] + s[:, None] * v[..., None, :]
    cov = x.cov - v[..., :, None] * v[..., None, :]
    return Gaussian(mean, np.repeat(cov[..., None, :, :], count, axis=-3))


@dataclass(frozen=True)
class _Spread:
    """g of runs (*batch) as a function of components (*batch, G): the components pass as points."""

    g: Any
    axes: int  #: of the batch

    def __call__(self, x: Array) -> Array:
        if x.ndim <= self.axes + 2:  # (*batch, G, n)
            return self.g(x)
        y = self.g(x.reshape(*x.shape[: self.axes], -1, x.shape[-1]))  # (*batch, G, points, n)
        return y.reshape(*x.shape[:-1], y.shape[-1])

    @property
    def jacobian(self) -> Callable[[Array], Array] | None:
        """That of g, if it has one."""
        return getattr(self.g, "jacobian", None)


def spread(g: Function, axes: int) -> Function:
    """``g`` for components: ``axes`` batch axes stand before theirs. ``Linear`` stays ``Linear``."""
    if not isinstance(g, Linear):
        return _Spread(g, axes)
    offset = g.offset if g.offset is None or g.offset.ndim == 1 else g.offset[..., None, :]
    return Linear(widen(g.matrix), offset)


def spread_transition(tr: Transition, axes: int) -> Transition:
    """``tr`` for components."""
    return tr._replace(f=spread(tr.f, axes), Q=widen(tr.Q))


def spread_measurement(me: Measurement, axes: int) -> Measurement:
    """``me`` for components: all of them see the same z."""
    return me._replace(z=me.z[..., None, :], h=spread(me.h, axes), R=widen(me.R))


def widen(matrix: Array) -> Array:
    """A matrix per run (..., m, n) as one per component (..., 1, m, n); one (m, n) that all runs share stays."""
    return matrix[..., None, :, :] if matrix.ndim > 2 else matrix
