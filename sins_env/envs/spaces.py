"""Observation and action spaces. Their bounds are finite, and wider than anything that an INS meets.

See docs/tasks_and_scores.md#environment-contract.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from gymnasium import spaces

from sins_env.sensors.gps import FIELDS
from sins_env.sensors.limits import MAX_ANGLE, MAX_SPEED, MAX_TIME, POS_HIGH, POS_LOW, Field


def observation_space(n_sub: int, fields: Mapping[str, Field] = FIELDS) -> spaces.Dict:
    """Return the space of an observation: t, dtheta and dvel, with ``n_sub`` IMU samples, and the ``fields`` of the sensors."""

    def box(limit: float, shape: tuple[int, ...]) -> spaces.Box:
        return spaces.Box(-limit, limit, shape, np.float64)

    return spaces.Dict(
        {
            "t": spaces.Box(0.0, MAX_TIME, (1,), np.float64),
            "dtheta": box(MAX_ANGLE, (n_sub, 3)),
            "dvel": box(MAX_SPEED, (n_sub, 3)),
            **{name: spaces.Box(one.low, one.high, dtype=one.low.dtype.type) for name, one in fields.items()},
        }
    )


def attitude_action_space() -> spaces.Box:
    """Return the space of q_nb, (4,); the environment normalises it."""
    return spaces.Box(-1.0, 1.0, (4,), np.float64)


def navigation_action_space() -> spaces.Box:
    """Return the space of q_nb, v_n in m/s, latitude rad, longitude rad and height m, (10,)."""
    low = np.concatenate([np.full(4, -1.0), np.full(3, -MAX_SPEED), POS_LOW])
    high = np.concatenate([np.full(4, 1.0), np.full(3, MAX_SPEED), POS_HIGH])
    return spaces.Box(low, high, dtype=np.float64)


def action_space(navigate: bool) -> spaces.Box:
    """Return the space of the estimate that a task asks for."""
    return navigation_action_space() if navigate else attitude_action_space()
