"""The problem that every package gets: epochs of the swaying base as an INS saw them, and fixes of two velocities.

It is recorded once from the task through our own pipeline, with the INS open loop. The second axis is that of the runs. Run 0
is the one that is filtered alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from costs import Recorder
from numpy.typing import NDArray

from peers.plain_map import coefficients, plain
from sins_env.evaluation.estimators.isolation import Here
from sins_env.evaluation.speed.timing import Probe
from sins_env.evaluation.tasks.catalogue import get_task
from solvers.blocks.moments import tangent
from solvers.pipeline.errors.alignment import AlignmentErrors
from solvers.pipeline.estimator import Aligner
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Function, Gaussian, Transition

Array = NDArray[np.float64]

STATES = 10


@dataclass(frozen=True)
class RecordedErrors(AlignmentErrors):
    """The error model, which keeps the epochs that it is given."""

    motions: list[EpochMotion] = field(default_factory=list)

    def transition(self, motion: EpochMotion, Q: Array) -> Transition:
        self.motions.append(motion)
        return super().transition(motion, Q)


@dataclass(frozen=True)
class Problem:
    """The filtering problem: x' = f_k(x) + w and z = H x + v, with x ~ N(0, P0) at the start."""

    P0: Array  #: (10, 10)
    Q: Array  #: (10, 10)
    R: Array  #: (2, 2)
    z: Array  #: (steps, runs, 2) m/s
    motions: tuple[EpochMotion, ...]  #: motion of each step, with the runs in front

    H = np.eye(2, STATES)

    @property
    def mean(self) -> Array:
        """Mean (10,) of the state at the start."""
        return np.zeros(STATES)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.z)

    @cached_property
    def epochs(self) -> Array:
        """Coefficients of the plain map, (steps, runs, 28)."""
        return np.stack([coefficients(m) for m in self.motions])

    @cached_property
    def F(self) -> Array:
        """Jacobians of f at zero error, where f is zero, (steps, runs, 10, 10): the model of the Kalman filter."""
        slopes = []
        for f in self.maps(slice(None)):
            value, J = tangent(f, np.zeros((*self.z.shape[1:2], STATES)), np.sqrt(np.diagonal(self.P0)))
            assert not value.any(), "the INS without errors has none after the epoch"
            slopes.append(J)
        return np.stack(slopes)

    def maps(self, runs: slice | int) -> list[Function]:
        """Return f of each step for some runs, or for one run without a run axis."""
        model = AlignmentErrors()
        return [model.transition(of_runs(m, runs), self.Q).f for m in self.motions]

    def one(self, run: int) -> OneRun:
        """Return the problem of one run."""
        epochs = self.epochs[:, run]
        return OneRun(self.z[:, run], self.maps(run), [plain(e, math) for e in epochs], self.F[:, run], epochs, self.P0)


@dataclass(frozen=True)
class OneRun:
    """The problem of one run; each package takes the form of f with which it is fastest."""

    z: Array  #: (steps, 2)
    arrays: list[Function]  #: f of each step in NumPy, on one state or on many, (..., 10)
    plain: list[Callable[[Array], Array]]  #: f of each step in floats, on one state (10,)
    F: Array  #: (steps, 10, 10)
    epochs: Array  #: (steps, 28)
    P0: Array

    def slope(self, k: int, x: Array) -> tuple[Array, Array]:
        """Return f of step k at x (10,), and its Jacobian by central differences, which our ekf takes too."""
        return tangent(self.arrays[k], x, np.sqrt(np.diagonal(self.P0)))


def of_runs(m: EpochMotion, runs: slice | int) -> EpochMotion:
    """Return the motion of some of the runs; values that all runs share stay."""
    return m._replace(C=m.C[runs], dvel_n=m.dvel_n[runs], vel=m.vel[runs], rate_en=m.rate_en[runs])


def record(task: str, runs: int, steps: int) -> Problem:
    """Record the first steps of a task, with two or more runs."""
    recorder, errors = Recorder(runs), RecordedErrors()

    def recording() -> Aligner:
        aligner = Aligner(recorder, feedback="open")
        aligner.errors = errors
        return aligner

    Probe(get_task(task), Here(recording), runs, warm_up=steps).close()
    transitions, fixes = zip(*recorder.epochs, strict=True)
    prior: Gaussian = recorder.prior
    assert all(fix.law is None and fix.R.shape == (2, 2) for fix in fixes), "a Gaussian fix at each epoch"
    z = np.stack([fix.z for fix in fixes])
    return Problem(prior.cov[0], transitions[0].Q, fixes[0].R, z, tuple(errors.motions))
