"""Interpolation of the reference between its stamps."""

from __future__ import annotations

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.recordings.recording import Recording
from sins_env.types import NavState


def reference_at(recording: Recording, times: Array, within: float = 0.0) -> NavState:
    """Return the reference at ``times`` (...,), s; a stamp within ``within`` s of a time is taken itself.

    Attitude and velocity change uniformly from stamp to stamp. Position follows the cubic with the velocities of the
    reference at both stamps: at 1 Hz and 3 m/s^2 a straight line would be wrong by 0.4 m. Without velocities it is a
    straight line. Without positions, or without a reference, the base stands still at its site.
    """
    ref, site = recording.reference, recording.site.pos
    still, place = np.zeros((*times.shape, 3)), np.broadcast_to(site, (*times.shape, 3))
    if ref is None:
        return NavState(np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*times.shape, 4)), still, place)
    i = np.clip(np.searchsorted(ref.t_s, times), 1, len(ref.t_s) - 1)
    before, after = ref.t_s[i - 1], ref.t_s[i]
    w = np.clip((times - before) / (after - before), 0.0, 1.0)
    w = np.where(np.abs(times - before) <= within, 0.0, np.where(np.abs(times - after) <= within, 1.0, w))
    v = w[..., None]
    vel = still if ref.vel is None else (1.0 - v) * ref.vel[i - 1] + v * ref.vel[i]
    q_nb = attitude.slerp(ref.q_nb[i - 1], ref.q_nb[i], w)
    if ref.pos is None:
        return NavState(q_nb, vel, place)
    model = earth.get(recording.site.earth)
    step = earth.offset(model, ref.pos[i - 1], ref.pos[i])
    moved = v * step
    if ref.vel is not None:  # Hermite's cubic less its line
        first, last = (ref.vel[j] * (after - before)[..., None] - step for j in (i - 1, i))
        moved = moved + v * (1.0 - v) * ((1.0 - v) * first - v * last)
    return NavState(q_nb, vel, earth.displace(model, ref.pos[i - 1], moved))
