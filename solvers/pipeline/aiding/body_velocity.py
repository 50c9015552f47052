"""The velocity of a point of the vehicle along the axes of a sensor that sits crooked, for odometers and Doppler logs.

y = (1 + k) (I - [alpha x]) u,   u = C' (v - c) + omega_eb x l
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from solvers.pipeline.aiding.aid import State
from solvers.pipeline.strapdown import cross


class Seen(NamedTuple):
    """A velocity along the sensor's axes, (..., 3) m/s, without its scale error."""

    through: Array  #: C' (v - c)
    u: Array  #: with the lever arm, along the body axes
    along: Array  #: turned by the mounting
    mounting: Array  #: I - [alpha x], (..., 3, 3)


def seen(s: State, lever: Array, alpha: Array, current: Array | float = 0.0) -> Seen:
    """Return the velocity at a state."""
    through = (s.C.mT @ (s.vel - current)[..., None])[..., 0]
    u = through + cross(s.rate, np.broadcast_to(lever, s.rate.shape))
    return Seen(through, u, u - cross(alpha, u), np.eye(3) - attitude.skew(alpha))


def slopes(s: State, y: Seen, lever: Array) -> dict[str, Array]:
    """Return the derivatives of ``along`` (..., 3, 3): of the INS's state, and of the mounting under "mounting"."""
    B = y.mounting @ s.C.mT
    return {
        # a turn e of the axes changes C' w by C' (w x e)
        "turn": y.mounting @ attitude.skew(y.through) @ s.C.mT,
        "vel": B,
        "rate": -y.mounting @ attitude.skew(np.broadcast_to(lever, s.rate.shape)),
        "mounting": attitude.skew(y.u),
    }
