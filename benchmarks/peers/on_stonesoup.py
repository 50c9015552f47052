"""Stone Soup: its Kalman, extended, unscented and cubature predictors and updaters, one run at a time."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.base import TransitionModel
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import (
    CubatureKalmanPredictor,
    ExtendedKalmanPredictor,
    KalmanPredictor,
    UnscentedKalmanPredictor,
)
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import CubatureKalmanUpdater, KalmanUpdater, UnscentedKalmanUpdater

from peers.contest import UKF, Entry, looped
from peers.problem import OneRun, Problem
from solvers.types import Gaussian

DISTRIBUTION = "stonesoup"
START = datetime.datetime(2000, 1, 1)


class EpochModel(TransitionModel):
    """The model x' = f(x) + w of one epoch, for one state vector or for many side by side."""

    arrays: Callable[..., Any] = Property(doc="f on (..., 10)")
    plain: Callable[..., Any] = Property(doc="f on (10,)")
    slope: Callable[..., Any] = Property(doc="value and Jacobian of f on (10,)")
    noise: Any = Property(doc="Q")

    @property
    def ndim_state(self) -> int:
        return len(self.noise)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        x = state.state_vector
        if x.shape[1] == 1:
            return StateVector(self.plain(np.asarray(x)[:, 0]))
        return StateVectors(self.arrays(np.ascontiguousarray(np.asarray(x).T)).T)

    def jacobian(self, state: Any, **kwargs: Any) -> Any:
        return self.slope(np.asarray(state.state_vector)[:, 0])[1]

    def covar(self, **kwargs: Any) -> Any:
        return self.noise

    def rvs(self, num_samples: int = 1, **kwargs: Any) -> Any:
        raise NotImplementedError("filters draw nothing")

    def pdf(self, state1: Any, state2: Any, **kwargs: Any) -> Any:
        raise NotImplementedError("filters ask for no density")


def linear(problem: Problem, run: OneRun, k: int) -> Any:
    """Return the linear model of epoch k."""
    return LinearGaussianTimeInvariantTransitionModel(transition_matrix=run.F[k], covariance_matrix=problem.Q)


def nonlinear(problem: Problem, run: OneRun, k: int) -> Any:
    """Return the nonlinear model of epoch k."""
    return EpochModel(run.arrays[k], run.plain[k], lambda x: run.slope(k, x), problem.Q)


def filtered(model: Callable[[Problem, OneRun, int], Any], predictor: Any, updater: Any) -> Any:
    """Make the blocks of a predictor and an updater, whose transition model changes with the epoch."""

    def one(problem: Problem, run: OneRun) -> Gaussian:
        models = [model(problem, run, k) for k in range(len(run.z))]
        h = LinearGaussian(ndim_state=10, mapping=(0, 1), noise_covar=problem.R)
        predict, update = predictor(models[0]), updater(h)
        state = GaussianState(problem.mean, problem.P0, timestamp=START)
        for k, z in enumerate(run.z):
            predict.transition_model = models[k]
            time = START + datetime.timedelta(seconds=k + 1)
            prediction = predict.predict(state, timestamp=time)
            detection = Detection(z, timestamp=time, measurement_model=h)
            state = update.update(SingleHypothesis(prediction, detection))
        return Gaussian(np.ravel(state.mean), np.asarray(state.covar))

    return looped(one)


def entries() -> list[Entry]:
    """Return the filters of the package."""
    return [
        Entry("KF", "NumPy", "F given", filtered(linear, KalmanPredictor, KalmanUpdater)),
        Entry("EKF", "NumPy", "f and Jacobian in NumPy", filtered(nonlinear, ExtendedKalmanPredictor, KalmanUpdater)),
        Entry(
            "UKF",
            "NumPy",
            "all points at once",
            filtered(
                nonlinear,
                lambda model: UnscentedKalmanPredictor(model, **UKF),
                lambda h: UnscentedKalmanUpdater(h, **UKF),
            ),
        ),
        Entry(
            "CKF",
            "NumPy",
            "f in floats, point by point",
            filtered(nonlinear, CubatureKalmanPredictor, CubatureKalmanUpdater),
        ),
    ]
