"""What a package enters into the comparison: one of its filters, ready to filter a number of runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from peers.problem import OneRun, Problem
from solvers.types import Gaussian

#: of the unscented filters, everywhere: all points count, and the centre's two weights differ
UKF = {"alpha": 1.0, "beta": 2.0, "kappa": 1.0}

Block = Callable[
    [], Gaussian
]  #: filters all steps of some runs: means (runs, 10), covariances (runs, 10, 10) at the end


@dataclass(frozen=True)
class Entry:
    """A filter of a package."""

    filter: str  #: "KF", "EKF", "UKF" or "CKF"
    numbers: str  #: "NumPy" or "JAX", on which it runs
    how: str  #: what it is given, and how it steps
    make: Callable[[Problem, int], Block]  #: the block for the first runs of the problem
    batched: bool = False  #: whether it takes many runs at once; else they are filtered one after another
    compiled: bool = False  #: whether the first call compiles
    remark: str = ""  #: why it differs from ours


def looped(one: Callable[[Problem, OneRun], Gaussian]) -> Callable[[Problem, int], Block]:
    """The maker for a filter of one run."""

    def make(problem: Problem, runs: int) -> Block:
        each = [problem.one(i) for i in range(runs)]

        def block() -> Gaussian:
            ends = [one(problem, run) for run in each]
            return Gaussian(np.stack([end.mean for end in ends]), np.stack([end.cov for end in ends]))

        return block

    return make
