"""The methods of coarse alignment by name, and what they have in common."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

from sins_env.arrays import Array, Mask
from sins_env.types import NavState, Observation, Task
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

    def state(self, nav: NavState) -> NavState: ...

    @property
    def travels(self) -> Mask: ...

    @property
    def due(self) -> Mask: ...


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
