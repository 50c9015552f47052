"""The INS taken back from the end of an epoch, for fixes that were made before it.

The increments of the samples since then are undone one by one, and the sample in which the time lies is cut there. Within a
sample the rate and the specific force are constant. An INS in closed loop is taken back along itself as it is corrected now, not
along what it was then. The errors at that time follow from those at the end of the epoch, d seconds later,

    dv_f = dv - [I - C(phi)'] F - d C_hat nabla,   dp_f = dp - d dv + [I - C(phi)'] G + d^2/2 C_hat nabla

with F the integral of the specific force since then, in n, and G that of its product with the time since the fix. The noise of
the last d seconds is left out. See docs/mathematics/aiding.md#fixes-between-the-ends-of-epochs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sins_env import earth
from sins_env.arrays import Array
from sins_env.kernels import kernel
from sins_env.kernels.algebra import (
    add,
    cross3,
    from_rotvec,
    matrix,
    mix,
    multiply,
    normalize,
    put_matrix,
    put_quaternion,
    put_vector,
    quaternion,
    row,
    scale,
    subtract,
    to_dcm,
    transpose,
    turn,
    vector,
)
from sins_env.types import NavState, Observation, Task


class Earlier(NamedTuple):
    """The INS at a time before the end of an epoch, and what lies between."""

    nav: NavState  #: at that time
    rate: Array  #: (..., 3) omega_eb^b at that time, rad/s
    gained: Array  #: (..., 3) F, integral of the specific force since then, in n, m/s
    moment: Array  #: (..., 3) G, integral of the specific force times the time since the fix, in n, m
    C: Array  #: (..., 3, 3) mean attitude since then


@kernel("(4),(3),(s,3),(s,3),(),(),(3),(3,3),(3)->(4),(3),(3),(3),(3),(3),(3,3)")
def _rewound(
    q_nb: Array, vel: Array, dtheta: Array, dvel: Array, h: float, age: float, rate_ie: Array, transport: Array,
    gravity: Array,
    q: Array, speed: Array, back: Array, rate: Array, gained: Array, moment: Array, mean_C: Array,
) -> None:  # fmt: skip
    if age != age or h != h:
        age, h = 0.0, 1.0
    samples, at, v = len(dtheta), quaternion(q_nb), vector(vel)
    w_ie, T, g = vector(rate_ie), matrix(transport), vector(gravity)
    F, G, place = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    mean = to_dcm(at)
    if age > 0.0:
        mean = mix(0.0, mean, 0.0, mean)
    for j in range(samples):
        left = age - j * h  # of the time to go back
        if left > 0.0:
            part = h if left > h and j < samples - 1 else left
            share, i = part / h, samples - 1 - j
            w_en = turn(T, v)
            w_in = add(w_ie, w_en)
            middle = to_dcm(multiply(at, from_rotvec(scale(-0.5 * share, row(dtheta, i)))))
            force = turn(middle, scale(share, row(dvel, i)))
            fall = scale(part, subtract(g, cross3(add(w_ie, w_in), v)))
            before = subtract(v, add(force, fall))
            place = subtract(place, scale(0.5 * part, add(v, before)))
            F, G = add(F, force), add(G, scale(left - 0.5 * part, force))
            mean = mix(1.0, mean, part / age, middle)
            at = multiply(at, from_rotvec(scale(-share, row(dtheta, i))))
            at, v = multiply(from_rotvec(scale(part, w_in)), at), before
    # the rate is linear between the middles of samples
    since = age / h - 0.5  # in samples, from the middle of the last
    if samples > 1:
        j = int(min(max(math.floor(since), 0.0), samples - 2.0))
        share = since - j
        w = add(scale(1.0 - share, row(dtheta, samples - 1 - j)), scale(share, row(dtheta, samples - 2 - j)))
    else:
        w = row(dtheta, 0)
    at = normalize(at)
    put_vector(subtract(scale(1.0 / h, w), turn(transpose(to_dcm(at)), w_ie)), rate)
    put_quaternion(at, q)
    put_vector(v, speed)
    put_vector(place, back)
    put_vector(F, gained)
    put_vector(G, moment)
    put_matrix(mean, mean_C)


def rewound(model: earth.Earth, nav: NavState, dtheta: Array, dvel: Array, sample_s: float, age: Array) -> Earlier:
    """Return the INS ``age`` (...) seconds before it was at ``nav``.

    ``dtheta`` in rad and ``dvel`` in m/s are the increments (..., s, 3) of the last samples, without biases. What is
    older than they are has the increments of the first.
    """
    latitude, height = nav.pos[..., 0], nav.pos[..., 2]
    gravity = np.zeros(nav.pos.shape)
    gravity[..., 2] = -earth.gravity(model, latitude, height)
    rate_ie, transport = earth.rate_n(model, latitude), earth.transport_matrix(model, latitude, height)
    q, vel, back, rate, gained, moment, C = _rewound(
        nav.q_nb, nav.vel, dtheta, dvel, sample_s, age, rate_ie, transport, gravity
    )
    pos = earth.displace(model, nav.pos, back, at=earth.displace(model, nav.pos, 0.5 * back))
    return Earlier(NavState(q, vel, pos), rate, gained, moment, C)


class Samples:
    """The increments of the last epochs, as far back as the fixes of a task may reach."""

    def __init__(self, task: Task) -> None:
        self._epochs = max(math.ceil(task.gps.oldest_s / task.epoch_s - 1e-9), 2)
        self._kept: list[tuple[Array, Array]] = []

    def add(self, obs: Observation) -> None:
        """Take the increments of one more epoch; nothing is kept while fixes are made at the ends of epochs."""
        if "gps_age" in obs:
            self._kept = [*self._kept[1 - self._epochs :], (np.array(obs["dtheta"]), np.array(obs["dvel"]))]

    def clear(self) -> None:
        """Begin again."""
        self._kept = []

    @property
    def last(self) -> tuple[Array, Array] | None:
        """Increments of angle and velocity, (..., samples, 3) each; None if nothing is kept."""
        if not self._kept:
            return None
        dtheta, dvel = (np.concatenate(parts, axis=-2) for parts in zip(*self._kept, strict=True))
        return dtheta, dvel
