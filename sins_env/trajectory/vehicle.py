"""The true motion of an IMU in a parked car that people disturb.

The car is a rigid body with six modes, measured on a recording (:mod:`sins_env.trajectory.car`). Each mode answers its
inputs in closed form (:mod:`sins_env.trajectory.suspension`). In the axes of the mean heading, C(t) is the attitude,
d(t) the motion of the reference point and r the lever arm of the IMU. Position, velocity and specific force are

    p = d + C r        V = d' + C (w x r)        f^b = C'(d'' + 2 w_ie x V + g) + w' x r + w x (w x r)

so that a tilt and the velocity that it gives the IMU belong together. Increments are Gauss-Legendre integrals of the
analytic w_ib^b and f^b, with a relative error of 1e-9. The specific force omits the Coriolis term of the base's own
transport rate, 2e-10 m/s^2, like that of the swaying base. See docs/mathematics/simulation.md#parked-car.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sins_env import earth
from sins_env.arrays import Array, Rngs
from sins_env.attitude import body_rate_planes
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    Vector,
    add,
    correction,
    cross3,
    matrix,
    misaligned,
    put_quaternion,
    put_row,
    put_vector,
    scale,
    sincos3,
    subtract,
    transpose,
    turn,
    vector,
)
from sins_env.motion import Motion
from sins_env.trajectory import car
from sins_env.trajectory.car import UPPER_AXIS_M, Event
from sins_env.trajectory.suspension import Input, Modes
from sins_env.types import NavState, Site
from sins_env.units import DEG

#: Gauss-Legendre nodes in an IMU sample, or in each 10 ms of a longer one; tests measure the error that is left.
_NODES = 2
_BLOCK = 6_000  #: instants that exist at once, over all runs
Modal = tuple[float, float, float, float, float, float]  #: numbers of the six modes of car.MODES
PARKED_STD = 0.5 * DEG  #: 1 sigma of the pitch and roll at which a car stands, rad


class Vehicle:
    """A batch of parked cars.

    Args:
        site: place and earth model.
        epoch_s: length of an epoch, s.
        n_sub: IMU samples in an epoch.
        duration_s: length of a run, s, over which the events of a scene are drawn.
        rate_per_min: mean number of events per minute in a scene; they are Poisson in time.
    """

    def __init__(self, site: Site, epoch_s: float, n_sub: int, duration_s: float, rate_per_min: float) -> None:
        self.site, self.epoch_s, self.n_sub = site, epoch_s, n_sub
        self.duration_s, self.rate_per_min = duration_s, rate_per_min
        self._earth = model = earth.get(site.earth)
        self._gravity = float(earth.gravity(model, site.latitude, site.height))
        self._rate_ie = earth.rate_n(model, site.latitude)
        self._transport = earth.transport_matrix(model, site.latitude, site.height)
        self._lever = np.array(car.LEVER_M)
        self._modes = Modes(car.HZ, car.DAMPING)
        parts = max(1, round(epoch_s / n_sub / 0.01))  # longer samples than those of the recording are split
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        self._nodes = ((np.arange(parts)[:, None] + 0.5 + 0.5 * nodes) / parts).ravel() * epoch_s / n_sub
        self._weights = np.tile(0.5 * weights / parts, parts) * epoch_s / n_sub

    def reset(
        self,
        rngs: Rngs,
        heading: Array | None = None,
        events: Sequence[str | Sequence[Event]] = (),
    ) -> NavState:
        """Park one car per generator, and return the true states at t = 0, (runs, ...).

        Args:
            rngs: one generator for each run.
            heading: mean heading of each run, rad, (runs,); None draws it over the circle.
            events: the name of a scene, or a script, for each run; empty if nothing happens.
        """
        draws = np.stack([np.append(rng.random(), rng.standard_normal(2)) for rng in rngs])
        heading = 2 * np.pi * draws[:, 0] if heading is None else heading
        self._parked = PARKED_STD * draws[:, 1:]  # pitch and roll
        c, s = np.cos(heading), np.sin(heading)
        zero, one = np.zeros_like(c), np.ones_like(c)
        #: rotation from n into the axes of the mean heading
        self._turn = np.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)
        self._spin = self._turn @ self._rate_ie
        self._carry = self._turn @ self._transport @ self._turn.mT
        self._heading = heading
        self._modes.drive([self._inputs(*one) for one in zip(events or ["quiet"] * len(rngs), rngs, strict=True)])
        state, _ = self.states(np.zeros(1))
        return NavState(*(part[:, 0] for part in state))

    def _inputs(self, events: str | Sequence[Event], rng: np.random.Generator) -> list[Input]:
        if isinstance(events, str):
            return car.draw(events, self.rate_per_min, self.duration_s, rng)
        return car.scripted(events, rng)

    def chunk(self, first_epoch: int, num_epochs: int) -> Motion:
        """Return the motion in epochs first_epoch + 1 ... first_epoch + num_epochs, in any order."""
        samples = np.arange(first_epoch * self.n_sub, (first_epoch + num_epochs) * self.n_sub)
        t = samples[:, None] * (self.epoch_s / self.n_sub) + self._nodes
        runs = len(self._heading)
        dtheta, dvel = np.empty((2, runs, len(samples), 3))
        size = max(1, _BLOCK // t.size)
        for begin in range(0, runs, size):
            rows = slice(begin, min(begin + size, runs))
            dtheta[rows], dvel[rows] = _increments(
                self._deflections(t, rows),
                self._weights,
                self._parked[rows],
                self._lever,
                self._spin[rows],
                self._carry[rows],
                self._gravity,
            )
        ends = np.arange(first_epoch + 1, first_epoch + num_epochs + 1, dtype=np.float64) * self.epoch_s
        shape = (runs, num_epochs, self.n_sub, 3)
        return Motion(dtheta.reshape(shape), dvel.reshape(shape), *self.states(ends))

    def _deflections(self, t: Array, rows: slice = slice(None)) -> Array:
        """Return the deflections of the modes, their rates and their accelerations, (rows, 3, 6, *t.shape)."""
        q = np.moveaxis(self._modes.response(t.ravel(), rows), 2, 0)
        return q.reshape(*q.shape[:3], *t.shape)

    def earlier(self, after: NavState, t: Array, age: Array) -> tuple[NavState, Array]:
        """Return the true states (runs, len(t), ...) and omega_eb^b at the times t - age."""
        return self.states(t - age)

    def states(self, t: Array) -> tuple[NavState, Array]:
        """Return the true states (runs, len(t), ...) and omega_eb^b."""
        q_nb, vel, offset, rate_eb_b = _state(
            np.moveaxis(self._deflections(t), -1, 1),
            self._heading[:, None],
            self._parked[:, None],
            self._lever,
            self._turn[:, None],
            self._carry[:, None],
        )
        return NavState(q_nb, vel, earth.displace(self._earth, self.site.pos, offset)), rate_eb_b


@helper
def _angles(q: Modal) -> Vector:
    """Return heading about its mean, pitch and roll, or their rates or accelerations, of those of the modes."""
    return q[0], q[1], q[2] + q[3]


@helper
def _shift(q: Modal) -> Vector:
    """Return the motion of the reference point, or its rate or acceleration, of those of the modes."""
    return -UPPER_AXIS_M * q[3], q[5], q[4]


@helper
def _moving(angles: Vector, rates: Vector, drift: Vector, arm: Vector) -> tuple[Any, ...]:
    """Return the motion of the IMU, in the axes of the mean heading.

    Args:
        angles: heading about its mean, pitch and roll.
        rates: their rates.
        drift: velocity of the reference point.
        arm: lever arm.

    Returns:
        sines and cosines of pitch, roll and minus heading; the rotation C from these axes into the body; omega_nb^b; its
        product with the lever arm; and the velocity.
    """
    sine, cosine = sincos3((angles[1], angles[2], -angles[0]))
    # C_nb = C_n^c(phi)' of phi = (pitch, roll, -heading)
    C = misaligned(sine, cosine)
    rate = body_rate_planes((sine[0], sine[1]), (cosine[0], cosine[1]), rates)
    swung = cross3(rate, arm)
    return sine, cosine, C, rate, swung, add(drift, turn(transpose(C), swung))


@helper
def _body_acceleration(sine: Vector, cosine: Vector, rates: Vector, accelerations: Vector) -> Vector:
    """Return the derivative of attitude.body_rate."""
    sp, sr, cp, cr = sine[0], sine[1], cosine[0], cosine[1]
    dh, dp, dr = rates
    x, y, z = body_rate_planes((sp, sr), (cp, cr), accelerations)
    return (
        x + (dh * (dr * cr * cp - dp * sr * sp) - dp * dr * sr),
        y - dh * dp * cp,
        z + (dh * (dr * sr * cp + dp * cr * sp) + dp * dr * cr),
    )


@kernel("(3,6,s,w),(w),(2),(3),(3),(3,3),()->(s,3),(s,3)")
def _increments(
    deflections: Array,
    weights: Array,
    parked: Array,
    lever: Array,
    spin: Array,
    carry: Array,
    gravity: float,
    dtheta: Array,
    dvel: Array,
) -> None:
    """Integrate omega_ib^b and f^b over the samples.

    Args:
        deflections: those of the modes, their rates and accelerations, at the nodes of each sample.
        weights: weights of the nodes, s.
        parked: pitch and roll at rest, rad.
        lever: lever arm, m.
        spin: rate of the Earth in the axes of the mean heading, rad/s.
        carry: matrix of the transport rate in these axes.
        gravity: gravity, m/s^2.
        dtheta: increments of angle, rad.
        dvel: increments of velocity, m/s.
    """
    samples, arm, w_ie, T = dtheta.shape[0], vector(lever), vector(spin), matrix(carry)
    pitch, roll = parked[0], parked[1]
    q, sums = np.empty((18, samples)), np.zeros((6, samples))
    for p in range(len(weights)):
        weight = weights[p]
        for k in range(18):
            for i in range(samples):
                q[k, i] = deflections[k // 6, k % 6, i, p]
        for i in range(samples):
            at = (q[0, i], q[1, i] + pitch, q[2, i] + roll, q[3, i], q[4, i], q[5, i])
            moves = (q[6, i], q[7, i], q[8, i], q[9, i], q[10, i], q[11, i])
            gains = (q[12, i], q[13, i], q[14, i], q[15, i], q[16, i], q[17, i])
            rates = _angles(moves)
            sine, cosine, C, rate, swung, vel = _moving(_angles(at), rates, _shift(moves), arm)
            turned = add(rate, turn(C, add(w_ie, turn(T, vel))))
            force = add(_shift(gains), cross3(scale(2.0, w_ie), vel))
            force = turn(C, (force[0], force[1], force[2] + gravity))
            spun = cross3(_body_acceleration(sine, cosine, rates, _angles(gains)), arm)
            force = add(force, add(spun, cross3(rate, swung)))
            sums[0, i] += weight * turned[0]
            sums[1, i] += weight * turned[1]
            sums[2, i] += weight * turned[2]
            sums[3, i] += weight * force[0]
            sums[4, i] += weight * force[1]
            sums[5, i] += weight * force[2]
    for i in range(samples):
        put_row((sums[0, i], sums[1, i], sums[2, i]), dtheta, i)
        put_row((sums[3, i], sums[4, i], sums[5, i]), dvel, i)


@helper
def _modal(q: Array) -> Modal:
    """Return the numbers of the six modes."""
    return q[0], q[1], q[2], q[3], q[4], q[5]


@kernel("(3,6),(),(2),(3),(3,3),(3,3)->(4),(3),(3),(3)")
def _state(
    deflections: Array,
    mean: float,
    parked: Array,
    lever: Array,
    from_n: Array,
    carry: Array,
    q_nb: Array,
    vel: Array,
    offset: Array,
    rate_eb_b: Array,
) -> None:
    """Return attitude, velocity, the metres from the place at rest, and omega_eb^b at an instant.

    Args:
        deflections: those of the modes, their rates and accelerations.
        mean: mean heading, rad.
        parked: pitch and roll at rest, rad.
        lever: lever arm, m.
        from_n: rotation from n into the axes of the mean heading.
        carry: matrix of the transport rate in these axes.
    """
    at, moves, arm, to_n = _modal(deflections[0]), _modal(deflections[1]), vector(lever), transpose(matrix(from_n))
    heading, pitch, roll = add(_angles(at), (0.0, parked[0], parked[1]))
    _, _, C, rate, _, v = _moving((heading, pitch, roll), _angles(moves), _shift(moves), arm)
    sine, cosine = sincos3((parked[0], parked[1], 0.0))
    rest = turn(transpose(misaligned(sine, cosine)), arm)
    put_quaternion(correction((pitch, roll, -(mean + heading))), q_nb)
    put_vector(turn(to_n, v), vel)
    put_vector(turn(to_n, subtract(add(_shift(at), turn(transpose(C), arm)), rest)), offset)
    put_vector(add(rate, turn(C, turn(matrix(carry), v))), rate_eb_b)
