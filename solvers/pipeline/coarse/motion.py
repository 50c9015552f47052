"""Coarse alignment in motion: the unknown attitude of a base that travels, with any heading and no standstill.

In axes i that do not turn, the specific force changes the velocity of the base and compensates gravity:

    C_ib0^i integral of C_b^ib0 f dt = C_n^i v + integral of C_n^i (omega_ie x v - g) dt - c                     "velocity"
    twice integrated, with the place in the place of the velocity, - c - d t                                     "position"
    C_ib0^i (integral of C_b^ib0 f dt - C_b^ib0 v_b) = integral of C_n^i (omega_ie x v - g) dt - c, v = C_b^n v_b    "body"

The constants c and d are the unknown velocity and place at the start. Polynomials in time are projected out of the pairs, so no
single noisy fix counts more than another. What is left is Wahba's problem. C_n^i follows the place of the base.
Source: Wu & Pan (2013), doi:10.1109/TAES.2013.6494395, with their first fix replaced by c;
docs/mathematics/coarse_alignment.md#alignment-in-motion.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.prior import ANY_HEADING_STD_DEG
from sins_env.types import NavState, Observation, Task
from sins_env.units import DEG, PPM
from solvers.pipeline.coarse.fits import by_svd
from solvers.pipeline.coarse.inertial import InertialFrame
from solvers.pipeline.coarse.spread import Readings, Spread, from_the_end, of_pairs, outer, profile
from solvers.pipeline.strapdown import cross, end_rate

#: Weight of the direction of gravity beside the pairs: it gives the level before there are any, and moves no later answer.
LEVEL_WEIGHT = 1e-9
LEAST_SHARE = 1e-12  #: information about an axis, over that about all, below which nothing is known about it
LEAST_MPS = 1e-5  #: m/s, least noise of a velocity along the body
SCALE_S = 60.0  #: s, unit of time of the polynomials
REPEATS = 4  #: number of times that velocities along the body are turned by the attitude that they led to


class Sums:
    """Sums over pairs of vectors, from which the profile without polynomials in time follows at any time."""

    def __init__(self, degree: int, batch: tuple[int, ...]) -> None:
        self._degree = degree
        self._powers = np.zeros((*batch, degree + 1, degree + 1))
        self._u, self._v = np.zeros((*batch, degree + 1, 3)), np.zeros((*batch, degree + 1, 3))
        self._product = np.zeros((*batch, 3, 3))

    def trend(self, C: Array) -> Array:
        """Return the slope (..., 3) per s of the line that u - C v leaves, if the degree is 1."""
        lines = np.linalg.pinv(self._powers, hermitian=True) @ (self._u - self._v @ C.mT)
        return lines[..., 1, :] / SCALE_S

    def add(self, t: Any, u: Array, v: Array, valid: Mask) -> None:
        """Add a pair (..., 3) at ``t`` s, a number or (..., 1), in the runs where it is ``valid`` (..., 1)."""
        p = valid * (t / SCALE_S) ** np.arange(self._degree + 1)
        u, v = np.where(valid, u, 0.0), np.where(valid, v, 0.0)
        self._powers = self._powers + outer(p, p)
        self._u, self._v = self._u + outer(p, u), self._v + outer(p, v)
        self._product = self._product + outer(u, v)

    def profile(self) -> Array:
        """Return the sum of u v' (..., 3, 3) of what is left of the pairs."""
        return self._product - self._u.mT @ np.linalg.pinv(self._powers, hermitian=True) @ self._v


class Trapezoids:
    """The integral of a vector over the times at which it is known, by trapezoids; it begins with zero at the first."""

    def __init__(self, batch: tuple[int, ...]) -> None:
        self._at = np.full((*batch, 1), np.nan)
        self._slope, self._sum = np.zeros((*batch, 3)), np.zeros((*batch, 3))

    def to(self, t: Any, slope: Array, valid: Mask) -> Array:
        """Integrate to ``t`` s, a number or (..., 1), and return the integral (..., 3).

        That is done in the runs in which the derivative is ``valid`` (..., 1).
        """
        h = np.where(np.isnan(self._at), 0.0, t - self._at)
        self._sum = self._sum + np.where(valid, 0.5 * h * (self._slope + slope), 0.0)
        self._slope, self._at = np.where(valid, slope, self._slope), np.where(valid, t, self._at)
        return self._sum


class Epoch(NamedTuple):
    """What the spread needs of an epoch."""

    force: Array  #: (..., 3) m/s, integral of C_b^ib0 f
    u: Array  #: (..., 3), the pair's vector in i
    v: Array  #: (..., 3), that in ib_0
    q: Array  #: (..., 4), body axes against those at the start
    place: Array  #: (..., 3) latitude rad, longitude rad, height m
    valid: Mask  #: (..., 1)


class InMotion(InertialFrame, ABC):
    """Wahba's problem over pairs of which polynomials in time of some degree are unknown; batch first.

    The axes i are those of the earth at the start, so the place of the base and the time give C_n^i.
    """

    degree: ClassVar[int] = 0
    exact_in_i: ClassVar[bool] = False  #: whether the vectors in i have the smaller noise; else those in ib_0 have

    def __init__(self, task: Task, batch: tuple[int, ...], open_ended: bool = False) -> None:
        """Begin; ``open_ended`` keeps what the spread needs beyond the coarse phase of the task."""
        super().__init__(task, batch)
        self.travels = np.array(True)
        self._open = open_ended
        self._task, self._model = task, earth.get(task.site.earth)
        self._lever = np.asarray(task.gps.lever_arm_m)
        self._place = np.broadcast_to(task.site.pos, (*batch, 3))
        self._age: Any = 0.0
        self._read_at: Any = 0.0  # s, time of the readings of this epoch
        self._v_before = self._v_b
        self._vel, self._fixed = np.zeros((*batch, 3)), np.zeros((*batch, 1), dtype=bool)
        self._sums = Sums(self.degree, batch)
        self._spread_at = round(task.coarse_s / task.epoch_s)
        self._seen: list[Epoch] = []  # as far as the spread is asked for

    def follow(self, other: InertialFrame, obs: Observation) -> None:
        """Take one more epoch, whose increments another method has integrated; none that integrates more than velocities."""
        self._v_before = self._v_b
        self._k, self._v_b, self._q = other.integrated
        self.bridged = other.bridged
        self._keep(self._v_b, self._v_b, obs)

    def _integrate(self, steps: Array) -> None:
        self._v_before = self._v_b
        super()._integrate(steps)

    def _keep(self, v_b: Array, v_i: Array, obs: Observation) -> None:
        valid = self._move(obs)
        u, v = self._pair(obs, valid)
        self._sums.add(self._read_at, u, v, valid)
        if self._open or self._k <= self._spread_at:
            self._seen.append(Epoch(self._v_b, u, v, self._q, self._place, valid))
        if self._k == self._spread_at:
            self.settle()

    def settle(self) -> None:
        """Take the epochs so far again with what they have led to, before the attitude counts."""

    @property
    def _time(self) -> float:
        return self._k * self._epoch_s

    def _move(self, obs: Observation) -> Mask:
        """Move the place to the end of the epoch, and return which runs (..., 1) have a pair there."""
        valid: Mask = obs["gps_valid"] == 1
        ahead = earth.displace(self._model, self._place, self._epoch_s * self._vel)
        self._place = np.where(valid, obs["gps_pos"], ahead)
        self._age = np.where(valid, obs.get("gps_age", 0.0), 0.0)  # s, of the fix
        self._read_at = self._time - self._age
        self._fixed = valid
        return valid

    @abstractmethod
    def _pair(self, obs: Observation, valid: Mask) -> tuple[Array, Array]:
        """Return the pair (..., 3) of this epoch in the axes i and ib_0; it counts in the ``valid`` runs."""

    def _fit(self) -> Array:
        up = self._C_i_n()[..., 2, :]  # in i
        return by_svd(self._sums.profile() + LEVEL_WEIGHT * outer(up, self._v_b))

    def _C_i_n(self) -> Array:
        return turns(self._place, self._rate * self._time)

    def state(self, nav: NavState) -> NavState:
        """Return the state of the INS: that of the fix, or without one the last velocity and the place that it leads to."""
        fixed = self._fixed
        return NavState(nav.q_nb, np.where(fixed, nav.vel, self._vel), np.where(fixed, nav.pos, self._place))

    def spread(self) -> Spread | None:
        """Return what the attitude is off by, after an epoch that was kept for that; else None."""
        if not self._seen or self._k != len(self._seen):
            return None
        force, u, v, q, place, valid = self.seen()
        C = self._fit()
        vectors = u if self.exact_in_i else np.matmul(C, v[..., None])[..., 0]
        c = valid * without_polynomials(vectors, valid, self.degree)
        weighted = profile(c, c)
        N = np.trace(weighted, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - weighted
        least = (LEAST_SHARE * np.trace(N, axis1=-2, axis2=-1)[..., None, None] + attitude.TINY) * np.eye(3)
        N = N + least
        time = self._epoch_s * np.arange(1, len(c) + 1)
        C_n = turns(place, self._rate * time.reshape(-1, *(1,) * (place.ndim - 2))).mT
        starts = np.concatenate([np.broadcast_to([1.0, 0.0, 0.0, 0.0], (1, *q.shape[1:])), q[:-1]])

        def C_b(part: slice) -> Array:
            return 0.5 * C @ (attitude.to_dcm(starts[part]) + attitude.to_dcm(q[part]))

        du = np.diff(np.matmul(C, force[..., None])[..., 0], axis=0, prepend=0.0)
        readings = self._readings(c, C @ attitude.to_dcm(q), C_n, np.matmul(C, (force - v)[..., None])[..., 0])
        told = of_pairs(
            du, self._of_increments(c), N, C_b, C_n, self._epoch_s, self._task.prior, readings, self.bridged
        )
        unseen = (
            ANY_HEADING_STD_DEG * DEG * self._C_i_n() @ np.linalg.inv(N) @ least
        )  # of axes about which no pair tells
        return told._replace(noise=told.noise + unseen @ unseen.mT)

    def seen(self) -> Epoch:
        """Return the epochs of the coarse phase so far, (K, ...)."""
        return Epoch(*(np.stack(parts) for parts in zip(*self._seen, strict=True)))

    def _then(self) -> Array:
        """Return v_b (..., 3) at the time of the fix."""
        return self._v_b - self._age / self._epoch_s * (self._v_b - self._v_before)

    def _of_increments(self, c: Array) -> Array:
        """Return the coefficients (K, ..., 3) of the velocities for those of the pairs."""
        return c

    @abstractmethod
    def _readings(self, c: Array, C_b: Array, C_n: Array, along: Array) -> Readings:
        """Return how the errors of the readings enter.

        Args:
            c: (K, ..., 3), coefficients of the pairs.
            C_b: (K, ..., 3, 3), turns from body axes into i at the ends of epochs.
            C_n: (K, ..., 3, 3), turns from n into i.
            along: (K, ..., 3) m/s in i, what the pairs have less than the integral of the force.
        """

    def _antenna(self, obs: Observation) -> tuple[Array, Array]:
        """Return place m and velocity m/s of the antenna about the IMU in the body axes at the start, (..., 3)."""
        if not self._lever.any():
            return np.zeros(3), np.zeros(3)
        rate = end_rate(obs["dtheta"], self._epoch_s)
        lever = np.broadcast_to(self._lever, rate.shape)
        return self._in_start_axes(lever), self._in_start_axes(cross(rate, self._lever))


class Velocity(InMotion):
    """Pairs of velocities, from the velocity of the fixes."""

    def __init__(self, task: Task, batch: tuple[int, ...], open_ended: bool = False) -> None:
        super().__init__(task, batch, open_ended)
        self._integral = Trapezoids(batch)

    def _move(self, obs: Observation) -> Mask:
        valid = super()._move(obs)
        self._vel = np.where(valid, obs["gps_vel"], self._vel)
        return valid

    def _pair(self, obs: Observation, valid: Mask) -> tuple[Array, Array]:
        both = np.stack([self._vel, pull(self._model, self._place, self._vel)], axis=-1)  # turned at once
        vel, pulled = np.moveaxis(self._C_i_n().mT @ both, -1, 0)
        swept = self._integral.to(self._read_at, pulled, valid)
        return vel + swept, self._then() + self._antenna(obs)[1]

    def _readings(self, c: Array, C_b: Array, C_n: Array, along: Array) -> Readings:
        return Readings(c, C_n @ self._task.prior.R[:3, :3] @ C_n.mT)


class Position(InMotion):
    """Pairs of places, from the position of the fixes, whose velocities are not used."""

    degree = 1

    def __init__(self, task: Task, batch: tuple[int, ...], open_ended: bool = False) -> None:
        super().__init__(task, batch, open_ended)
        self._way_b = np.zeros((*batch, 3))  # m, the integral of v_b
        self._way = np.zeros((*batch, 3))  # m in i, by the fixes
        self._fallen, self._turned = Trapezoids(batch), Trapezoids(batch)
        self._rate_i = np.array([0.0, 0.0, self._rate])
        self._changed = np.zeros((*batch, 3))  # m/s in i, change of the velocity by gravity and by the earth's turn
        self._fix_at = np.full((*batch, 1), np.nan)
        self._fix, self._C_fix = self._place, np.zeros((*batch, 3, 3))  # place of the last fix, and C_n^i there

    def _integrate(self, steps: Array) -> None:
        m = steps.shape[-2]
        left = self._epoch_s * (1.0 - (np.arange(m) + 0.5) / m)  # s from the middle of each interval to the end
        moment = self._in_start_axes((steps * left[:, None]).sum(axis=-2))
        self._way_b = self._way_b + self._epoch_s * self._v_b + moment
        super()._integrate(steps)

    def _pair(self, obs: Observation, valid: Mask) -> tuple[Array, Array]:
        C, t = self._C_i_n().mT, self._read_at
        later = valid & ~np.isnan(self._fix_at)
        middle = 0.5 * (self._fix + self._place)
        step = earth.offset(self._model, middle, self._place) - earth.offset(self._model, middle, self._fix)
        self._vel = np.where(later, step / np.where(later, t - self._fix_at, 1.0), self._vel)
        moved = np.matmul(0.5 * (self._C_fix + C), step[..., None])[..., 0]
        self._way = self._way + np.where(later, moved, 0.0)
        self._fix, self._fix_at = np.where(valid, self._place, self._fix), np.where(valid, t, self._fix_at)
        self._C_fix = np.where(valid[..., None], C, self._C_fix)
        fallen = pull(self._model, self._place, np.zeros(self._vel.shape))
        fallen = self._fallen.to(t, np.matmul(C, fallen[..., None])[..., 0], valid)
        self._changed = cross(self._rate_i, self._way) + fallen
        turned = self._turned.to(t, self._changed, valid)
        then = self._way_b - 0.5 * self._age * (self._v_b + self._then())
        return self._way + turned, then + self._antenna(obs)[0]

    def state(self, nav: NavState) -> NavState:
        """Return the state of the INS; at a fix its velocity is that of the pairs."""
        C = self._fit()
        vel_i = np.matmul(C, self._v_b[..., None])[..., 0] + self._sums.trend(C) - self._changed
        vel = np.matmul(self._C_i_n(), vel_i[..., None])[..., 0]
        return super().state(nav._replace(vel=vel))

    def _of_increments(self, c: Array) -> Array:
        return self._epoch_s * (from_the_end(c) - 0.5 * c)

    def _readings(self, c: Array, C_b: Array, C_n: Array, along: Array) -> Readings:
        return Readings(c, C_n @ self._task.prior.R[3:, 3:] @ C_n.mT)


class Body(InMotion):
    """Pairs of velocities, from a velocity along the body: a Doppler log, or an odometer with its constraint.

    The attitude turns this velocity into n, for the place and the earth's rate. At the end of the coarse phase that is done again
    with the attitude found.

    Raises:
        ValueError: the task has no such sensor.
    """

    exact_in_i = True

    def __init__(self, task: Task, batch: tuple[int, ...], open_ended: bool = False) -> None:
        super().__init__(task, batch, open_ended)
        self._spec = body_sensor(task)
        if self._spec is None:
            raise ValueError(
                f'coarse = "motion_body" on {task.id}, whose aids show no velocity along the body; '
                'allowed: with aids "dvl", or "odometer" with nhc'
            )
        self._mean = self._spec.name == "odometer"  # over the epoch
        self._sensor_lever = np.asarray(self._spec.lever_arm_m)
        self._batch = batch
        self._before = self._v_b, self._q
        self._read: list[tuple[Array, Array, Mask]] = []
        self._begin()

    def _begin(self) -> None:
        self._place = np.broadcast_to(self._task.site.pos, (*self._batch, 3))
        self._sums, self._integral = Sums(self.degree, self._batch), Trapezoids(self._batch)
        self._swept, self._moves = np.zeros((*self._batch, 3)), False
        self._every: Mask = np.ones((*self._batch, 1), dtype=bool)

    @property
    def way(self) -> Array:
        """Horizontal distance (...) from the site, m."""
        away = earth.offset(self._model, np.broadcast_to(self._task.site.pos, self._place.shape), self._place)
        return np.hypot(away[..., 0], away[..., 1])

    def _move(self, obs: Observation) -> Mask:
        valid: Mask = obs[f"{self._spec.name}_valid"] == 1  # type: ignore[literal-required]
        self._read_at = self._time
        return valid

    def _pair(self, obs: Observation, valid: Mask) -> tuple[Array, Array]:
        v_b, C = self._v_b, attitude.to_dcm(self._q)
        if self._mean:
            v_b, C = 0.5 * (self._before[0] + v_b), 0.5 * (attitude.to_dcm(self._before[1]) + C)
        self._before = self._v_b, self._q
        along = np.matmul(C, self._velocity(obs)[..., None])[..., 0]
        if self._open or self._k <= self._spread_at:
            self._read.append((v_b, along, valid))
        return self._swept_to(self._time, along, valid, self._fit()), v_b - along

    def _velocity(self, obs: Observation) -> Array:
        """Return the velocity of the IMU along the body axes, (..., 3) m/s."""
        reading = np.asarray(obs[self._spec.name])  # type: ignore[literal-required]
        if self._mean:
            speed, rate = reading / self._epoch_s, obs["dtheta"].sum(axis=-2) / self._epoch_s
            reading = speed * np.array([0.0, 1.0, 0.0])
        else:
            rate = end_rate(obs["dtheta"], self._epoch_s)
        return reading - cross(rate, np.broadcast_to(self._sensor_lever, rate.shape))

    def _swept_to(self, t: float, along: Array, valid: Mask, C: Array) -> Array:
        """Move the place with a velocity (..., 3) in ib_0, and return the pair's vector in i; C is C_ib0^i."""
        vel = np.matmul(turns(self._place, self._rate * t) @ C, along[..., None])[..., 0]
        vel = np.where(valid, vel, self._vel)
        mean, self._vel = vel if self._mean or not self._moves else 0.5 * (self._vel + vel), vel
        self._moves = True
        self._place = earth.displace(self._model, self._place, self._epoch_s * mean)
        before, C_i_n = self._swept, turns(self._place, self._rate * t)
        pulled = np.matmul(C_i_n.mT, pull(self._model, self._place, self._vel)[..., None])[..., 0]
        self._swept = self._integral.to(t, pulled, self._every)
        return 0.5 * (before + self._swept) if self._mean else self._swept

    def settle(self) -> None:
        for _ in range(REPEATS):
            C = self._fit()
            self._begin()
            for k, (v_b, along, valid) in enumerate(self._read, start=1):
                t = k * self._epoch_s
                self._sums.add(t, self._swept_to(t, along, valid, C), v_b - along, valid)

    def _readings(self, c: Array, C_b: Array, C_n: Array, along: Array) -> Readings:
        spec = self._spec
        turned = -attitude.skew(along) @ C_b
        if self._mean:
            variances = np.array(
                [spec.lateral_mps, max(spec.noise_mps, spec.pulse_m / self._epoch_s), spec.vertical_mps]
            )
            mounting = np.array([1.0, 0.0, 1.0])
        else:
            variances, mounting = np.full(3, spec.noise_mps), np.ones(3)
        variances = np.maximum(variances, LEAST_MPS) ** 2
        constants = [
            PPM * spec.scale_ppm * along[..., None],
            1e-3 * spec.mounting_mrad * mounting * turned,
        ]
        walk = 0.0
        if getattr(spec, "track", "bottom") != "bottom":
            constants.append(spec.current_mps * self._of_current(C_n))
            walk = 2.0 * spec.current_mps**2 * self._epoch_s / spec.current_s
        R = (C_b * variances) @ C_b.mT
        return Readings(c, R, along, np.concatenate(constants, axis=-1), walk)

    def _of_current(self, C_n: Array) -> Array:
        """Return what a current of 1 m/s E and N does to the pairs, (K, ..., 3, 2) m/s."""
        T = self._epoch_s
        tilts = earth.transport_matrix(self._model, *self._task.site.pos[[0, 2]])
        rate = attitude.skew(earth.rate_n(self._model, self._latitude))
        time = T * np.arange(1, len(C_n) + 1).reshape(-1, *(1,) * (C_n.ndim - 1))
        up = attitude.skew(np.array([0.0, 0.0, self._gravity]))
        return (C_n + T * np.cumsum(C_n @ (rate - time * (up @ tilts)), axis=0))[..., :2]


def body_sensor(task: Task) -> Any:
    """Return the specification of the sensor that shows the velocity along the body; None if there is none."""
    for spec in task.aids:
        if spec.name == "dvl" or (spec.name == "odometer" and getattr(spec, "nhc", False)):
            return spec
    return None


def turns(place: Array, angle: Any) -> Array:
    """Return C_i^n (..., 3, 3) at a place (..., 3) once the earth has turned by ``angle`` rad; i are its axes before."""
    return earth.ecef_to_enu(place[..., 0], angle + place[..., 1])


def pull(model: earth.Earth, place: Array, vel: Array) -> Array:
    """Return omega_ie x v - g in n, (..., 3) m/s^2."""
    out = cross(earth.rate_n(model, place[..., 0]), vel)
    out[..., 2] += earth.gravity(model, place[..., 0], place[..., 2])
    return out


def without_polynomials(x: Array, valid: Mask, degree: int) -> Array:
    """Return x (K, ..., 3) without the polynomials in time that fit it where it is ``valid`` (K, ..., 1)."""
    time = np.linspace(0.0, 1.0, len(x)).reshape(-1, *(1,) * (x.ndim - 1))
    p = valid * time ** np.arange(degree + 1)
    fit = np.linalg.pinv(profile(p, p), hermitian=True) @ profile(p, x)
    return x - np.matmul(p[..., None, :], fit)[..., 0, :]
