"""The information of a Doppler log. See docs/mathematics/aiding.md#doppler-log."""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.bound.aids import Instant, Own, Term, through_body
from sins_env.evaluation.bound.fisher import LEAST_STD
from sins_env.states import Block
from sins_env.units import PPM


class DvlTerm(Term):
    """Three axes of velocity, with scale error, mounting and current; the current itself counts as zero."""

    name = "dvl"

    @property
    def holds(self) -> bool:  # type: ignore[override]
        return not self.spec.faulty  # readings without lock on the bottom count as readings

    def states(self) -> list[Own]:
        spec = self.spec
        own = [
            Own(Block("dvl.scale", 1, "1"), spec.scale_ppm * PPM),
            Own(Block("dvl.mounting", 3, "rad"), 1e-3 * spec.mounting_mrad),
        ]
        if spec.track == "water":
            own.append(Own(Block("dvl.current", 2, "m/s"), spec.current_mps, spec.current_s))
        return own

    def rows(self, at: Instant) -> dict[str, Array]:
        y, rows = through_body(at, np.asarray(self.spec.lever_arm_m))
        rows |= {"dvl.scale": -y[..., None], "dvl.mounting": -attitude.skew(y)}
        if self.spec.track == "water":
            rows["dvl.current"] = at.C.mT[..., :2]
        return rows

    def noise(self) -> Array:
        return np.full(3, max(self.spec.noise_mps, LEAST_STD) ** 2)
