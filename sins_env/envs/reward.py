"""Errors and reward of an action, and the check whether it is an estimate at all.

See docs/tasks_and_scores.md#environment-contract and docs/mathematics/frames.md#errors.
"""

from __future__ import annotations

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.types import NavState
from sins_env.worlds.limits import MAX_SPEED

WORST_REWARD = -180.0
WORST_NAVIGATION_REWARD = -1000.0
WORST_PHI = np.array([np.pi / 2, np.pi, np.pi])  #: largest error that phi (E, N, U) can express, rad
#: Limits of the errors of velocity, m/s, and position, m, which is half the way round the Earth.
WORST_VEL, WORST_POS = np.full(3, 2 * MAX_SPEED), np.full(3, 2.1e7)
REWARD_PER_MPS, REWARD_PER_M = 1.0, 0.1
_HUGE = 1e9  #: limit of an estimate; the distance to a latitude of 1e305 rad would overflow


def failed_epochs(action: Array) -> Mask:
    """Return which of the actions (runs, 4 or 10) are no estimate: not finite, or with a quaternion of zero norm."""
    finite = np.isfinite(np.max(np.abs(action), axis=-1))
    return ~(finite & (np.max(np.abs(action[..., :4]), axis=-1) > 0))


def score_attitude(q_nb: Array, truth: Array, failed: Mask) -> tuple[Array, Array]:
    """Return errors phi (runs, 3), rad, and rewards (runs,) of attitudes (runs, 4), which are normalised.

    The reward is minus the angle of the misalignment in degrees. A failed epoch gets the worst errors and reward.
    """
    if failed.any():
        q_nb = np.where(failed[:, None], [1.0, 0.0, 0.0, 0.0], q_nb)
    size = np.max(np.abs(q_nb), axis=-1, keepdims=True)
    q = attitude.normalize(q_nb / size)  # scaled first: squares of huge or tiny numbers leave the range
    error = attitude.multiply(q, attitude.conjugate(truth))
    phi = attitude.misalignment_from_dcm(attitude.to_dcm(error))
    reward = -np.degrees(attitude.rotation_angle(error))
    if failed.any():
        phi[failed], reward[failed] = WORST_PHI, WORST_REWARD
    return phi, reward


def score_navigation(
    action: Array, truth: NavState, failed: Mask, model: earth.Earth
) -> tuple[dict[str, Array], Array]:
    """Return errors E, N, U and rewards (runs,) of actions (runs, 10).

    The errors are ``phi`` in rad, ``vel`` in m/s and ``pos`` in m, each (runs, 3). The reward is
    -(angle in deg + |dv| / (1 m/s) + |dp| / (10 m)), at worst -1000, which a failed epoch gets.
    """
    phi, reward = score_attitude(action[:, :4], truth.q_nb, failed)
    estimate = np.where(failed[:, None], 0.0, np.clip(action[:, 4:], -_HUGE, _HUGE))
    vel = np.clip(estimate[:, :3] - truth.vel, -WORST_VEL, WORST_VEL)
    pos = np.clip(earth.offset(model, truth.pos, estimate[:, 3:]), -WORST_POS, WORST_POS)
    vel[failed], pos[failed] = WORST_VEL, WORST_POS
    for error, weight in ((vel, REWARD_PER_MPS), (pos, REWARD_PER_M)):
        reward = reward - weight * np.sqrt(np.sum(error * error, axis=-1))
    return {"phi": phi, "vel": vel, "pos": pos}, np.maximum(reward, WORST_NAVIGATION_REWARD)
