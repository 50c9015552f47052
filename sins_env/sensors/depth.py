"""Pressure sensor under water: the depth below the ellipsoid, with a wandering offset. It is a height of the other sign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from sins_env.sensors.height import Height, HeightSpec
from sins_env.sensors.limits import MAX_HEIGHT


@dataclass(frozen=True)
class DepthSpec(HeightSpec):
    """Errors of a depth sensor; the offset wanders as a first-order Gauss-Markov process."""

    name = "depth"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}

    noise_m: float = 0.02  #: white noise of a reading
    bias_m: float = 0.1  #: stationary sigma of the offset
    bias_s: float = 3600.0  #: its correlation time


class Depth(Height):
    """A batch of depth sensors."""

    name = "depth"
    specification = DepthSpec
    size, limit, what = 1, 2 * MAX_HEIGHT, "m, depth below the ellipsoid"
    sign = -1.0
