"""The information of ranges to satellites. See docs/mathematics/aiding.md#ranges."""

from __future__ import annotations

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.evaluation.bound.aids import Instant, Own, Term
from sins_env.states import Block
from sins_env.trajectory import constellation


class RangesTerm(Term):
    """Ranges and range rates, with the clock of the receiver.

    Rows are weighted by the elevation, and those of satellites that are not seen are zero. The satellites are those above the
    first place that is asked for.
    """

    name = "ranges"

    def __init__(self, spec: object, epoch_s: float) -> None:
        super().__init__(spec, epoch_s)
        self._number: Array | None = None

    def states(self) -> list[Own]:
        spec = self.spec
        run, densities = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array(spec.densities)
        own = [Own(Block("ranges.clock", 2, "m, m/s"), (spec.clock_m, spec.clock_mps), dynamics=(run, densities))]
        if spec.multipath_m:
            own.append(Own(Block("ranges.multipath", spec.satellites, "m"), spec.multipath_m, spec.multipath_s))
        return own

    def rows(self, at: Instant) -> dict[str, Array]:
        model = earth.get("wgs84")  # directions to satellites hardly depend on the ellipsoid
        spec, lever = self.spec, np.asarray(self.spec.lever_arm_m)
        assert at.pos is not None
        assert at.t is not None
        if self._number is None or at.t.flat[0] <= self.epoch_s:
            self._number = spec.followed(model, at.pos[:, 0])
        orbits = constellation.satellites(model, spec.at_s + at.t)
        followed = np.moveaxis(orbits[:, self._number], 0, 1)
        to_n = earth.ecef_to_enu(at.pos[..., 0], at.pos[..., 1])[..., None, :, :]
        arm = (at.C @ lever[:, None])[..., 0]
        place = followed[..., :3] - earth.to_ecef(model, at.pos)[..., None, :]
        away = (to_n @ place[..., None])[..., 0] - arm[..., None, :]
        distance = np.linalg.norm(away, axis=-1, keepdims=True)
        e = away / distance
        spin = (at.C @ np.cross(at.rate, lever)[..., None])[..., 0]
        speed = (to_n @ followed[..., 3:, None])[..., 0] - (at.vel + spin)[..., None, :]
        across = (speed - e * np.sum(e * speed, axis=-1, keepdims=True)) / distance
        there = spec.visible(np.broadcast_to(at.t, at.pos.shape[:-1]), e[..., 2])
        weight = np.where(there, 1.0 / spec.seen(e[..., 2]), 0.0)
        weight = np.concatenate([weight, weight], axis=-1)[..., None]
        skew, none, S = attitude.skew, np.zeros_like(e), spec.satellites

        def both(ranges: Array, rates: Array) -> Array:
            return weight * np.concatenate([ranges, rates], axis=-2)

        clock = [np.broadcast_to(row, (*e.shape[:-1], 2)) for row in ((-1.0, 0.0), (0.0, -1.0))]
        own = {"ranges.clock": both(*clock)}
        if spec.multipath_m:
            one = np.broadcast_to(np.eye(S), (*e.shape[:-1], S))
            own["ranges.multipath"] = both(-one, 0 * one)
        return own | {
            "phi": both(-e @ skew(arm), -e @ skew(spin) - across @ skew(arm)),
            "dv": both(none, -e),
            "dp": both(-e, -across),
            "rate": both(none, e @ at.C @ skew(lever)),
        }

    def noise(self) -> Array:
        return np.square(np.repeat([self.spec.range_m, self.spec.rate_mps], self.spec.satellites))
