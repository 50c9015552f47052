"""A start of unknown attitude at the first fix, whether the base is at rest, sways or moves.

Without a coarse phase, the specific force of the epoch of the first fix gives the level, and the fix gives the velocity and the
place. The heading may be anything: a filter needs to stand that.

After a coarse phase, its epochs may be filtered again. The gyros carry the attitude that it found back to the first fix, and the
tangents are taken there. The same data must not count twice, so the prior is ten times as wide as what the coarse phase knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.prior import ANY_HEADING_STD_DEG, START_VELOCITY_STD_MPS, SWITCH_ON_STD_DEG, Prior
from sins_env.states import ERRORS
from sins_env.types import Observation, Task
from sins_env.units import DEG
from solvers.pipeline.coarse.spread import Spread, told_by
from solvers.pipeline.strapdown import carried_sample, chain, interval_increments

WIDER = 10.0  #: standard deviation of the heading at a second pass, over that of the coarse phase
UP = ERRORS["phi"].stop - 1


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


class SecondPass(NamedTuple):
    """The epochs of a coarse phase, to be filtered again."""

    past: Sequence[Observation]
    q_nb: Sequence[Array]  #: (..., 4) at the end of each epoch, as the coarse phase has found it in the end
    P0: Array  #: (..., 15, 15) in the layout ERRORS, at the first fix


def second_pass(task: Task, past: Sequence[Observation], q_nb: Array, spread: Spread | None) -> SecondPass:
    """Return how the epochs of a coarse phase that found q_nb (..., 4) at its end are filtered again."""
    told = task.prior.P0 if spread is None or task.coarse_told else told_by(spread, task.prior)
    heading = np.minimum(WIDER**2 * told[..., UP, UP], (ANY_HEADING_STD_DEG * DEG) ** 2)
    P0 = np.broadcast_to(switch_on_prior(task.prior).P0, (*q_nb.shape[:-1], ERRORS.size, ERRORS.size)).copy()
    P0[..., UP, UP] = heading
    return SecondPass(past, carried_back(task, past, q_nb), P0)


def carried_back(task: Task, past: Sequence[Observation], q_nb: Array) -> list[Array]:
    """Return the attitudes (..., 4) at the ends of epochs that lead to q_nb (..., 4) at the last."""
    back = attitude.from_rotvec(task.epoch_s * earth.rate_n(earth.get(task.site.earth), task.site.latitude))
    found = [q_nb]
    for before, obs in zip(past[-2::-1], past[:0:-1], strict=True):
        increments = interval_increments(obs["dtheta"], obs["dvel"], carried_sample(before["dtheta"], before["dvel"]))
        turned = chain(*increments)[0][..., -1, :]
        found.append(
            attitude.normalize(attitude.multiply(back, attitude.multiply(found[-1], attitude.conjugate(turned))))
        )
    return found[::-1]


def kept(obs: Observation) -> Observation:
    """Return a copy of an observation, for a later pass."""
    return cast(Observation, {name: np.array(value) for name, value in obs.items()})
