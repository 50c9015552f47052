"""The least known angle of a state, and its prior in slices that are narrow enough for a tangent each.

The angle is the state in which f has the period 2 pi but is not linear; among several, the one of largest variance. A period
means f(x + 2 pi e) = f(x) + 2 pi k e. Here k is 1, or 0 for a rotation vector, whose angle f keeps below half a turn.

The slices are cells of equal width over +-3 sigma, or over the circle if that is shorter. Their weights are those of the
Gaussian, wound around the circle. In the angle a slice has a standard deviation of half a cell. The other states follow the
prior's regression on the angle. Mean and covariance of the prior are thus kept, unless it fills the circle.
Equations: docs/mathematics/filters.md#bank-over-the-heading.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from solvers.blocks.mixtures import summed
from solvers.types import Function, Linear

TURN = 2.0 * math.pi  #: rad, a full turn


def least_known_angle(f: Function, x: Array, P: Array) -> NDArray[np.int64]:
    """Return the index (...) of the state of largest variance in which ``f`` has period 2 pi but is not linear; -1: none.

    ``f`` is asked at x (..., n); P is (..., n, n).
    """
    if isinstance(f, Linear):
        return np.full(x.shape[:-1], -1)
    n = x.shape[-1]
    step = np.concatenate([np.zeros((1, n)), TURN * np.eye(n), np.eye(n)])  # a whole turn, and one radian
    y = f(x[..., None, :] + step) - step
    y0 = y[..., :1, :]
    change = y - y0
    own = change[..., np.arange(1, n + 1), np.arange(n)]
    change[..., np.arange(1, n + 1), np.arange(n)] = own - TURN * np.round(own / TURN)
    change = np.abs(change).max(axis=-1)
    turned, moved = change[..., 1 : n + 1], change[..., n + 1 :]
    angle = (moved > 1e-9 * (1.0 + np.abs(y0).max(axis=-1))) & (turned < 1e-6 * moved)
    variance = np.where(angle, np.diagonal(P, axis1=-2, axis2=-1), 0.0)
    return np.where((variance > 0.0).any(axis=-1), variance.argmax(axis=-1), -1)


def slices(variance: Array, spacing: float, most: int) -> tuple[Array, Array, Array]:
    """Return offsets (..., G) in rad, weights (..., G) and variance (...) in rad^2 of the slices of N(0, variance).

    ``spacing`` is the largest width of a slice in rad, ``most`` the largest number of slices. A run that needs fewer than G
    slices has weights of zero behind its own.
    """
    sigma = np.sqrt(np.maximum(variance, 0.0))
    whole = 3.0 * sigma >= 0.5 * TURN  # the Gaussian fills the circle
    reach = np.minimum(3.0 * sigma, 0.5 * TURN)
    number = np.where(sigma > 0.5 * spacing, np.clip(np.ceil(2.0 * reach / spacing), 1, most), 1.0)[..., None]
    half = reach[..., None] / number  # standard deviation of a slice: half its width
    j = np.arange(int(number.max(initial=1.0)))
    offset = (2.0 * j + 1.0 - number) * half
    rest = np.maximum(variance[..., None] - half**2, 0.0)  # variance that is left to the offsets
    scale = 0.5 / np.where(number > 1.0, np.maximum(rest, 0.25 * half**2), 1.0)
    weight = np.exp(-scale * offset**2)
    wound = np.exp(-scale * (TURN - np.abs(offset)) ** 2)  # the tail that comes from the other side of the circle
    weight = np.where(j < number, np.where(number > 1.0, weight + whole[..., None] * wound, 1.0), 0.0)
    weight /= summed(weight)[..., None]
    carried = summed(weight * offset**2)[..., None]
    stretch = np.sqrt(np.divide(rest, carried, out=np.ones(rest.shape), where=(carried > 0.0) & ~whole[..., None]))
    offset = np.where(weight > 0.0, stretch * offset, 0.0)
    return offset, weight, np.where(number[..., 0] > 1.0, half[..., 0] ** 2, variance)
