"""An odometer with the non-holonomic constraint of its car: speed forwards, and no velocity across.

The rows are forward, right and up; without the constraint only the first. The counted distance is a mean speed. INS minus
reading therefore takes the mean of the INS at both ends of the epoch. See docs/mathematics/aiding.md#odometer.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array, Mask
from sins_env.types import Observation
from solvers.pipeline.aiding import body_velocity
from solvers.pipeline.aiding.aid import Ins, Sensor, State
from solvers.pipeline.errors.model import Parameter

ORDER = [1, 0, 2]  #: rows of a reading among right, forward, up


class Odometer(Sensor):
    """An odometer as an aid."""

    name = "odometer"

    @classmethod
    def states_of(cls, spec: Any) -> tuple[Parameter, ...]:
        return (
            Parameter("odometer.scale", 1, "1e-3", 1e-3, std=1e-6 * spec.scale_ppm, fed=True),
            Parameter("odometer.mounting", 2, "mrad", 1e-3, std=1e-3 * spec.mounting_mrad, fed=True),
        )

    def prepare(self) -> None:
        self._lever, self.rows = np.asarray(self.spec.lever_arm_m), 3 if self.spec.nhc else 1

    def told(self, obs: Observation, ins: Ins) -> tuple[Array, Mask]:
        distance, present = super().told(obs, ins)
        # to the end of the epoch, by half the change of the INS's own velocity
        ends = [(attitude.to_dcm(nav.q_nb).mT @ nav.vel[..., None])[..., 0] for nav in (ins.before, ins.nav)]
        speed = distance / ins.epoch_s + 0.5 * (ends[1] - ends[0])[..., 1:2]
        if self.rows == 1:
            return speed, present
        across = np.zeros((*speed.shape[:-1], 2))
        return np.concatenate([speed, across], axis=-1), np.concatenate([present, across == 0.0], axis=-1)

    def rate(self, ins: Ins) -> Array:
        return ins.mean_rate

    def _seen(self, s: State) -> body_velocity.Seen:
        angles = s.own["odometer.mounting"]
        alpha = np.stack([angles[..., 0], np.zeros(angles.shape[:-1]), angles[..., 1]], axis=-1)
        return body_velocity.seen(s, self._lever, alpha)

    def _scale(self, s: State) -> Array:
        """Return what the rows are multiplied by, (..., rows)."""
        scale = np.ones((*s.vel.shape[:-1], self.rows))
        scale[..., :1] += s.own["odometer.scale"]
        return scale

    def value(self, s: State) -> Array:
        return self._scale(s) * self._seen(s).along[..., ORDER[: self.rows]]

    def slopes(self, s: State) -> dict[str, Array]:
        y, scale = self._seen(s), self._scale(s)[..., None]
        rows = ORDER[: self.rows]
        found = {name: scale * slope[..., rows, :] for name, slope in body_velocity.slopes(s, y, self._lever).items()}
        found["odometer.mounting"] = found.pop("mounting")[..., [0, 2]]
        found["odometer.scale"] = np.zeros_like(scale)
        found["odometer.scale"][..., 0, 0] = y.along[..., 1]
        return found

    def noise(self) -> Array:
        spec, pulse = self.spec, self.spec.pulse_m / self.task.epoch_s
        speed = max(spec.noise_mps**2 + pulse**2 / 6.0, 1e-10)  # of two roundings to a pulse, each pulse^2 / 12
        return np.array([speed, spec.lateral_mps**2, spec.vertical_mps**2][: self.rows])
