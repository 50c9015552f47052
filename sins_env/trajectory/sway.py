"""A swaying base: sinusoids in heading, pitch, roll and in the three velocities, those of 000 section 2.5.1 or one's own.

The attitude about the mean heading is the same in every run. What differs between runs, the mean heading and the phases
of the linear sway, enters rate and specific force linearly. With g_k(t) the functions 1, cos(w t), sin(w t) of the
oscillators, and C_0(t) the attitude about the mean heading, the increments of all runs are

    integral of C_0'(t) r(t) dt  =  sum over k of  [integral of C_0'(t) g_k(t) dt]  r_k(run),

one small matrix product per run, which is left to BLAS. The integrals are Gauss-Legendre sums, exact to rounding. With
``random=True``, or with angles whose phases are drawn, the attitude differs between runs, and each has its own integrals.

The specific force omits the Coriolis term of the base's own transport rate, omega_en x V. It is 2e-10 m/s^2 in the thesis,
and 2e-7 m/s^2 at 1 m/s.
See docs/mathematics/simulation.md#sway.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import zip_longest

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Rngs
from sins_env.attitude import body_rate_planes
from sins_env.earth import displaced
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import (
    Vector,
    add,
    correction,
    matrix,
    misaligned,
    put_quaternion,
    put_vector,
    row,
    scale,
    sincos3,
    times,
    to_dcm,
    transpose,
    turn,
    vector,
)
from sins_env.kernels.trigonometry import sincos
from sins_env.motion import Motion
from sins_env.trajectory.oscillations import AXES, THESIS, TURNS, WAYS, Component, SwayMotion
from sins_env.types import NavState, Site
from sins_env.units import DEG, G0

_SLOW = 12.0  # rad/s, above the sums of the sway's frequencies and of their doubles

VIBRATION_ACCEL = np.array([4.8, 3.8, 4.0]) * G0  #: amplitudes of 000 (2.5.5) in the order E, N, U, m/s^2
VIBRATION_HZ = np.array([300.0, 250.0, 400.0])  #: frequencies of 000 (2.5.5) in the same order

_BLOCK = 1 << 20  #: values of g_k that exist at once: 8 MiB, with a few times as much around them


class Sway:
    """A batch of swaying bases.

    Args:
        site: place and earth model.
        epoch_s: length of an epoch, s.
        n_sub: IMU samples in an epoch.
        motion: amplitudes, periods and phases of the sway.
        heading_deg: mean heading of every run; None draws it over the circle in each run.
        vibration: whether the vibration of 000 (2.5.5) is added.
        random: whether each run scales the amplitudes by 0.5 to 1.5 and the periods by 0.7 to 1.4, and draws the phases
            of the attitude as well. Further components of the motion stay as they are.
    """

    def __init__(
        self,
        site: Site,
        epoch_s: float,
        n_sub: int,
        motion: SwayMotion = THESIS,
        heading_deg: float | None = 30.0,
        vibration: bool = False,
        random: bool = False,
    ) -> None:
        self.site, self.epoch_s, self.n_sub = site, epoch_s, n_sub
        self.motion, self.heading_deg, self.vibration, self.random = motion, heading_deg, vibration, random
        model = earth.get(site.earth)
        self._earth = model
        self._gravity = float(earth.gravity(model, site.latitude, site.height))
        self._rate_ie = earth.rate_n(model, site.latitude)
        self._transport = earth.transport_matrix(model, site.latitude, site.height)
        self._nodes, self._weights = np.polynomial.legendre.leggauss(
            _node_count(0.5 * epoch_s / n_sub, vibration, motion.components)
        )

    def reset(self, rngs: Rngs, heading: Array | None = None) -> NavState:
        """Draw one motion per generator, and return the true states at t = 0, (runs, ...).

        ``heading`` (runs,), rad, gives the mean headings and overrides ``heading_deg``.
        """
        further = [one for ones in self.motion.components.values() for one in ones]
        drawn = sum(one.phase_deg is None for one in further)
        draws = np.stack(
            [rng.random(22 + drawn) for rng in rngs]
        )  # one layout whatever the options: streams stay comparable
        runs = len(rngs)
        mean = 2 * np.pi * draws[:, 0] if self.heading_deg is None else np.full(runs, self.heading_deg * DEG)
        self._heading = mean if heading is None else heading
        turns = (self.motion.heading, self.motion.pitch, self.motion.roll)
        amplitude = np.array([o.amplitude for o in turns])
        omega = 2 * np.pi / np.array([o.period_s for o in turns])
        phase = np.array([o.phase for o in turns])
        sway, sway_omega = np.array(self.motion.sway_m), 2 * np.pi / np.array(self.motion.sway_period_s)
        if self.random:
            amplitude = amplitude * (0.5 + draws[:, 7:10])
            omega = omega / (0.7 + 0.7 * draws[:, 10:13])
            phase = 2 * np.pi * draws[:, 13:16]
            sway = sway * (0.5 + draws[:, 16:19])
            sway_omega = sway_omega / (0.7 + 0.7 * draws[:, 19:22])
        free = iter(2 * np.pi * draws[:, 22:].T)
        own = {name: [(one, _phase(one, free)) for one in self.motion.components.get(name, ())] for name in AXES}
        groups = [np.stack(np.broadcast_arrays(amplitude, omega, phase), axis=-2)]
        groups += map(_turns, zip_longest(*(own[name] for name in TURNS)))
        #: amplitudes, frequencies and phases of heading, pitch, roll, (c, 3, 3) or (runs, c, 3, 3)
        self._turn = np.stack(np.broadcast_arrays(*groups), axis=-3)
        omegas, speeds, phases = [sway_omega], [sway * sway_omega], [2 * np.pi * draws[:, 1:4]]
        if self.vibration:
            vibration_omega = np.broadcast_to(2 * np.pi * VIBRATION_HZ, sway_omega.shape)
            omegas.append(vibration_omega)
            speeds.append(VIBRATION_ACCEL / vibration_omega)
            phases.append(2 * np.pi * draws[:, 4:7])
        for name, along in zip(WAYS, _directions(self._heading), strict=True):
            for one, angle in own[name]:
                omegas.append(np.full(sway_omega.shape, one.omega))
                speeds.append(one.amplitude * one.omega * along)
                phases.append(np.broadcast_to(np.asarray(angle)[..., None] + np.pi / 2, (runs, 3)))  # of the speed
        self._omega = np.concatenate(omegas, axis=-1)  # (J,) or (runs, J), oscillator j moves along axis j % 3
        self._speed = np.concatenate(np.broadcast_arrays(*speeds), axis=-1)  # likewise
        self._phase = np.concatenate(phases, axis=-1)  # (runs, J)
        self._differs = self._turn.ndim > 3  # whether the attitude about the mean heading differs between runs
        if self._differs:
            self._omega = np.broadcast_to(self._omega, self._phase.shape)
        self._coefficients = self._expand()
        state, _ = self.states(np.zeros(1))
        return NavState(*(part[:, 0] for part in state))

    def chunk(self, first_epoch: int, num_epochs: int) -> Motion:
        """Return the motion in epochs first_epoch + 1 ... first_epoch + num_epochs."""
        edges = np.arange(first_epoch * self.n_sub, (first_epoch + num_epochs) * self.n_sub + 1, dtype=np.float64)
        edges *= self.epoch_s / self.n_sub
        shape = (len(self._heading), num_epochs, self.n_sub, 3)
        if not self._differs:
            dtheta, dvel = self._increments(slice(None), edges)
        else:  # each run has integrals of its own: in blocks, since they are many times as large as the increments
            dtheta, dvel = np.empty((2, len(self._heading), 3 * (len(edges) - 1)))
            num_functions = 1 + 2 * self._phase.shape[1]
            size = max(1, _BLOCK // (len(edges) * len(self._nodes) * num_functions))
            for begin in range(0, len(dtheta), size):
                runs = slice(begin, begin + size)
                dtheta[runs], dvel[runs] = self._increments(runs, edges)
        state, rate = self.states(
            np.arange(first_epoch + 1, first_epoch + num_epochs + 1, dtype=np.float64) * self.epoch_s
        )
        return Motion(dtheta.reshape(shape), dvel.reshape(shape), state, rate)

    def _increments(self, runs: slice, edges: Array) -> tuple[Array, Array]:
        """Return the increments of angle and velocity of these runs in each IMU sample, each (runs, samples * 3)."""
        table, turning = self._integrals(runs, edges)
        increments = np.matmul(self._coefficients[runs], table)  # (runs, 2, samples * 3)
        return increments[:, 0] + turning, increments[:, 1]

    def _expand(self) -> Array:
        """Return the coefficients of rate and specific force on the functions g_k, (runs, 2, 3 K).

        Their axes are those of the mean heading.
        """
        runs, J = self._phase.shape
        K = 1 + 2 * J
        speed, omega = np.broadcast_to(self._speed, (runs, J)), np.broadcast_to(self._omega, (runs, J))
        c, s = speed * np.cos(self._phase), speed * np.sin(self._phase)
        vel, accel = np.zeros((runs, 3, K)), np.zeros((runs, 3, K))
        for j in range(J):  # V = v cos(wt + p) = v cos p cos wt - v sin p sin wt
            vel[:, j % 3, 1 + 2 * j], vel[:, j % 3, 2 + 2 * j] = c[:, j], -s[:, j]
            accel[:, j % 3, 1 + 2 * j], accel[:, j % 3, 2 + 2 * j] = -omega[:, j] * s[:, j], -omega[:, j] * c[:, j]
        rate = self._transport @ vel
        rate[:, :, 0] += self._rate_ie
        force = accel + attitude.skew(2 * self._rate_ie) @ vel
        force[:, 2, 0] += self._gravity
        c, s = np.cos(self._heading), np.sin(self._heading)
        turn = np.zeros((runs, 3, 3))  # n into the axes of the mean heading
        turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = c, -s, s, c, 1.0
        return np.stack([turn @ rate, turn @ force], axis=1).reshape(runs, 2, 3 * K)

    def _integrals(self, runs: slice, edges: Array) -> tuple[Array, Array]:
        """Integrate C_0' g_k, ([runs,] 3 K, samples * 3), and omega_nb^b, ([runs,] samples * 3), over each IMU sample."""
        half = 0.5 * self.epoch_s / self.n_sub
        omega = np.repeat(self._of(runs, self._omega), 2, axis=-1)
        omega = np.concatenate([np.zeros((*omega.shape[:-1], 1)), omega], axis=-1)
        table, turning = _integrated(
            self._of(runs, self._turn), omega, edges[:-1] + half, half * self._nodes, half * self._weights
        )
        return table.reshape(*table.shape[:-4], 3 * omega.shape[-1], -1), turning.reshape(*turning.shape[:-2], -1)

    def _of(self, runs: slice, part: Array) -> Array:
        """Return the rows of these runs, or all of ``part`` if the runs share it."""
        return part[runs] if self._differs else part

    def earlier(self, after: NavState, t: Array, age: Array) -> tuple[NavState, Array]:
        """Return the true states (runs, len(t), ...) and omega_eb^b at the times t - age."""
        return self.states(t - age)

    def states(self, t: Array) -> tuple[NavState, Array]:
        """Return the true states (runs, len(t), ...) and omega_eb^b."""
        omega, speed, phase = (
            part.reshape(*part.shape[:-1], 1, -1, 3) for part in (self._omega, self._speed, self._phase)
        )
        *state, rate_eb_b = _state(
            self._turn[..., None, :, :, :],
            self._heading[:, None],
            omega,
            speed,
            phase,
            self._transport,
            self.site.pos,
            np.array(earth.radii(self._earth, self.site.latitude)),
            t,
        )
        return NavState(*state), rate_eb_b


def _phase(one: Component, free: Iterator[Array]) -> float | Array:
    """Return the phase of a component, rad; one that is drawn is taken from ``free``, (runs,)."""
    return next(free) if one.phase_deg is None else one.phase_deg * DEG


def _turns(group: tuple[tuple[Component, float | Array] | None, ...]) -> Array:
    """Return amplitudes, frequencies and phases of one component of heading, pitch and roll each, (3, 3) or (runs, 3, 3)."""
    amplitude = [one[0].amplitude * DEG if one else 0.0 for one in group]
    omega = [one[0].omega if one else 1.0 for one in group]
    phase = np.stack(np.broadcast_arrays(*(one[1] if one else 0.0 for one in group)), axis=-1)
    return np.stack(np.broadcast_arrays(amplitude, omega, phase), axis=-2)


def _directions(heading: Array) -> tuple[Array, Array, Array]:
    """Return the unit vectors forward, to the right and up at mean headings (runs,), each (runs, 3) E, N, U."""
    c, s, zero = np.cos(heading), np.sin(heading), np.zeros_like(heading)
    return (
        np.stack([s, c, zero], axis=-1),
        np.stack([c, -s, zero], axis=-1),
        np.stack([zero, zero, zero + 1.0], axis=-1),
    )


@helper
def _angles(amplitude: Vector, omega: Vector, phase: Vector, t: float) -> tuple[Vector, Vector]:
    """Return what a component adds to heading, pitch and roll at time t, and to their rates."""
    s, c = sincos3(add(scale(t, omega), phase))
    return (
        times(amplitude, c),
        times(times(scale(-1.0, amplitude), omega), s),
    )


@kernel("(c,3,3),(k),(m),(p),(p)->(3,k,m,3),(m,3)")
def _integrated(
    oscillation: Array, omega: Array, t: Array, nodes: Array, weights: Array, table: Array, turning: Array
) -> None:
    """Integrate C_0' g_k and omega_nb^b over samples.

    Args:
        oscillation: amplitudes, frequencies and phases of heading, pitch, roll in each component.
        omega: frequencies of the functions g_k, which are 1, and then a cosine and a sine of each frequency.
        t: middles of the samples, s.
        nodes: nodes of the integrals about the middle of a sample, s.
        weights: weights of the nodes, s.
        table: integrals by axis of C_0, function, sample and axis of the body.
        turning: integrals of omega_nb^b.
    """
    samples, K = len(t), len(omega)
    C, rate, g = np.empty((9, samples)), np.empty((3, samples)), np.ones((K, samples))
    angle, spin = np.empty((3, samples)), np.empty((3, samples))
    at, sums, turned = np.empty(samples), np.zeros((9 * K, samples)), np.zeros((3, samples))
    for p in range(len(nodes)):
        for i in range(samples):
            at[i] = t[i] + nodes[p]
        angle[:], spin[:] = 0.0, 0.0
        for j in range(len(oscillation)):
            part = oscillation[j]
            for i in range(samples):
                angles, rates = _angles(row(part, 0), row(part, 1), row(part, 2), at[i])
                angle[0, i], angle[1, i], angle[2, i] = add((angle[0, i], angle[1, i], angle[2, i]), angles)
                spin[0, i], spin[1, i], spin[2, i] = add((spin[0, i], spin[1, i], spin[2, i]), rates)
        for i in range(samples):
            rates = spin[0, i], spin[1, i], spin[2, i]
            s, c = sincos3((angle[1, i], angle[2, i], -angle[0, i]))
            # C_0' = C_n^c(phi) of phi = (pitch, roll, -heading)
            C[0, i], C[1, i], C[2, i], C[3, i], C[4, i], C[5, i], C[6, i], C[7, i], C[8, i] = misaligned(s, c)
            rate[0, i], rate[1, i], rate[2, i] = body_rate_planes((s[0], s[1]), (c[0], c[1]), rates)
        for k in range(1, K, 2):
            w = omega[k]
            for i in range(samples):
                g[k + 1, i], g[k, i] = sincos(w * at[i])
        weight = weights[p]
        for axis in range(9):
            for k in range(K):
                for i in range(samples):
                    sums[axis * K + k, i] += weight * C[axis, i] * g[k, i]
        for axis in range(3):
            for i in range(samples):
                turned[axis, i] += weight * rate[axis, i]
    for i in range(samples):
        for b in range(3):
            turning[i, b] = turned[b, i]
            for n in range(3):
                for k in range(K):
                    table[n, k, i, b] = sums[(3 * b + n) * K + k, i]


@kernel("(c,3,3),(),(j,3),(j,3),(j,3),(3,3),(3),(2),()->(4),(3),(3),(3)")
def _state(
    oscillation: Array,
    heading: float,
    omega: Array,
    speed: Array,
    phase: Array,
    transport: Array,
    place: Array,
    radii: Array,
    t: float,
    q_nb: Array,
    vel: Array,
    pos: Array,
    rate_eb_b: Array,
) -> None:
    """Return attitude, velocity, position and omega_eb^b at time t.

    Args:
        oscillation: amplitudes, frequencies and phases of heading, pitch, roll in each component.
        heading: mean heading, rad.
        omega: frequencies of the linear sway along E, N, U, and then of the vibration, rad/s.
        speed: amplitudes of its velocity, m/s.
        phase: its phases, rad.
        transport: matrix of the transport rate.
        place: mean position.
        radii: radii of curvature there, m.
        t: time, s.
    """
    angles, rates = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(len(oscillation)):
        turned, turning = _angles(row(oscillation[i], 0), row(oscillation[i], 1), row(oscillation[i], 2), t)
        angles, rates = add(angles, turned), add(rates, turning)
    q = correction((angles[1], angles[2], -(angles[0] + heading)))
    s, c = sincos3((angles[1], angles[2], 0.0))
    here, v, metres = vector(place), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for j in range(len(omega)):
        w, size, p = row(omega, j), row(speed, j), row(phase, j)
        sine, cosine = sincos3(add(scale(t, w), p))
        v = add(v, times(size, cosine))
        metres = add(metres, times((size[0] / w[0], size[1] / w[1], size[2] / w[2]), sine))
    put_quaternion(q, q_nb)
    put_vector(v, vel)
    put_vector(displaced(here, here, metres, radii[0], radii[1]), pos)
    carried = turn(transpose(to_dcm(q)), turn(matrix(transport), v))
    put_vector(add(body_rate_planes((s[0], s[1]), (c[0], c[1]), rates), carried), rate_eb_b)


def _node_count(half: float, vibration: bool, components: Mapping[str, tuple[Component, ...]]) -> int:
    """Return how many Gauss-Legendre nodes integrate the fastest oscillation over a sample of 2 ``half`` s to rounding.

    For exp(i k x) over (-1, 1) the error falls as (e k / 4n)^(2n). With too few nodes vibration would alias. The sine of an
    angle has harmonics up to its greatest rate.
    """
    own = 0.0
    for axis, ones in components.items():
        fastest = max((one.omega for one in ones), default=0.0)
        rates = sum(one.amplitude * DEG * one.omega for one in ones) if axis in TURNS else 0.0
        own += 4.0 * (fastest + rates) if axis in TURNS else fastest
    k = half * (max(_SLOW, own) + 2 * np.pi * (float(VIBRATION_HZ.max()) if vibration else 0.0))
    nodes = 5
    while 2 * nodes * math.log(math.e * k / (4 * nodes)) > math.log(1e-16):
        nodes += 1
    return nodes
