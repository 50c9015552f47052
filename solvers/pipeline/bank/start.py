"""The slices at the start of a bank: a told attitude, or a level at switch-on, with headings side by side."""

from __future__ import annotations

import math

import numpy as np

from sins_env.arrays import Array
from sins_env.types import NavState
from solvers.filters.mixtures.angles import slices
from solvers.pipeline import feedback

MOST_SLICES = 36


def told(nav: NavState, variance: Array, spacing: float) -> tuple[NavState, Array, Array]:
    """Cut a start with the ``variance`` () of its heading, rad^2, into slices of at most ``spacing`` rad.

    Return the states (runs, G, ...), the weights (G,) and the variance of the heading in a slice, rad^2.
    """
    offsets, weights, variance = slices(variance, spacing, MOST_SLICES)
    return turned(nav, offsets), weights, variance


def anywhere(nav: NavState, spacing: float) -> tuple[NavState, Array, Array]:
    """Cut the circle into slices of at most ``spacing`` rad; returns what :func:`told` does."""
    count = math.ceil(2.0 * math.pi / spacing)
    half = math.pi / count
    offsets = half * np.arange(1 - count, count, 2, dtype=np.float64)
    return turned(nav, offsets), np.full(count, 1.0 / count), np.array(half**2 if count > 1 else math.pi**2 / 3.0)


def turned(nav: NavState, offsets: Array) -> NavState:
    """Return the states (runs, G, ...) of which the headings differ from that of ``nav`` by ``offsets`` (G,), rad."""
    phi = np.zeros((len(offsets), 3))
    phi[:, 2] = offsets
    q_nb = feedback.corrected(nav.q_nb[:, None], phi)
    return NavState(q_nb, *(np.repeat(part[:, None], len(offsets), axis=1) for part in nav[1:]))
