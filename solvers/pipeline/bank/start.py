"""The start of a bank: a told attitude cut into slices of headings, or, at switch-on, all headings at the first fix.

At switch-on the specific force of the epoch of the first fix gives the level, and the fix gives the velocity and the place. No
coarse phase is needed, whether the base is at rest, sways or drives.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.prior import Prior
from sins_env.types import NavState, Observation
from solvers.filters.mixtures.angles import slices
from solvers.pipeline import feedback

LEVEL_STD_DEG = 3.0  #: standard deviation of a level from the specific force of one epoch, at rest or in motion
LEAST_VELOCITY_STD = 0.2  #: m/s, least standard deviation of the velocity from a fix
MOST_SLICES = 36


def told(nav: NavState, prior: Prior, spacing: float) -> tuple[NavState, Array, Array]:
    """Cut a told start into slices of at most ``spacing`` rad.

    Return the states (runs, G, ...), the weights (G,) and the variance of the heading in a slice, rad^2.
    """
    offsets, weights, variance = slices(np.array(prior.P0[2, 2]), spacing, MOST_SLICES)
    return turned(nav, offsets), weights, variance


def anywhere(nav: NavState, spacing: float) -> tuple[NavState, Array, Array]:
    """Cut the circle into slices of at most ``spacing`` rad; returns what :func:`told` does."""
    count = math.ceil(2.0 * math.pi / spacing)
    half = math.pi / count
    offsets = half * np.arange(1 - count, count, 2, dtype=np.float64)
    return turned(nav, offsets), np.full(count, 1.0 / count), np.array(half**2 if count > 1 else math.pi**2 / 3.0)


def turned(nav: NavState, offsets: Array) -> NavState:
    """Return the states (runs, G, ...) of which the headings differ from that of ``nav`` by ``offsets`` (G,), rad."""
    phi = np.zeros((len(offsets), 3))
    phi[:, 2] = offsets
    q_nb = feedback.corrected(nav.q_nb[:, None], phi)
    return NavState(q_nb, *(np.repeat(part[:, None], len(offsets), axis=1) for part in nav[1:]))


def level(obs: Observation) -> Array:
    """Return q_nb (..., 4) with heading zero and the level of the specific force in an epoch."""
    force = obs["dvel"].sum(axis=-2)
    force = force / np.sqrt((force * force).sum(axis=-1, keepdims=True))
    pitch, roll = np.arcsin(np.clip(force[..., 1], -1.0, 1.0)), np.arctan2(-force[..., 0], force[..., 2])
    return attitude.from_euler(np.zeros(pitch.shape), pitch, roll)


def switch_on_prior(prior: Prior) -> Prior:
    """Return the prior of a start at the first fix, in which the biases alone are as told."""
    vel, pos = max(prior.gps_vel_std_mps), max(prior.gps_pos_std_m)
    return replace(
        prior,
        attitude_std_deg=(LEVEL_STD_DEG, LEVEL_STD_DEG, 180.0 / math.sqrt(3.0)),
        velocity_std_mps=max(LEAST_VELOCITY_STD, vel),
        position_std_m=pos,
    )
