"""A start of unknown attitude without a coarse phase: at the first fix, whether the base is at rest, sways or moves.

The specific force of the epoch of the first fix gives the level, and the fix gives the velocity and the place. The heading may be
anything: a filter needs to stand that.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.prior import START_VELOCITY_STD_MPS, SWITCH_ON_STD_DEG, Prior
from sins_env.types import Observation


def level(obs: Observation) -> Array:
    """Return q_nb (..., 4) with heading zero and the level of the specific force in an epoch; level if there is no force."""
    force = obs["dvel"].sum(axis=-2)
    force = force / np.maximum(np.sqrt((force * force).sum(axis=-1, keepdims=True)), attitude.TINY)
    pitch, roll = np.arcsin(np.clip(force[..., 1], -1.0, 1.0)), np.arctan2(-force[..., 0], force[..., 2])
    return attitude.from_euler(np.zeros(pitch.shape), pitch, roll)


def switch_on_prior(prior: Prior) -> Prior:
    """Return the prior of a start at the first fix, in which the biases alone are as told."""
    vel, pos = max(prior.gps_vel_std_mps), max(prior.gps_pos_std_m)
    return replace(
        prior,
        attitude_std_deg=SWITCH_ON_STD_DEG,
        velocity_std_mps=max(START_VELOCITY_STD_MPS, vel),
        position_std_m=pos,
    )
