"""North-East-Down and Forward-Right-Down instead of East-North-Up and Right-Forward-Up. docs/learning.md#frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from sins_env.arrays import Array, Obs
from sins_env.checks import unknown
from sins_env.recordings.axes import swap_ned, swap_ned_attitude
from sins_env.wrappers.translated import E, Info, Translation, translated

#: Fields of observations that are vectors in navigation or body axes. Both frames swap them in the same way.
VECTORS = frozenset({"dtheta", "dvel", "gps_vel", "dvl", "magnetometer", "heading"})
#: Fields with one standard deviation for each axis, which has no sign.
SPREADS = frozenset({"gps_vel_std", "gps_pos_std"})
#: Fields with the covariance of two such vectors, (6, 6).
COVARIANCES = frozenset({"bridge_cov"})
#: Fields that are the same in both frames: times, latitude, longitude and height, lengths, and numbers for each satellite.
SAME = frozenset({"t", "gps_pos", "gps_age", "odometer", "height", "depth", "ranges", "range_rates", "satellites"})
MARK = "_valid"  #: ending of the fields that say whether there is a reading
AXES = [1, 0, 2]


class NorthEastDown(Translation):
    """Vectors, attitudes and standard deviations in the axes of aviation; latitude, longitude and height stay."""

    rank = 1

    def spaces(self, observed: spaces.Dict, action: spaces.Box) -> tuple[spaces.Dict, spaces.Box]:
        """Return the same spaces with their axes swapped.

        Raises:
            ValueError: a field whose axes are not known here.
        """
        known = VECTORS | SPREADS | COVARIANCES | SAME
        for name in observed:
            if name not in known and not name.endswith(MARK):
                raise unknown("observation, whose axes north_east_down does not know:", name, known)
        boxes: dict[str, Any] = {}
        for name, space in observed.items():
            box: Any = space
            ends = self._field(name, box.low), self._field(name, box.high)
            boxes[name] = spaces.Box(np.minimum(*ends), np.maximum(*ends), dtype=box.dtype.type)
        given: Any = action
        ends = self.answer(given.low), self.answer(given.high)
        return spaces.Dict(boxes), spaces.Box(np.minimum(*ends), np.maximum(*ends), dtype=given.dtype.type)

    def _field(self, name: str, value: Array) -> Array:
        if name in VECTORS:
            return np.asarray(swap_ned(value))
        if name in COVARIANCES:
            return _swapped(_swapped(value).mT)
        return value[..., AXES] if name in SPREADS else value

    def observed(self, obs: Obs) -> Obs:
        """Return an observation in the other axes."""
        return {name: self._field(name, value) for name, value in obs.items()}

    def told(self, info: Info) -> Info:
        """Return an info whose states ``start`` and ``truth``, and errors, are in the other axes."""
        found = dict(info)
        for name in found.keys() & {"start", "truth"}:
            state = found[name]
            found[name] = {**state, "q_nb": swap_ned_attitude(state["q_nb"]), "vel": swap_ned(state["vel"])}
        if "errors" in found:
            errors = found["errors"]
            found["errors"] = errors | {k: swap_ned(v) for k, v in errors.items() if not k.startswith("_")}
        return found

    def answer(self, action: Array) -> Array:
        """Return an action from the other axes: a state (..., 4 or 10), or a correction of vectors (..., 3 or 9)."""
        if action.shape[-1] % 3 == 0:
            return np.asarray(_swapped(action), action.dtype)
        parts = [swap_ned_attitude(action[..., :4])]
        if action.shape[-1] > 4:
            parts += [swap_ned(action[..., 4:7]), action[..., 7:]]
        return np.concatenate(parts, axis=-1)


def _swapped(rows: Array) -> Array:
    """Return rows (..., 3 n) of n vectors in the other axes."""
    return np.asarray(swap_ned(rows.reshape(*rows.shape[:-1], -1, 3))).reshape(rows.shape)


def north_east_down(env: E) -> E:
    """Return an environment that speaks North-East-Down, with a Forward-Right-Down body, in observation, action and info.

    The action q is that of the body in NED, scalar first, and in navigation its velocity is North, East, Down. Latitude,
    longitude and height stay as they are, and so does ``env.unwrapped.task``. Two swaps give back every bit.

    Raises:
        ValueError: another environment, wrappers in another order, or a sensor whose axes are not known here.
    """
    return translated(env, NorthEastDown())
