"""Entries of a package in the comparison: one of its filters, ready to filter a number of runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from peers.problem import OneRun, Problem
from solvers.types import Gaussian

#: Settings of all unscented filters: every point has a weight, and the two weights of the centre differ.
UKF = {"alpha": 1.0, "beta": 2.0, "kappa": 1.0}

#: A function that filters all steps of some runs, and returns means (runs, 10) and covariances (runs, 10, 10) at the end.
Block = Callable[[], Gaussian]


@dataclass(frozen=True)
class Entry:
    """A filter of a package."""

    filter: str  #: "KF", "EKF", "UKF" or "CKF"
    numbers: str  #: the library on which it runs, "NumPy", "Numba" or "JAX"
    how: str  #: what it is given, and how it steps
    make: Callable[[Problem, int], Block]  #: makes the block for the first runs of the problem
    batched: bool = False  #: whether it takes many runs at once; else they are filtered one after another
    compiled: bool = False  #: whether the first call compiles
    stepped: bool = True  #: whether it is called for each fix, as an environment wants it; else once for a whole record
    remark: str = ""  #: why it differs from our filter


def looped(one: Callable[[Problem, OneRun], Gaussian]) -> Callable[[Problem, int], Block]:
    """Make the maker of blocks for a filter that takes one run at a time."""

    def make(problem: Problem, runs: int) -> Block:
        each = [problem.one(i) for i in range(runs)]

        def block() -> Gaussian:
            ends = [one(problem, run) for run in each]
            return Gaussian(np.stack([end.mean for end in ends]), np.stack([end.cov for end in ends]))

        return block

    return make
