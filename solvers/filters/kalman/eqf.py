"""Equivariant filter.

Idea: a symmetry of the INS that takes in the biases. The group SE_2(3) of attitude, velocity and position acts on them too, so
that the errors of the biases are those in navigation axes, and turn with each correction. The errors of the navigation states
then grow linearly, whatever their size; an invariant filter neglects products of attitude error and bias. The filter itself is
the extended Kalman filter. It asks the pipeline for these states (:mod:`solvers.pipeline.errors.equivariant`).

Source: Fornasier, Ge, van Goor, Mahony & Weiss (2023), arXiv:2309.03765 (semi-direct symmetry); van Goor, Hamel & Mahony (2023),
doi:10.1109/TAC.2022.3194094 (the filter); docs/mathematics/error_models.md#equivariant-coordinates.
Shapes: x (..., n), P (..., n, n), z (..., m); ``...`` any batch.
Departures: the earth turns and is round, as in docs/mathematics/error_models.md#navigation-model. The output is linearised to
first order; the source's third-order form needs fixes in body axes. The covariance is carried through each reset by its Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from solvers.filters.kalman.ekf import EKF
from solvers.filters.relations import Relation
from solvers.registry import register


@register("eqf")
@dataclass(frozen=True)
class EqF(EKF):
    """The equivariant filter, run closed loop."""

    feedback: ClassVar[str] = "closed"  #: feedback into the INS, unless a setting says otherwise
    coordinates: ClassVar[str] = "equivariant"  #: coordinates of the errors, unless a setting says otherwise


SAME_AS = {
    "eqf": (
        Relation("ekf"),  # the coordinates are the pipeline's
    ),
}
