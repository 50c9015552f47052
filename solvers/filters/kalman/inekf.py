"""Invariant extended Kalman filter.

Idea: the error of an INS as an element of a group, Exp(xi) = X_hat X^-1 with X = (C, v, p) in SE_2(3). On a flat earth at rest
it grows as xi' = A xi, whatever the motion and however large the error. A tangent at zero is then exact. Corrections are
group exponentials. The filter itself is the extended Kalman filter. It asks the pipeline for states xi with the biases
appended (:mod:`solvers.pipeline.errors.invariant`). In the terms of the source it is right-invariant, and "imperfect" because
of the biases.

Source: Barrau & Bonnabel (2017), doi:10.1109/TAC.2016.2594085; docs/mathematics/error_models.md#invariant-coordinates.
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: the earth turns and is round, as in docs/mathematics/error_models.md#navigation-model. The growth is linear up to
these small terms. The covariance is carried through each reset by its Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from solvers.filters.kalman.ekf import EKF
from solvers.filters.relations import Relation
from solvers.registry import register


@register("inekf")
@dataclass(frozen=True)
class InEKF(EKF):
    """The right-invariant extended Kalman filter, run closed loop."""

    feedback: ClassVar[str] = "closed"  #: feedback into the INS, unless a setting says otherwise
    coordinates: ClassVar[str] = "invariant"  #: coordinates of the errors, unless a setting says otherwise


SAME_AS = {
    "inekf": (
        Relation("ekf"),  # the coordinates are the pipeline's
    ),
}
