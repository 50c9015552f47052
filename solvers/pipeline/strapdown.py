"""Strapdown mechanisation: the IMU increments of one navigation epoch move attitude, velocity and position.

An epoch holds several update intervals of three, two or one IMU samples. Coning and sculling of all intervals are computed at
once; only the product of the interval rotations is a loop over time. Within an interval the rotation of a constant rate is
exact, and coning and sculling with optimal coefficients account for the rest. The navigation frame turns at omega_in of
mid-epoch, and the velocity there is the mean of both ends.

Shapes: batch first, increments (..., n_sub, 3), states (..., 4) and (..., 3).
Source: 000 (2.2.17-39), corrected; docs/mathematics/strapdown.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.earth import Earth
from sins_env.types import NavState

#: Factors k_ij (i < j) of the coning sum of k_ij dtheta_i x dtheta_j by samples per interval, 000 (2.2.17).
#: Sculling is its dual, 000 (2.2.33) with no. 6 of docs/mathematics/errata.md corrected. One sample needs the previous one too.
CONING = {3: ((0, 1, 27 / 40), (0, 2, 9 / 20), (1, 2, 27 / 40)), 2: ((0, 1, 2 / 3),), 1: ((0, 1, 1 / 12),)}


class StrapdownState(NamedTuple):
    """The state of the INS between two epochs."""

    nav: NavState
    last: Array | None  #: (..., 6), the previous sample (dtheta rad, dvel m/s); None unless intervals have one sample


class EpochMotion(NamedTuple):
    """What an error model needs of an epoch, with the INS's own values."""

    dt: float  #: s, length of the epoch
    C: Array  #: (..., 3, 3), mean C_hat_nb over the epoch
    dvel_n: Array  #: (..., 3) m/s, integral of C_hat f over the epoch
    vel: Array  #: (..., 3) m/s, velocity at mid-epoch
    rate_ie: Array  #: (3,) or (..., 3) rad/s, earth rate
    rate_en: Array  #: (..., 3) rad/s, transport rate at mid-epoch
    transport: Array  #: (3, 3) or (..., 3, 3) rad/m, omega_en = transport @ vel
    gravity_slope: Array  #: () or (...,) m/s^2 per rad of latitude


class Place(NamedTuple):
    """The earth at a position."""

    rate_ie: Array  #: (..., 3) rad/s, earth rate
    transport: Array  #: (..., 3, 3) rad/m, omega_en = transport @ vel
    gravity: Array  #: (..., 3) m/s^2, vector in n
    gravity_slope: Array  #: (...,) m/s^2 per rad of latitude


def samples_per_interval(n_sub: int) -> int:
    """Return the number of samples of an update interval: 3 if it divides ``n_sub``, else 2 if it does, else 1."""
    return 3 if n_sub % 3 == 0 else 2 if n_sub % 2 == 0 else 1


def _coupling(samples: int) -> Array:
    """Return the antisymmetric kappa of an interval.

    Coning is 1/2 sum kappa_ij dtheta_i x dtheta_j, sculling is sum kappa_ij dtheta_i x dvel_j.
    """
    size = max(samples, 2)
    kappa = np.zeros((size, size))
    for i, j, k in CONING[samples]:
        kappa[i, j], kappa[j, i] = k, -k
    return kappa


#: Coefficients of sculling by the number of samples in an interval.
COUPLING = {samples: _coupling(samples) for samples in CONING}
_NEXT, _AFTER = [1, 2, 0], [2, 0, 1]


def cross(a: Array, b: Array) -> Array:
    """Return a x b along the last axis; this is faster than np.cross for small arrays."""
    return a[..., _NEXT] * b[..., _AFTER] - a[..., _AFTER] * b[..., _NEXT]


def interval_increments(dtheta: Array, dvel: Array, last: Array | None) -> tuple[Array, Array]:
    """Return rotation vectors and velocity increments of the update intervals, in the body axes at their start.

    The increments in rad and m/s are (..., n_sub, 3), the results (..., intervals, 3). ``last`` (..., 6) is the sample before, for
    intervals of one sample. Equations 000 (2.2.17) and (2.2.33), corrected; the exact rotation term of
    docs/mathematics/strapdown.md#coning-and-sculling replaces (2.2.32).
    """
    n_sub = dtheta.shape[-2]
    samples = samples_per_interval(n_sub)
    shape = (*dtheta.shape[:-2], n_sub // samples, samples, 3)
    # Components are in front, because NumPy is fast on planes (6, samples, ..., intervals).
    groups = np.empty((6, max(samples, 2), *shape[:-2]))
    order = (len(shape) - 1, len(shape) - 2, *range(len(shape) - 2))
    groups[:3, -samples:] = dtheta.reshape(shape).transpose(order)
    groups[3:, -samples:] = dvel.reshape(shape).transpose(order)
    if samples == 1:
        groups[:, 0, ..., 1:] = groups[:, 1, ..., :-1]
        groups[:, 0, ..., 0] = (
            groups[:, 1, ..., 0] if last is None else last.transpose(last.ndim - 1, *range(last.ndim - 1))
        )
        total = groups[:, 1]
    else:
        total = groups.sum(axis=1)
    flat = groups.reshape(2, 3, groups.shape[1], -1)
    mixed = np.matmul(COUPLING[samples], flat)
    theta, vel = total.reshape(2, 3, -1)
    # dtheta_i x kappa_ij dtheta_j and dtheta_i x kappa_ij dvel_j, summed over the samples
    coning, sculling = np.add.reduce(
        attitude.cross_planes(flat[0][:, None], mixed.transpose(1, 0, 2, 3)), axis=2
    ).transpose(1, 0, 2)
    rotation = theta + 0.5 * coning
    theta2 = np.add.reduce(theta * theta, axis=0)
    first = attitude.cross_planes(theta, vel)
    a = 0.5 - theta2 * (1 / 24 - theta2 * (1 / 720 - theta2 / 40320))  # (1 - cos x) / x^2
    b = 1 / 6 - theta2 * (1 / 120 - theta2 * (1 / 5040 - theta2 / 362880))  # (1 - sin x / x) / x^2
    dvel_b = vel + a * first + b * attitude.cross_planes(theta, first) + sculling
    return rotation.T.reshape(*shape[:-2], 3), dvel_b.T.reshape(*shape[:-2], 3)


def carried_sample(dtheta: Array, dvel: Array) -> Array | None:
    """Return the last sample (..., 6) of an epoch if intervals have one sample, for the next epoch; else None."""
    if samples_per_interval(dtheta.shape[-2]) > 1:
        return None
    return np.concatenate([dtheta[..., -1, :], dvel[..., -1, :]], axis=-1)


def end_rate(dtheta: Array, epoch_s: float) -> Array:
    """Return omega_ib^b (..., 3) in rad/s at the end of an epoch, extrapolated from its last two samples (..., n_sub, 3)."""
    n_sub = dtheta.shape[-2]
    last = dtheta[..., -1, :]
    return (1.5 * last - 0.5 * dtheta[..., -2, :] if n_sub > 1 else last) * (n_sub / epoch_s)


def chain(rotation: Array, dvel_b: Array) -> tuple[Array, Array, Array]:
    """Join the intervals of an epoch, in the body axes at its start.

    Return quaternions (..., intervals + 1, 4) and matrices (..., intervals + 1, 3, 3) of the body, and velocity increments
    (..., intervals, 3) in m/s. The first quaternion and matrix are those of the start, the others of the ends of intervals.
    """
    turns = attitude.right_matrix(attitude.from_rotvec(rotation))
    intervals = rotation.shape[-2]
    relative = np.empty((*rotation.shape[:-2], intervals + 1, 4))
    relative[..., 0, :] = q = np.array([1.0, 0.0, 0.0, 0.0])
    for j in range(intervals):
        q = np.matmul(turns[..., j, :, :], q[..., None])[..., 0]
        relative[..., j + 1, :] = q
    bodies = attitude.to_dcm(relative)
    return relative, bodies, np.matmul(bodies[..., :-1, :, :], dvel_b[..., None])[..., 0]


class Strapdown:
    """The mechanisation at a site; ``hold_position`` keeps latitude, longitude and height of a base that does not travel."""

    def __init__(self, model: Earth, epoch_s: float, n_sub: int, site_pos: Array, hold_position: bool) -> None:
        self.model, self.epoch_s, self.n_sub, self.hold_position = model, epoch_s, n_sub, hold_position
        intervals = n_sub // samples_per_interval(n_sub)
        middles = (np.arange(intervals) + 0.5) * (epoch_s / intervals)  # s into the epoch
        self._moments = np.stack([np.ones(intervals), middles])
        self._weights = np.full(intervals + 1, 1.0 / intervals)  # trapezoid
        self._weights[[0, -1]] *= 0.5
        self._site = self._place(np.asarray(site_pos))

    def start(self, nav: NavState) -> StrapdownState:
        """Return the state before the first epoch."""
        return StrapdownState(nav, None)

    def _place(self, pos: Array) -> Place:
        """Return the earth at a position (..., 3): latitude rad, longitude rad, height m."""
        latitude, height = pos[..., 0], pos[..., 2]
        up = np.zeros(pos.shape)
        up[..., 2] = -earth.gravity(self.model, latitude, height)
        transport = earth.transport_matrix(self.model, latitude, height)
        return Place(earth.rate_n(self.model, latitude), transport, up, earth.gravity_slope(self.model, latitude))

    def advance(self, state: StrapdownState, dtheta: Array, dvel: Array) -> tuple[StrapdownState, EpochMotion]:
        """Return the state at the end of the epoch, and the motion of the epoch for an error model."""
        (q_nb, vel, pos), h = state.nav, self.epoch_s
        half = pos if self.hold_position else earth.displace(self.model, pos, 0.5 * h * vel)  # at mid-epoch
        rate_ie, transport, gravity, slope = self._site if self.hold_position else self._place(half)
        rotation, dvel_b = interval_increments(dtheta, dvel, state.last)
        relative, bodies, steps = chain(rotation, dvel_b)
        moments = np.matmul(self._moments, steps)  # (..., 2, 3): sum, and first moment in time
        C0 = attitude.to_dcm(q_nb)
        sums = np.matmul(moments, np.swapaxes(C0, -1, -2))
        force, moment = sums[..., 0, :], sums[..., 1, :]
        middle = vel + 0.5 * (force + h * gravity)
        rate_en = np.matmul(transport, middle[..., None])[..., 0]
        rate_in = rate_ie + rate_en
        force = force - cross(rate_in, moment)  # the navigation frame turns during the epoch
        new_vel = vel + force + h * (gravity - cross(rate_ie + rate_in, middle))
        new_q = attitude.multiply(attitude.from_rotvec(-h * rate_in), attitude.multiply(q_nb, relative[..., -1, :]))
        new_q = attitude.normalize(new_q)
        middle = 0.5 * (vel + new_vel)
        new_pos = pos if self.hold_position else earth.displace(self.model, pos, h * middle, at=half)  # (2.2.37-39)
        mean = np.matmul(self._weights, bodies.reshape(*bodies.shape[:-2], 9)).reshape(C0.shape)
        motion = EpochMotion(h, np.matmul(C0, mean), force, middle, rate_ie, rate_en, transport, slope)
        return StrapdownState(NavState(new_q, new_vel, new_pos), carried_sample(dtheta, dvel)), motion
