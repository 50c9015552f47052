"""Inertial sensors: their errors, added to exact increments.

Each run draws from streams of its own. Its errors therefore depend neither on its neighbours nor on the chunks in which
they are generated. The loop over runs at the draw is the only one.
See docs/mathematics/simulation.md#inertial-sensors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sins_env.arrays import Array, Rngs
from sins_env.kernels import helper, kernel
from sins_env.kernels.algebra import add, matrix, put_row, put_vector, row, scale, turn, vector
from sins_env.specs import ImuSpec
from sins_env.units import ARCSEC, DEG_PER_H, PPM, UG


def standard_normal(rngs: Rngs, shape: tuple[int, ...]) -> Array:
    """Draw standard normal numbers (runs, *shape), those of a run from its own generator."""
    out = np.empty((len(rngs), *shape))
    for rng, numbers in zip(rngs, out, strict=True):
        rng.standard_normal(out=numbers)
    return out


class GaussMarkov:
    """A first-order Gauss-Markov bias, discretised exactly. 000 (2.5.6) to (2.5.8).

    The next sample is x' = a x + eta with a = exp(-dt / T) and var eta = s^2 (1 - a^2). Here s is the stationary standard
    deviation ``sigma`` and T the correlation time.
    """

    def __init__(self, sigma: float, time_constant_s: float, dt: float) -> None:
        self.sigma = sigma
        self._a = math.exp(-dt / time_constant_s)
        self._drive = sigma * math.sqrt(-math.expm1(-2 * dt / time_constant_s))

    def reset(self, rngs: Rngs) -> None:
        """Begin one run per generator, with a bias drawn from the stationary distribution."""
        self._rngs = rngs
        self._x = self.sigma * standard_normal(rngs, (3,))  # starts in its stationary state

    def samples(self, count: int) -> Array:
        """Return the bias during each of the next ``count`` samples, (runs, count, 3)."""
        out: Array
        out, self._x = _markov(standard_normal(self._rngs, (count, 3)), self._x, self._a, self._drive)
        return out


@kernel("(n,3),(3),(),()->(n,3),(3)")
def _markov(unit: Array, x: Array, a: float, drive: float, out: Array, last: Array) -> None:
    """Return the samples of a Gauss-Markov bias that begins with x, and the sample that follows them."""
    b = vector(x)
    for i in range(len(unit)):
        put_row(b, out, i)
        b = add(scale(drive, row(unit, i)), scale(a, b))
    put_vector(b, last)


@dataclass(frozen=True)
class Wave:
    """A wave cos(rate t + phase) that the density of white noise follows; the specified density is its amplitude."""

    rate: float  #: rad/s
    phase: float = 0.0  #: rad

    def rms(self, first: int, count: int, dt: float) -> Array:
        """Return the root mean square of the wave over each of ``count`` samples of ``dt`` s from ``first`` on, (count,)."""
        middles = (first + 0.5 + np.arange(count)) * dt
        return np.sqrt(0.5 * (1.0 + np.sinc(self.rate * dt / np.pi) * np.cos(2.0 * (self.rate * middles + self.phase))))


@dataclass(frozen=True)
class Script:
    """Departures of a scenario's true sensors from their specification."""

    fixed_bias: bool = False  #: whether all biases are + 1 sigma in every run
    gyro_mean_deg_h: float = 0.0  #: added to the gyro bias
    accel_mean_ug: float = 0.0  #: added to the accelerometer bias
    gyro_wave: Wave | None = None  #: course of the density of the gyros' white noise
    accel_wave: Wave | None = None  #: course of the density of the accelerometers' white noise


class _Triad:
    """Three equal sensors: out = (I + M) true + (bias + Markov bias) dt + white noise, then whole pulses.

    M holds scale factors on its diagonal and misaligned axes beside it.
    """

    def __init__(
        self,
        bias: float,
        white: float,
        markov: GaussMarkov | None,
        coupling: tuple[float, float],
        lsb: float,
        dt: float,
        script: tuple[bool, float, Wave | None],
    ) -> None:
        self.bias_sigma, self.white, self.markov, self.lsb, self.dt = bias, white, markov, lsb, dt
        self._scale, self._misalignment = coupling
        self._fixed_bias, self._mean, self._wave = script

    _absent = np.empty((0, 3))  #: what an error that the sensors do not have gives to the sum

    def reset(self, fixed: Rngs, noise: Rngs, markov: Rngs) -> None:
        self._noise, self._count = noise, 0
        draws = standard_normal(fixed, (12,))
        self.bias = self.bias_sigma * (np.ones_like(draws) if self._fixed_bias else draws)[:, :3]  # (runs, 3)
        self.bias += self._mean
        sigma = np.where(np.eye(3, dtype=bool), self._scale, self._misalignment)
        coupling = sigma * draws[:, 3:].reshape(-1, 3, 3)
        self._coupling = coupling if sigma.any() else self._absent
        self._residual = np.zeros((len(noise), 3))
        if self.markov:
            self.markov.reset(markov)

    def measure(self, true: Array) -> Array:
        """Return the measured increments of true ones, (runs, epochs, n_sub, 3)."""
        runs, epochs, n_sub, _ = true.shape
        count = epochs * n_sub
        density = np.full(count, self.white * math.sqrt(self.dt))
        if self._wave:
            density *= self._wave.rms(self._count, count, self.dt)
        self._count += count
        noise = standard_normal(self._noise, (count, 3))
        markov = self.markov.samples(count) if self.markov else self._absent
        out, self._residual = _measured(
            true.reshape(runs, count, 3),
            noise,
            density,
            self.bias,
            markov,
            self._coupling,
            self._residual,
            self.dt,
            self.lsb,
        )
        return out.reshape(runs, epochs, n_sub, 3)


@kernel("(n,3),(n,3),(n),(3),(m,3),(k,3),(3),(),()->(n,3),(3)")
def _measured(
    true: Array,
    noise: Array,
    density: Array,
    bias: Array,
    markov: Array,
    coupling: Array,
    rest: Array,
    dt: float,
    lsb: float,
    out: Array,
    last: Array,
) -> None:
    """Return measured increments.

    Args:
        true: true increments.
        noise: standard normal numbers.
        density: standard deviations of the white noise.
        bias: constant biases.
        markov: Markov biases of the samples; no rows without them.
        coupling: the matrix M; no rows without it.
        rest: what is left of a pulse.
        dt: length of a sample, s.
        lsb: size of a pulse; 0 without whole pulses.
        last: what is left of a pulse after the last sample.
    """
    shift = scale(dt, vector(bias))
    for i in range(len(true)):
        put_row(add(add(scale(density[i], row(noise, i)), shift), row(true, i)), out, i)
    for i in range(len(markov)):
        put_row(add(row(out, i), scale(dt, row(markov, i))), out, i)
    if len(coupling):
        M = matrix(coupling)
        for i in range(len(true)):
            put_row(add(row(out, i), turn(M, row(true, i))), out, i)
    put_vector(vector(rest), last)
    if lsb > 0.0:
        _quantise(out, last, lsb)


@helper
def _quantise(out: Array, rest: Array, lsb: float) -> None:
    """Round to whole pulses; the rest of a pulse is carried to the next sample, like that of a counter."""
    for axis in range(3):
        total, before = rest[axis], 0.0
        for i in range(len(out)):
            total += out[i, axis]
            pulses = np.rint(total / lsb)
            out[i, axis] = lsb * (pulses - before)
            before = pulses
        rest[axis] = total - lsb * before


class Imu:
    """A batch of inertial measurement units with these errors, sampled every ``dt`` seconds."""

    def __init__(self, spec: ImuSpec, dt: float, script: Script | None = None) -> None:
        self.spec = spec
        self.script = script = script or Script()
        coupling = (spec.scale_ppm * PPM, spec.misalignment_arcsec * ARCSEC)
        gyro_markov = GaussMarkov(spec.gyro_markov_deg_h * DEG_PER_H, spec.gyro_markov_s, dt)
        accel_markov = GaussMarkov(spec.accel_markov_ug * UG, spec.accel_markov_s, dt)
        self.gyro = _Triad(
            spec.gyro_bias_deg_h * DEG_PER_H,
            spec.arw,
            gyro_markov if spec.gyro_markov_deg_h else None,
            coupling,
            spec.gyro_lsb_arcsec * ARCSEC,
            dt,
            (script.fixed_bias, script.gyro_mean_deg_h * DEG_PER_H, script.gyro_wave),
        )
        self.accel = _Triad(
            spec.accel_bias_ug * UG,
            spec.vrw,
            accel_markov if spec.accel_markov_ug else None,
            coupling,
            spec.accel_lsb_mps,
            dt,
            (script.fixed_bias, script.accel_mean_ug * UG, script.accel_wave),
        )

    def reset(self, streams: Sequence[Rngs]) -> None:
        """Begin the runs. ``streams`` holds six generators for each.

        Three are for the gyros, for fixed errors, noise and Markov biases, and then three for the accelerometers.
        """
        columns = list(zip(*streams, strict=True))
        self.gyro.reset(*columns[:3])
        self.accel.reset(*columns[3:])

    def measure(self, dtheta: Array, dvel: Array) -> tuple[Array, Array]:
        """Return the measured increments of exact ones, rad and m/s, each (runs, epochs, n_sub, 3)."""
        return self.gyro.measure(dtheta), self.accel.measure(dvel)
