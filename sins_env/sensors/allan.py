"""Allan deviation: the noise of a sensor against the averaging time, measured and expected from a datasheet.

Increments are integrals of a rate, and the Allan deviation is made of the second differences of their running sum.
The source is IEEE Std 952-1997, annex C. All deviations are in rad/s or m/s^2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.specs import ImuSpec
from sins_env.units import ARCSEC, DEG_PER_H, UG

PER_DECADE = 10  #: averaging times per decade
_HARMONICS = np.arange(1.0, 401.0)  #: harmonics of the rounding error; those left out hold 0.15 % of its variance


class Allan(NamedTuple):
    """Allan deviations at T averaging times."""

    tau: Array  #: (T,) averaging times, s
    adev: Array  #: (..., T, n) Allan deviations, rad/s or m/s^2
    standard_error: Array  #: (..., T, n) 1 sigma of ``adev``, in the same unit


def allan_deviation(increments: Array, dt: float, taus: Array | None = None) -> Allan:
    """Compute the overlapping Allan deviation of increments (..., N, n), rad or m/s, over samples of ``dt`` seconds.

    ``taus`` (T,), s, are rounded to whole samples. None takes ten per decade up to an eighth of the record. The standard
    error has the degrees of freedom of white noise or of a random walk of the rate, whichever are fewer (Riley, NIST SP
    1065, table 5). It is therefore not too small for noise in between.

    Raises:
        ValueError: fewer than nine samples, or an averaging time beyond half of the record.
    """
    count = increments.shape[-2]
    if count < 9:
        raise ValueError(f"{count} samples; allowed: at least 9 for an Allan deviation")
    if taus is None:
        decades = np.log10(count / 8)
        taus = dt * np.logspace(0.0, decades, 1 + int(PER_DECADE * decades))
    m = np.unique(np.maximum(np.rint(np.asarray(taus) / dt).astype(np.int64), 1))
    if 2 * m[-1] > count:
        raise ValueError(f"averaging time {m[-1] * dt:g} s; allowed: up to half the record, {count * dt / 2:g} s")
    total = np.zeros((*increments.shape[:-2], count + 1, increments.shape[-1]))
    np.cumsum(increments, axis=-2, out=total[..., 1:, :])
    adev = np.empty((*increments.shape[:-2], len(m), increments.shape[-1]))
    for i, k in enumerate(m):
        second = total[..., 2 * k :, :] - 2.0 * total[..., k:-k, :] + total[..., : -2 * k, :]
        adev[..., i, :] = np.sqrt(np.mean(second * second, axis=-2) / 2.0) / (k * dt)
    relative = 1.0 / np.sqrt(2.0 * _degrees_of_freedom(count + 1, m))
    return Allan(m * dt, adev, adev * relative[:, None])


def _degrees_of_freedom(points: int, m: NDArray[np.int64]) -> Array:
    """Return the degrees of freedom of the overlapping estimator from ``points`` angles, at ``m`` samples each."""
    N = float(points)
    white = (1.5 * (N - 1) / m - 2 * (N - 2) / N) * 4.0 * m**2 / (4.0 * m**2 + 5)
    walk = (N - 2) / m * ((N - 1) ** 2 - 3.0 * m * (N - 1) + 4.0 * m**2) / (N - 3) ** 2
    return np.maximum(np.minimum(white, walk), 1.0)


class Budget(NamedTuple):
    """Allan deviations (T,) of the parts of a sensor's noise, rad/s or m/s^2."""

    white: Array
    markov: Array
    quantisation: Array

    @property
    def total(self) -> Array:
        """Allan deviation of all parts together, (T,)."""
        return np.sqrt(self.white**2 + self.markov**2 + self.quantisation**2)


def expected_allan(spec: ImuSpec, tau: Array, moving: bool = False) -> tuple[Budget, Budget]:
    """Return the Allan deviations expected of gyros, rad/s, and accelerometers, m/s^2, at ``tau`` (T,) s.

    With ``moving`` the input sweeps over many pulses per sample, so that rounding errors are independent.
    Otherwise the sensor rests, and only its own noise and bias shift the pulses.
    """
    return (
        Budget(
            white_noise(spec.arw, tau),
            gauss_markov(spec.gyro_markov_deg_h * DEG_PER_H, spec.gyro_markov_s, tau),
            quantisation(
                spec.gyro_lsb_arcsec * ARCSEC,
                tau,
                None if moving else (spec.arw, spec.gyro_bias_deg_h * DEG_PER_H),
            ),
        ),
        Budget(
            white_noise(spec.vrw, tau),
            gauss_markov(spec.accel_markov_ug * UG, spec.accel_markov_s, tau),
            quantisation(spec.accel_lsb_mps, tau, None if moving else (spec.vrw, spec.accel_bias_ug * UG)),
        ),
    )


def white_noise(density: float, tau: Array) -> Array:
    """Return N / sqrt(tau), the Allan deviation of white noise with the random-walk coefficient N: slope -1/2."""
    return density / np.sqrt(tau)


def gauss_markov(sigma: float, time_constant_s: float, tau: Array) -> Array:
    """Return the Allan deviation of a first-order Gauss-Markov rate with stationary ``sigma`` and correlation time T.

    It rises with sqrt(tau) and peaks at 1.89 T. The source is IEEE Std 952-1997, (C.16).
    """
    x = np.asarray(tau) / time_constant_s
    u = -np.expm1(-x)
    with np.errstate(divide="ignore", invalid="ignore"):
        bracket = 1.0 - u * (2.0 + u) / (2.0 * x)  # IEEE 952 (C.16): 3 - 4 exp(-x) + exp(-2x) = 2u + u^2
        variance = np.where(x < 1e-2, x * (2.0 / 3.0 - x / 2.0 + 7.0 * x**2 / 30.0), 2.0 * bracket / x)
    return sigma * np.sqrt(variance)


def quantisation(pulse: float, tau: Array, rest: tuple[float, float] | None = None) -> Array:
    """Return the Allan deviation of counted pulses whose remainder is carried to the next sample.

    The total is never off by more than half a pulse, and its rounding error is uniform with variance pulse^2 / 12. If
    the errors at both ends of an averaging time are independent, the deviation is pulse / (2 tau), with slope -1. IEEE
    Std 952-1997 writes it sqrt(3) Q / tau with Q = pulse / sqrt(12).

    ``rest`` holds the random-walk coefficient and the 1-sigma bias of a sensor without input. Such a sensor drifts
    through its pulses by these alone, and over short times the errors at both ends are correlated.
    """
    if pulse == 0:
        return np.zeros(np.shape(tau))
    if rest is None:
        return pulse / (2.0 * np.asarray(tau))
    walk, bias = rest

    def correlation(lag: Array) -> Array:
        """Return the correlation of the rounding error over pulse^2.

        It is a sum over the harmonics n of the sawtooth, each times the characteristic function of the motion.
        """
        spread = (walk**2 * lag + (bias * lag) ** 2) / pulse**2
        decay = np.exp(-2 * np.pi**2 * spread[:, None] * _HARMONICS**2)
        return np.sum(decay / _HARMONICS**2, axis=1) / (2 * np.pi**2)

    tau = np.asarray(tau, dtype=float)
    variance = 6 * correlation(np.zeros(1)) - 8 * correlation(tau) + 2 * correlation(2 * tau)
    return pulse / tau * np.sqrt(variance / 2.0)
