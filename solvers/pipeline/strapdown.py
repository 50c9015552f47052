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

from sins_env import earth
from sins_env.arrays import Array
from sins_env.earth import Earth
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    Vector,
    add,
    cross3,
    dot,
    from_rotvec,
    matrix,
    mix,
    multiply,
    normalize,
    product,
    put_matrix,
    put_quaternion,
    put_row,
    put_vector,
    quaternion,
    row,
    scale,
    subtract,
    to_dcm,
    turn,
    vector,
)
from sins_env.types import NavState, Observation

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
_NOT_USED = np.zeros(6)


def cross(a: Array, b: Array) -> Array:
    """Return a x b along the last axis; this is faster than np.cross for small arrays."""
    return a[..., _NEXT] * b[..., _AFTER] - a[..., _AFTER] * b[..., _NEXT]


@helper
def sample(dtheta: Array, dvel: Array, last: Array, i: int) -> tuple[Vector, Vector]:
    """Return dtheta and dvel of sample i of an epoch; the one before the first is ``last``."""
    if i < 0:
        return (last[0], last[1], last[2]), (last[3], last[4], last[5])
    return row(dtheta, i), row(dvel, i)


@helper
def interval(dtheta: Array, dvel: Array, last: Array, kappa: Array, start: int, end: int) -> tuple[Vector, Vector]:
    """Return rotation vector and velocity increment of the interval of samples ``start`` to ``end``, in its first body axes."""
    theta, vel, coning, sculling = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for j in range(start, end):
        angle, speed = row(dtheta, j), row(dvel, j)
        theta, vel = add(theta, angle), add(vel, speed)
        window = end - len(kappa)
        if j > window:
            before, slower = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
            for i in range(window, j):
                k = kappa[i - window, j - window]
                earlier, slow = sample(dtheta, dvel, last, i)
                before, slower = add(before, scale(k, earlier)), add(slower, scale(k, slow))
            coning = add(coning, cross3(before, angle))
            sculling = add(sculling, add(cross3(before, speed), cross3(slower, angle)))
    x2 = dot(theta, theta)
    a = 0.5 - x2 * (1 / 24 - x2 * (1 / 720 - x2 / 40320))  # (1 - cos x) / x^2
    b = 1 / 6 - x2 * (1 / 120 - x2 * (1 / 5040 - x2 / 362880))  # (1 - sin x / x) / x^2
    once = cross3(theta, vel)
    turned = add(scale(a, once), scale(b, cross3(theta, once)))
    return add(theta, coning), add(add(vel, turned), sculling)


@kernel("(s,3),(s,3),(6),(w,w),(m)->(m,3),(m,3)")
def _intervals(
    dtheta: Array, dvel: Array, last: Array, kappa: Array, middles: Array, rotation: Array, dvel_b: Array
) -> None:
    samples = len(dtheta) // len(middles)
    for j in range(len(middles)):
        theta, vel = interval(dtheta, dvel, last, kappa, j * samples, (j + 1) * samples)
        put_row(theta, rotation, j)
        put_row(vel, dvel_b, j)


@kernel("(m,3),(m,3)->(m,4),(m,3)")
def chain(rotation: Array, dvel_b: Array, ends: Array, steps: Array) -> None:
    """Join the intervals of an epoch, in the body axes at its start.

    Rotation vectors (..., intervals, 3) and velocity increments come in. The quaternions (..., intervals, 4) of the body at the
    ends of the intervals go out, and the velocity increments (..., intervals, 3) in m/s.
    """
    q = (1.0, 0.0, 0.0, 0.0)
    for j in range(len(rotation)):
        put_row(turn(to_dcm(q), row(dvel_b, j)), steps, j)
        q = multiply(q, from_rotvec(row(rotation, j)))
        ends[j, 0], ends[j, 1], ends[j, 2], ends[j, 3] = q


def interval_increments(dtheta: Array, dvel: Array, last: Array | None) -> tuple[Array, Array]:
    """Return rotation vectors and velocity increments of the update intervals, in the body axes at their start.

    The increments in rad and m/s are (..., n_sub, 3), the results (..., intervals, 3). ``last`` (..., 6) is the sample before, for
    intervals of one sample. Equations 000 (2.2.17) and (2.2.33), corrected; the exact rotation term of
    docs/mathematics/strapdown.md#coning-and-sculling replaces (2.2.32).
    """
    samples = samples_per_interval(dtheta.shape[-2])
    middles = np.empty(dtheta.shape[-2] // samples)
    rotation, dvel_b = _intervals(dtheta, dvel, _before(dtheta, dvel, last), COUPLING[samples], middles)
    return rotation, dvel_b


def _before(dtheta: Array, dvel: Array, last: Array | None) -> Array:
    """Return the sample (..., 6) before the epoch, for intervals of one sample; without one it is taken to be as the first."""
    if samples_per_interval(dtheta.shape[-2]) > 1:
        return _NOT_USED
    return np.concatenate([dtheta[..., 0, :], dvel[..., 0, :]], axis=-1) if last is None else last


def bridge_noise(obs: Observation) -> Array | None:
    """Return the covariance (..., 6, 6) of what bridged samples of an epoch are off by; None if no run has any."""
    cov = obs.get("bridge_cov")
    return None if cov is None or not cov.any() else cov


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


@kernel("(4),(3),(s,3),(s,3),(6),(w,w),(m),(),(3),(3,3),(3)->(4),(3),(3,3),(3),(3),(3)")
def _advance(
    q_nb: Array, vel: Array, dtheta: Array, dvel: Array, last: Array, kappa: Array, middles: Array, h: float,
    rate_ie: Array, transport: Array, gravity: Array,
    new_q: Array, new_vel: Array, mean_C: Array, dvel_n: Array, mean_vel: Array, rate_en: Array,
) -> None:  # fmt: skip
    intervals = len(middles)
    samples = len(dtheta) // intervals
    # in the body axes at the start of the epoch: rotation so far, sum of velocity increments and its moment in time
    q, body = (1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    total, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    mean = mix(0.5, body, 0.0, body)  # trapezoid
    for j in range(intervals):
        rotation, dvel_b = interval(dtheta, dvel, last, kappa, j * samples, (j + 1) * samples)
        step = turn(body, dvel_b)
        total, moment = add(total, step), add(moment, scale(middles[j], step))
        q = multiply(q, from_rotvec(rotation))
        body = to_dcm(q)
        mean = mix(1.0, mean, 0.5 if j == intervals - 1 else 1.0, body)
    q0, v = quaternion(q_nb), vector(vel)
    C, T, earth_rate, g = to_dcm(q0), matrix(transport), vector(rate_ie), vector(gravity)
    force, moment = turn(C, total), turn(C, moment)
    middle = add(v, scale(0.5, add(force, scale(h, g))))
    carried = turn(T, middle)
    rate_in = add(earth_rate, carried)
    force = subtract(force, cross3(rate_in, moment))  # the navigation frame turns during the epoch
    after = add(add(v, force), scale(h, subtract(g, cross3(add(earth_rate, rate_in), middle))))
    put_quaternion(normalize(multiply(from_rotvec(scale(-h, rate_in)), multiply(q0, q))), new_q)
    put_vector(after, new_vel)
    put_matrix(product(C, mix(1.0 / intervals, mean, 0.0, mean)), mean_C)
    put_vector(force, dvel_n)
    put_vector(scale(0.5, add(v, after)), mean_vel)
    put_vector(carried, rate_en)


class Strapdown:
    """The mechanisation at a site; ``hold_position`` keeps latitude, longitude and height of a base that does not travel."""

    def __init__(self, model: Earth, epoch_s: float, n_sub: int, site_pos: Array, hold_position: bool) -> None:
        self.model, self.epoch_s, self.n_sub, self.hold_position = model, epoch_s, n_sub, hold_position
        samples = samples_per_interval(n_sub)
        intervals = n_sub // samples
        self._kappa = COUPLING[samples]
        self._middles = (np.arange(intervals) + 0.5) * (epoch_s / intervals)  # s into the epoch
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
        last = _before(dtheta, dvel, state.last)
        new_q, new_vel, C, dvel_n, middle, rate_en = _advance(
            q_nb, vel, dtheta, dvel, last, self._kappa, self._middles, h, rate_ie, transport, gravity
        )
        new_pos = pos if self.hold_position else earth.displace(self.model, pos, h * middle, at=half)  # (2.2.37-39)
        motion = EpochMotion(h, C, dvel_n, middle, rate_ie, rate_en, transport, slope)
        return StrapdownState(NavState(new_q, new_vel, new_pos), carried_sample(dtheta, dvel)), motion
