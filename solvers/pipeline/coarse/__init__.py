"""Coarse alignment: the unknown attitude of a base, from the IMU and, if there are any, the fixes.

    two_vector      the inertial frame, two of its pairs
    svd             the inertial frame, all pairs since the start: Wahba's problem by the SVD
    aided           the inertial frame, differences across windows with the velocity of the fixes, by the SVD
    oba             optimisation-based alignment: the pairs of ``aided``, by Davenport's q-method
    oba_unaided     the same with the pairs of ``svd``
    analytic1..3    mean force and mean rate of a base at rest
    motion_velocity, motion_position, motion_body    a base that travels, by its fixes or by a velocity along its body

A method is started by :func:`start`, takes epochs by ``add(obs)`` and gives ``attitude()`` at any time.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

from sins_env.arrays import Array
from sins_env.checks import choice
from sins_env.types import Observation, Task
from solvers.pipeline.coarse.aided import Windows
from solvers.pipeline.coarse.analytic import Analytic
from solvers.pipeline.coarse.fits import by_davenport, by_svd
from solvers.pipeline.coarse.inertial import AllPairs, TwoVector
from solvers.pipeline.coarse.motion import Body, Position, Velocity
from solvers.pipeline.coarse.spread import Spread


class Coarse(Protocol):
    """What a method does; batch first."""

    def add(self, obs: Observation) -> None: ...

    def attitude(self) -> Array: ...

    def spread(self) -> Spread | None: ...


METHODS: dict[str, Callable[[Task, tuple[int, ...]], Coarse]] = {
    "two_vector": TwoVector,
    "svd": partial(AllPairs, fit=by_svd),
    "aided": partial(Windows, fit=by_svd),
    "oba": partial(Windows, fit=by_davenport),
    "oba_unaided": partial(AllPairs, fit=by_davenport),
    "analytic1": partial(Analytic, form=1),
    "analytic2": partial(Analytic, form=2),
    "analytic3": partial(Analytic, form=3),
    "motion_velocity": Velocity,
    "motion_position": Position,
    "motion_body": Body,
}


def check_method(method: str) -> None:
    """Check the name of a method.

    Raises:
        ValueError: it is unknown; the message has the nearest name that exists.
    """
    choice("coarse method", method, METHODS)


def start(method: str, task: Task, batch: tuple[int, ...]) -> Coarse:
    """Start the coarse phase of ``task`` by ``method``, for runs of shape ``batch``.

    Raises:
        ValueError: an unknown method.
    """
    check_method(method)
    return METHODS[method](task, batch)
