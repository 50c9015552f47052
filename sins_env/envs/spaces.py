"""Observation and action spaces. Bounds are finite and wider than anything an INS on a base or an aircraft meets."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from sins_env.worlds.limits import MAX_ANGLE, MAX_SPEED, MAX_TIME, POS_HIGH, POS_LOW


def observation_space(n_sub: int) -> spaces.Dict:
    """The Dict of design section 3: t, dtheta, dvel, gps_vel, gps_pos, gps_valid."""

    def box(limit: float, shape: tuple[int, ...]) -> spaces.Box:
        return spaces.Box(-limit, limit, shape, np.float64)

    return spaces.Dict(
        {
            "t": spaces.Box(0.0, MAX_TIME, (1,), np.float64),
            "dtheta": box(MAX_ANGLE, (n_sub, 3)),
            "dvel": box(MAX_SPEED, (n_sub, 3)),
            "gps_vel": box(MAX_SPEED, (3,)),
            "gps_pos": spaces.Box(POS_LOW, POS_HIGH, dtype=np.float64),
            "gps_valid": spaces.Box(0, 1, (1,), np.int8),
        }
    )


def attitude_action_space() -> spaces.Box:
    """q_nb; the environment normalises it."""
    return spaces.Box(-1.0, 1.0, (4,), np.float64)


def navigation_action_space() -> spaces.Box:
    """q_nb, which the environment normalises, v_n m/s, latitude rad, longitude rad, height m."""
    low = np.concatenate([np.full(4, -1.0), np.full(3, -MAX_SPEED), POS_LOW])
    high = np.concatenate([np.full(4, 1.0), np.full(3, MAX_SPEED), POS_HIGH])
    return spaces.Box(low, high, dtype=np.float64)


def action_space(navigate: bool) -> spaces.Box:
    """The estimate that a task asks for."""
    return navigation_action_space() if navigate else attitude_action_space()
