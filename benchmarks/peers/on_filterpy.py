"""filterpy: KalmanFilter, ExtendedKalmanFilter, UnscentedKalmanFilter and CubatureKalmanFilter, one run at a time."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import (
    CubatureKalmanFilter,
    ExtendedKalmanFilter,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)

from peers.contest import UKF, Entry, looped
from peers.problem import OneRun, Problem
from solvers.types import Array, Gaussian

DISTRIBUTION = "filterpy"


def started(o: object, problem: Problem) -> None:
    """Give a filter the prior and the noise of the problem."""
    o.x, o.P, o.Q, o.R = problem.mean, problem.P0.copy(), problem.Q, problem.R  # type: ignore[attr-defined]


def kf(problem: Problem, run: OneRun) -> Gaussian:
    """Filter one run with KalmanFilter."""
    o = KalmanFilter(dim_x=10, dim_z=2)
    started(o, problem)
    o.H = problem.H
    for F, z in zip(run.F, run.z, strict=True):
        o.predict(F=F)
        o.update(z)
    return Gaussian(o.x, o.P)


class EKF(ExtendedKalmanFilter):
    """ExtendedKalmanFilter with predict_x overridden, as its manual asks."""

    predicted: Array

    def predict_x(self, u: object = 0) -> None:
        self.x = self.predicted


def ekf(problem: Problem, run: OneRun) -> Gaussian:
    """Filter one run with ExtendedKalmanFilter."""
    o = EKF(dim_x=10, dim_z=2)
    started(o, problem)
    for k, z in enumerate(run.z):
        o.predicted, o.F = run.slope(k, o.x)
        o.predict()
        o.update(z, HJacobian=lambda x: problem.H, Hx=lambda x: x[:2])
    return Gaussian(o.x, o.P)


def ukf(problem: Problem, run: OneRun) -> Gaussian:
    """Filter one run with UnscentedKalmanFilter."""
    points = MerweScaledSigmaPoints(10, **UKF)
    o = UnscentedKalmanFilter(10, 2, dt=1.0, hx=lambda x: x[:2], fx=None, points=points)
    started(o, problem)
    for f, z in zip(run.plain, run.z, strict=True):
        o.predict(fx=lambda x, dt, f=f: f(x))
        o.update(z)
    return Gaussian(o.x, o.P)


def ckf(problem: Problem, run: OneRun) -> Gaussian:
    """Filter one run with CubatureKalmanFilter."""
    o = CubatureKalmanFilter(10, 2, dt=1.0, hx=lambda x: x[:2], fx=lambda x, dt, f: f(x))
    started(o, problem)
    o.x = o.x[:, None]  # with a state (10,) it broadcasts the fix to (10, 2)
    for f, z in zip(run.plain, run.z, strict=True):
        o.predict(fx_args=(f,))
        o.update(z[:, None])
    return Gaussian(np.ravel(o.x), o.P)


def entries() -> list[Entry]:
    """Return the filters of the package."""
    return [
        Entry("KF", "NumPy", "F given", looped(kf)),
        Entry("EKF", "NumPy", "f and Jacobian in NumPy", looped(ekf)),
        Entry("UKF", "NumPy", "f in floats, point by point", looped(ukf)),
        Entry(
            "CKF",
            "NumPy",
            "f in floats, point by point",
            looped(ckf),
            remark="whose update takes the points from before Q was added, so that the gain does not know of it",
        ),
    ]
