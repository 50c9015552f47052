"""The information of an odometer with the constraint of its car. See docs/mathematics/aiding.md#odometer.

A reading is the mean speed of an epoch; here it is that at its end. The car of a simulation keeps exactly to its constraint, and
pulses have errors of opposite signs in neighbouring epochs. The bound takes both as the assumed white noise, and then is only a
reference.
"""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.bound.aids import Instant, Own, Term, through_body
from sins_env.evaluation.bound.fisher import LEAST_STD
from sins_env.states import Block
from sins_env.units import PPM

AXES = {False: [1], True: [1, 0, 2]}  #: axes Right, Forward, Up of the rows, without and with the constraint


class OdometerTerm(Term):
    """The speed with its scale error and mounting, and the velocity across."""

    name = "odometer"

    @property
    def holds(self) -> bool:  # type: ignore[override]
        return not (self.spec.nhc or self.spec.pulse_m or self.spec.faulty)

    def states(self) -> list[Own]:
        return [
            Own(Block("odometer.scale", 1, "1"), self.spec.scale_ppm * PPM),
            Own(Block("odometer.mounting", 2, "rad"), 1e-3 * self.spec.mounting_mrad),
        ]

    def rows(self, at: Instant) -> dict[str, Array]:
        y, rows = through_body(at, np.asarray(self.spec.lever_arm_m))
        axes = AXES[self.spec.nhc]
        rows = {name: slope[..., axes, :] for name, slope in rows.items()}
        scale = np.zeros((*y.shape[:-1], len(axes), 1))
        scale[..., 0, 0] = -y[..., 1]
        return rows | {"odometer.scale": scale, "odometer.mounting": -attitude.skew(y)[..., axes, :][..., [0, 2]]}

    def noise(self) -> Array:
        spec = self.spec
        pulses = (spec.pulse_m / self.epoch_s) ** 2 / 6.0
        speed = max(spec.noise_mps**2 + pulses, LEAST_STD**2)
        return np.array([speed, *[spec.lateral_mps**2, spec.vertical_mps**2] * spec.nhc])
