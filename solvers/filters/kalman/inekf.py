"""Invariant extended Kalman filter.

Idea: the error of an INS as an element of a group, Exp(xi) = X_hat X^-1 with X = (C, v, p) in SE_2(3), grows as X_hat needs not
know: on a flat earth at rest xi' = A xi whatever the error and whatever the motion, so that a tangent at zero is exact. The
corrections are group exponentials. The filter is the extended Kalman filter; that its states are such xi, biases appended, is
what it asks of the pipeline (:mod:`solvers.pipeline.errors.invariant`).

Source: Barrau & Bonnabel (2017), doi:10.1109/TAC.2016.2594085; right-invariant, "imperfect" by its biases.
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: the earth turns and is round, as in docs/mathematics/error_models.md#navigation-model, so that the growth
is linear but for that; the covariance is
carried through each reset by its Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from solvers.filters.kalman.ekf import EKF
from solvers.filters.registry import register


@register("inekf")
@dataclass(frozen=True)
class InEKF(EKF):
    """The right-invariant extended Kalman filter; closed loop."""

    feedback: ClassVar[str] = "closed"  #: what the pipeline does unless told otherwise
    coordinates: ClassVar[str] = "invariant"  #: of the errors
