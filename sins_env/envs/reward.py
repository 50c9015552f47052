"""Errors and reward of an action, and the check whether it is an estimate at all.

See docs/tasks_and_scores.md#environment-contract and docs/mathematics/frames.md#errors.
"""

from __future__ import annotations

import math

import numpy as np

from sins_env import earth
from sins_env.arrays import Array, Mask
from sins_env.attitude import angle_of, error_of
from sins_env.earth import metres_to, radii_at
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    Quaternion,
    Vector,
    angles,
    dot,
    normalize,
    put_vector,
    quaternion,
    subtract,
    to_dcm,
    vector,
)
from sins_env.sensors.limits import MAX_SPEED
from sins_env.types import NavState

WORST_REWARD = -180.0
WORST_NAVIGATION_REWARD = -1000.0
WORST_PHI = np.array([np.pi / 2, np.pi, np.pi])  #: largest error that phi (E, N, U) can express, rad
#: Limits of the errors of velocity, m/s, and position, m, which is half the way round the Earth.
WORST_VEL, WORST_POS = np.full(3, 2 * MAX_SPEED), np.full(3, 2.1e7)
_DEGREES = 180.0 / math.pi
REWARD_PER_MPS, REWARD_PER_M = 1.0, 0.1
_HUGE = np.full(3, 1e9)  #: limit of an estimate; the distance to a latitude of 1e305 rad would overflow


@helper
def _fails(action: Array) -> bool:
    """Return whether an action is no estimate. Only equality is asked for, since other comparisons of NaN raise a flag."""
    for x in action:
        if x != x or x == math.inf or x == -math.inf:
            return True
    return bool(action[0] == 0.0 and action[1] == 0.0 and action[2] == 0.0 and action[3] == 0.0)


@kernel("(n)->()", "d?")
def failed_epochs(action: Array, failed: Array) -> None:
    """Return which of the actions (runs, 4 or 10) are no estimate: not finite, or with a quaternion of zero norm."""
    failed[0] = _fails(action)


@helper
def _attitude(q: Quaternion, truth: Quaternion) -> tuple[Vector, float]:
    """Return phi, rad, and the reward of an attitude."""
    size = max(max(abs(q[0]), abs(q[1])), max(abs(q[2]), abs(q[3])))
    # scaled first, because squares of huge or tiny numbers leave the range
    unit = normalize((q[0] / size, q[1] / size, q[2] / size, q[3] / size))
    error = error_of(unit, truth)
    return angles(to_dcm(error)), -_DEGREES * angle_of(error)


@helper
def _clipped(a: Vector, limit: Array) -> Vector:
    """Return a vector within limits."""
    return (
        min(max(a[0], -limit[0]), limit[0]),
        min(max(a[1], -limit[1]), limit[1]),
        min(max(a[2], -limit[2]), limit[2]),
    )


@kernel("(4),(4)->(3),(),()", "dddd?")
def score_attitude(q_nb: Array, truth: Array, phi: Array, reward: Array, failed: Array) -> None:
    """Score attitudes (runs, 4), which are normalised.

    Errors phi (runs, 3), rad, and rewards (runs,) are returned, and which epochs failed. The reward is minus the angle of the
    misalignment in degrees. A failed epoch gets the worst errors and reward.
    """
    failed[0] = _fails(q_nb)
    if failed[0]:
        put_vector(vector(WORST_PHI), phi)
        reward[0] = WORST_REWARD
        return
    found, reward[0] = _attitude(quaternion(q_nb), quaternion(truth))
    put_vector(found, phi)


def score_navigation(action: Array, truth: NavState, model: earth.Earth) -> tuple[dict[str, Array], Array, Mask]:
    """Return errors E, N, U and rewards (runs,) of actions (runs, 10), and which epochs failed.

    The errors are ``phi`` in rad, ``vel`` in m/s and ``pos`` in m, each (runs, 3). The reward is
    -(angle in deg + |dv| / (1 m/s) + |dp| / (10 m)), at worst -1000, which a failed epoch gets.
    """
    phi, vel, pos, reward, failed = _score_navigation(action, *truth, model.a, model.e2)
    return {"phi": phi, "vel": vel, "pos": pos}, reward, failed


@kernel("(10),(4),(3),(3),(),()->(3),(3),(3),(),()", "dddddddddd?")
def _score_navigation(
    action: Array,
    q_nb: Array,
    vel: Array,
    place: Array,
    a: float,
    e2: float,
    phi: Array,
    dv: Array,
    dp: Array,
    reward: Array,
    failed: Array,
) -> None:
    failed[0] = _fails(action)
    if failed[0]:
        put_vector(vector(WORST_PHI), phi)
        put_vector(vector(WORST_VEL), dv)
        put_vector(vector(WORST_POS), dp)
        reward[0] = WORST_NAVIGATION_REWARD
        return
    found, total = _attitude(quaternion(action), quaternion(q_nb))
    here, estimated_vel, estimated_place = vector(place), vector(action[4:]), vector(action[7:])
    R_M, R_N = radii_at(a, e2, here[0])
    off = _clipped(subtract(_clipped(estimated_vel, _HUGE), vector(vel)), WORST_VEL)
    away = _clipped(metres_to(here, _clipped(estimated_place, _HUGE), R_M, R_N), WORST_POS)
    total -= REWARD_PER_MPS * math.sqrt(dot(off, off))
    total -= REWARD_PER_M * math.sqrt(dot(away, away))
    put_vector(found, phi)
    put_vector(off, dv)
    put_vector(away, dp)
    reward[0] = max(total, WORST_NAVIGATION_REWARD)
