"""The standard deviations that a receiver states of its own fixes, as the assumed noise of each fix."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sins_env import checks
from sins_env.arrays import Array
from sins_env.recordings import Gnss, stated
from sins_env.specs import GpsSpec

MOST_FACTOR, MOST_FLOOR = 1e3, 1e3


@dataclass(frozen=True)
class ReceiverStd:
    """How standard deviations of a file are used: times ``factor``, and not below the floors.

    Raises:
        ValueError: a value out of its range.
    """

    factor: float = 1.0  #: many receivers are too sure of themselves
    vel_floor_mps: float = 0.01
    pos_floor_m: float = 0.01

    def __post_init__(self) -> None:
        checks.keep(self, "factor", checks.number, above=0.0, most=MOST_FACTOR)
        for name in ("vel_floor_mps", "pos_floor_m"):
            checks.keep(self, name, checks.number, least=1e-4, most=MOST_FLOOR)

    @classmethod
    def made(cls, given: Any) -> ReceiverStd:
        """Return the settings of a dict; None has the defaults.

        Raises:
            ValueError: no dict, or what is refused.
        """
        if isinstance(given, cls):
            return given
        if given is not None and not isinstance(given, Mapping):
            raise checks.refused("fix_std", given, "a dict of factor, vel_floor_mps and pos_floor_m, or None")
        return checks.build(cls, given or {}, "fix_std")

    def of(self, gnss: Gnss, told: Collection[str], spec: GpsSpec) -> FixStd | None:
        """Return the standard deviations of each fix; None if the file says nothing of them.

        Fields of ``spec`` that are ``told`` stand for the file's, and ``spec`` stands for fixes without one.
        """
        vel = None if "vel_std_mps" in told else self._used(gnss.vel_std, self.vel_floor_mps, spec.vel_std)
        pos = None if "pos_std_m" in told else self._used(gnss.pos_std, self.pos_floor_m, spec.pos_std)
        if vel is None and pos is None:
            return None
        shape = gnss.pos.shape
        return FixStd(
            np.broadcast_to(spec.vel_std, shape) if vel is None else vel,
            np.broadcast_to(spec.pos_std, shape) if pos is None else pos,
        )

    def _used(self, std: Array | None, floor: float, instead: Array) -> Array | None:
        if std is None or not stated(std).any():
            return None
        used = np.maximum(self.factor * std, floor)
        return np.where(stated(std)[:, None], used, np.maximum(instead, floor))


@dataclass(frozen=True)
class FixStd:
    """Standard deviations of fixes."""

    vel: Array  #: (M, 3) E, N, U, m/s
    pos: Array  #: (M, 3) E, N, U, m

    def typical(self, spec: GpsSpec) -> GpsSpec:
        """Return a specification with their medians, for what needs one number."""
        vel, pos = (tuple(np.median(part, axis=0).tolist()) for part in (self.vel, self.pos))
        return replace(spec, vel_std_mps=vel, pos_std_m=pos)
