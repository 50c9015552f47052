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
from typing import NamedTuple

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Rngs
from sins_env.motion import Motion
from sins_env.trajectory import car
from sins_env.trajectory.car import Event
from sins_env.trajectory.suspension import Input, Modes
from sins_env.types import NavState, Site
from sins_env.units import DEG

#: Gauss-Legendre nodes in an IMU sample, or in each 10 ms of a longer one; tests measure the error that is left.
_NODES = 2
_BLOCK = 6_000  #: instants that exist at once, over all runs
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
        self._lever = np.array(car.LEVER_M)[:, None, None]
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
        t = (samples[:, None] * (self.epoch_s / self.n_sub) + self._nodes).ravel()
        runs = len(self._heading)
        increments = np.empty((2, runs, len(samples), 3))
        size = max(1, _BLOCK // len(t))
        for begin in range(0, runs, size):
            rows = slice(begin, min(begin + size, runs))
            both = self._rate_and_force(self._instants(t, rows), rows)
            both = np.matmul(both.reshape(*both.shape[:3], len(samples), -1), self._weights)
            increments[:, rows] = both.transpose(0, 2, 3, 1)
        ends = np.arange(first_epoch + 1, first_epoch + num_epochs + 1, dtype=np.float64) * self.epoch_s
        dtheta, dvel = increments.reshape(2, runs, num_epochs, self.n_sub, 3)
        return Motion(dtheta, dvel, *self.states(ends))

    def _instants(self, t: Array, rows: slice = slice(None)) -> _Instants:
        q = self._modes.response(t, rows)
        angles = q[:, :3]
        angles[:, 2] += q[:, 3]
        angles[0, 1:] += self._parked[rows].T[..., None]
        shift = np.stack([-car.UPPER_AXIS_M * q[:, 3], q[:, 5], q[:, 4]], axis=1)
        heading, pitch, roll = angles[0]
        # C_nb = C_n^c(phi)' of phi = (pitch, roll, -heading)
        C, sine, cosine = attitude.misalignment_rows(np.stack([pitch, roll, -heading]))
        rate = np.stack(attitude.body_rate_planes(sine[:2], cosine[:2], angles[1]))
        swung = attitude.cross_planes(rate, self._lever)
        return _Instants(angles, sine, cosine, shift, C, rate, swung, shift[1] + _turned_back(C, swung))

    def _rate_and_force(self, at: _Instants, rows: slice) -> Array:
        """Return omega_ib^b and f^b, (2, 3, rows, times)."""
        spin, carry = (np.moveaxis(part[rows], 0, -1)[..., None] for part in (self._spin, self._carry))
        force = at.shift[2] + attitude.cross_planes(2 * spin, at.vel)
        force[2] += self._gravity
        out = np.empty((2, *force.shape))
        out[0] = at.rate + _turned(at.C, spin + _turned(carry, at.vel))
        swinging = attitude.cross_planes(_body_acceleration(at), self._lever) + attitude.cross_planes(at.rate, at.swung)
        np.add(_turned(at.C, force), swinging, out=out[1])
        return out

    def states(self, t: Array) -> tuple[NavState, Array]:
        """Return the true states (runs, len(t), ...) and omega_eb^b."""
        at = self._instants(t)
        rest = attitude.to_dcm(attitude.from_euler(np.zeros(len(self._parked)), *self._parked.T)) @ self._lever[:, 0, 0]
        offset = at.shift[0] + _turned_back(at.C, self._lever) - rest.T[..., None]
        heading, pitch, roll = at.angles[0]
        rate_eb_b = at.rate + _turned(at.C, _turned(np.moveaxis(self._carry, 0, -1)[..., None], at.vel))
        vel, offset, rate_eb_b = (np.moveaxis(part, 0, -1) for part in (at.vel, offset, rate_eb_b))
        vel, offset = np.matmul(vel, self._turn), np.matmul(offset, self._turn)
        q_nb = attitude.from_euler(self._heading[:, None] + heading, pitch, roll)
        return NavState(q_nb, vel, earth.displace(self._earth, self.site.pos, offset)), rate_eb_b


class _Instants(NamedTuple):
    """The motion at some instants, in the axes of the mean heading.

    Components stand in front, because NumPy is fast along the long axes (..., rows, times).
    """

    angles: Array  #: (3, 3, ...) heading about its mean, pitch, roll; then their rates, then their accelerations
    sine: Array  #: (3, ...) sines of pitch, roll, minus heading
    cosine: Array  #: (3, ...) cosines of the same
    shift: Array  #: (3, 3, ...) position of the reference point, m, and its first two derivatives
    C: Array  #: (3, 3, ...) rotation from these axes into the body
    rate: Array  #: (3, ...) omega_nb^b
    swung: Array  #: (3, ...) omega_nb^b x lever arm
    vel: Array  #: (3, ...) velocity of the IMU


def _turned(C: Array, v: Array) -> Array:
    """Return C v of C (3, 3, ...) and v (3, ...)."""
    return np.add.reduce(C * v, axis=1)


def _turned_back(C: Array, v: Array) -> Array:
    """Return C' v of the same shapes."""
    return np.add.reduce(C * v[:, None], axis=0)


def _body_acceleration(at: _Instants) -> Array:
    """Return the derivative of attitude.body_rate, (3, ...)."""
    (sp, sr), (cp, cr) = at.sine[:2], at.cosine[:2]
    dh, dp, dr = at.angles[1]
    out = np.stack(attitude.body_rate_planes(at.sine[:2], at.cosine[:2], at.angles[2]))
    out[0] += dh * (dr * cr * cp - dp * sr * sp) - dp * dr * sr
    out[1] -= dh * dp * cp
    out[2] += dh * (dr * sr * cp + dp * cr * sp) + dp * dr * cr
    return out
