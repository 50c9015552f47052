"""A cubature filter for this problem alone, written by hand in Numba: what a step costs when nothing is general.

All of a step is one compiled function over the runs: the root of P, twenty points through the map of the ten errors, their
moments, and the correction by two velocities. Nothing is checked, repaired or counted, and no other model fits.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numba import njit
from numba.np.unsafe.ndarray import to_fixed_tuple

from peers.contest import Block, Entry
from peers.plain_map import map_with
from peers.problem import STATES, Problem
from solvers.types import Gaussian


@cache
def compiled() -> Any:
    """Compile the step, which changes mean (runs, 10) and covariance (runs, 10, 10) in place."""
    after = njit(map_with(math), inline="always")
    n, points = STATES, 2 * STATES
    radius, weight = math.sqrt(STATES), 1.0 / (2 * STATES)

    @njit(error_model="numpy", fastmath={"contract"})
    def step(mean, cov, epochs, z, Q, R):  # type: ignore[no-untyped-def]
        L, X = np.zeros((n, n)), np.empty((n, points))
        for run in range(len(mean)):
            m, P, epoch = mean[run], cov[run], to_fixed_tuple(epochs[run], 28)
            for j in range(n):
                for i in range(j, n):
                    s = P[i, j]
                    for k in range(j):
                        s -= L[i, k] * L[j, k]
                    L[i, j] = math.sqrt(s) if i == j else s / L[j, j]
            for j in range(n):
                for i in range(n):
                    X[i, j] = m[i] + radius * L[i, j]
                    X[i, n + j] = m[i] - radius * L[i, j]
            for p in range(points):
                x = after(to_fixed_tuple(X[:, p], 10), epoch)
                for i in range(n):
                    X[i, p] = x[i]
            for i in range(n):
                s = 0.0
                for p in range(points):
                    s += X[i, p]
                m[i] = weight * s
                for p in range(points):
                    X[i, p] -= m[i]
            for i in range(n):
                for j in range(i + 1):
                    s = 0.0
                    for p in range(points):
                        s += X[i, p] * X[j, p]
                    P[i, j] = P[j, i] = weight * s + Q[i, j]
            a, b, c = P[0, 0] + R[0, 0], P[0, 1] + R[0, 1], P[1, 1] + R[1, 1]
            d = a * c - b * b
            u, v = z[run, 0] - m[0], z[run, 1] - m[1]
            for i in range(n):
                L[i, 0], L[i, 1] = (c * P[i, 0] - b * P[i, 1]) / d, (a * P[i, 1] - b * P[i, 0]) / d  # K
                m[i] += L[i, 0] * u + L[i, 1] * v
            for i in range(n):
                X[i, 0], X[i, 1] = P[i, 0], P[i, 1]
            for i in range(n):
                for j in range(i + 1):
                    P[i, j] = P[j, i] = P[i, j] - L[i, 0] * X[j, 0] - L[i, 1] * X[j, 1]
            for i in range(n):
                L[i, 0] = L[i, 1] = 0.0

    return step


def filter_runs(problem: Problem, runs: int) -> Block:
    """Make the block."""
    step, epochs = compiled(), np.ascontiguousarray(problem.epochs[:, :runs])
    Q, R, fixes = np.ascontiguousarray(problem.Q), np.ascontiguousarray(problem.R), problem.z[:, :runs].copy()

    def block() -> Gaussian:
        mean, cov = np.zeros((runs, STATES)), np.tile(problem.P0, (runs, 1, 1))
        for model, z in zip(epochs, fixes, strict=True):
            step(mean, cov, model, z, Q, R)
        return Gaussian(mean, cov)

    return block


def entries() -> list[Entry]:
    """Return the filter."""
    return [Entry("CKF", "Numba", "one function for this problem", filter_runs, batched=True, compiled=True)]
