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
from sins_env.specs import ImuSpec
from sins_env.units import ARCSEC, DEG_PER_H, PPM, UG


def standard_normal(rngs: Rngs, shape: tuple[int, ...]) -> Array:
    """Draw standard normal numbers (runs, *shape), those of a run from its own generator."""
    out = np.empty((len(rngs), *shape))
    for rng, row in zip(rngs, out, strict=True):
        rng.standard_normal(out=row)
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
        eta = standard_normal(self._rngs, (count, 3))
        eta *= self._drive
        from scipy.signal import lfilter  # a second of import time, needed by Gauss-Markov biases only

        y, _ = lfilter([1.0], [1.0, -self._a], eta, axis=1, zi=self._a * self._x[:, None])
        out = np.concatenate([self._x[:, None], y[:, :-1]], axis=1)
        self._x = y[:, -1]
        return out


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

    def reset(self, fixed: Rngs, noise: Rngs, markov: Rngs) -> None:
        self._noise, self._count = noise, 0
        draws = standard_normal(fixed, (12,))
        self.bias = self.bias_sigma * (np.ones_like(draws) if self._fixed_bias else draws)[:, :3]  # (runs, 3)
        self.bias += self._mean
        sigma = np.where(np.eye(3, dtype=bool), self._scale, self._misalignment)
        coupling = sigma * draws[:, 3:].reshape(-1, 3, 3)
        self._coupling = coupling if sigma.any() else None
        self._residual = np.zeros((len(noise), 1, 3))
        if self.markov:
            self.markov.reset(markov)

    def measure(self, true: Array) -> Array:
        """Return the measured increments of true ones, (runs, epochs, n_sub, 3)."""
        runs, epochs, n_sub, _ = true.shape
        shape = (epochs * n_sub, 3)
        out = standard_normal(self._noise, shape)
        out *= self.white * math.sqrt(self.dt)
        if self._wave:
            out *= self._wave.rms(self._count, shape[0], self.dt)[:, None]
        self._count += shape[0]
        out += (self.bias * self.dt)[:, None]
        true = true.reshape(runs, *shape)
        out += true
        if self.markov:
            out += self.dt * self.markov.samples(shape[0])
        if self._coupling is not None:
            out += np.matmul(true, np.swapaxes(self._coupling, -1, -2))
        if self.lsb:
            out = self._quantise(out)
        return out.reshape(runs, epochs, n_sub, 3)

    def _quantise(self, increments: Array) -> Array:
        """Round to whole pulses; the rest of a pulse is carried to the next sample, like that of a counter."""
        total = np.cumsum(np.concatenate([self._residual, increments], axis=1), axis=1)
        pulses = np.rint(total[:, 1:] / self.lsb)
        self._residual = total[:, -1:] - self.lsb * pulses[:, -1:]
        return self.lsb * np.diff(pulses, axis=1, prepend=0.0)


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
