"""Coarse alignment: the unknown attitude of a base, from the IMU and, if there are any, the fixes.

    two_vector      the inertial frame, two of its pairs
    svd             the inertial frame, all pairs since the start: Wahba's problem by the SVD
    aided           the inertial frame, differences across windows with the velocity of the fixes, by the SVD
    oba             optimisation-based alignment: the pairs of ``aided``, by Davenport's q-method
    oba_unaided     the same with the pairs of ``svd``
    analytic1..3    mean force and mean rate of a base at rest
    motion_velocity, motion_position, motion_body    a base that travels, by its fixes or by a velocity along its body

A method is started by :func:`start`, takes epochs by ``add(obs)`` and gives ``attitude()`` at any time. Read ``inertial``,
``aided``, ``motion``, then ``spread``. Without a name, ``choice`` judges the motion of the base from the data.
"""

from __future__ import annotations

from sins_env.checks import choice as checked
from sins_env.types import Task
from solvers.pipeline.coarse.choice import FromData
from solvers.pipeline.coarse.methods import METHODS, Coarse

__all__ = ["METHODS", "Coarse", "FromData", "check_method", "start"]


def check_method(method: str) -> None:
    """Check the name of a method.

    Raises:
        ValueError: it is unknown; the message has the nearest name that exists.
    """
    checked("coarse method", method, METHODS)


def start(method: str, task: Task, batch: tuple[int, ...]) -> Coarse:
    """Start the coarse phase of ``task`` by ``method``, for runs of shape ``batch``.

    Raises:
        ValueError: an unknown method, or one that the task has no sensor for.
    """
    check_method(method)
    return METHODS[method](task, batch)
