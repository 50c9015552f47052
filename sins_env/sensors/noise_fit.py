"""The noise of a sensor at rest, fitted to its Allan variance: quantisation Q, white noise N, flicker B, random walk K.

    sigma^2(tau) = 3 Q^2 / tau^2 + N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3

The variances at octaves of averaging times are fitted by generalised least squares. Their covariance follows from the power
spectrum of the fitted noise. See docs/mathematics/simulation.md#noise-from-data. The source of the terms is IEEE Std
952-1997, annex C.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from sins_env.arrays import Array
from sins_env.sensors.allan import allan_deviation, gauss_markov
from sins_env.units import ARCSEC, DEG_PER_H, DEG_PER_SQRT_H, UG

NAMES = ("Q", "N", "B", "K")
FLICKER = 2.0 * math.log(2.0) / math.pi  #: Allan variance of flicker noise over B^2
PULSE = math.sqrt(12.0)  #: weight of a pulse over Q
LEAST_TIMES = 6  #: least number of averaging times for the four coefficients
SHARE = 8  #: the longest averaging time is the record over this number
MOST_MISFIT = 6.0  #: misfit from which on data are no noise of these kinds; of 1,200 simulated fits none had 5
ROUNDS = 4  #: rounds of the fit; each takes the covariance of the one before
NORMAL_95 = 1.959964
LEAST_DOF = 4.0  #: least degrees of freedom of a variance whose upper end is wanted
POINTS = 48  #: frequencies in an octave, at which products of spectra are summed
_GAIN = 9.0  #: least gain in chi-square for two further parameters, those of a Gauss-Markov bias


class NoiseFit(NamedTuple):
    """Coefficients of the noise of n sensors, in SI: Q rad or m/s, N per sqrt(s), B rad/s or m/s^2, K per s sqrt(s)."""

    tau: Array  #: (T,) averaging times of the fit, s
    variance: Array  #: (T, n) measured Allan variances
    covariance: Array  #: (n, T, T) covariance of them under the fitted noise
    coefficients: Array  #: (n, 4) Q, N, B, K; zero where the data show none
    low: Array  #: (n, 4) lower end of the 95 % interval of each coefficient
    high: Array  #: (n, 4) upper end
    misfit: Array  #: (n,) chi-square of the fit over its degrees of freedom; far above one for what is no such noise


class MarkovFit(NamedTuple):
    """Noise that several sensors share, with a Gauss-Markov bias, in SI: what a specification can say."""

    pulse: float  #: weight of a pulse
    white: float  #: white noise N
    sigma: float  #: stationary standard deviation of the bias
    time_constant_s: float  #: its correlation time, s; meaningless where ``sigma`` is zero


def fit_noise(increments: Array, dt: float, least_s: float = 0.0) -> NoiseFit:
    """Fit the noise of sensors at rest to their increments (N, n), rad or m/s, over samples of ``dt`` s.

    Averaging times below ``least_s`` are left out. They show the vibration of what the sensors are mounted on.

    Raises:
        ValueError: fewer than ``LEAST_TIMES`` averaging times.
    """
    count, n = increments.shape
    m = np.array([2.0**i for i in range(int(math.log2(max(count / SHARE, 1.0))) + 1)])
    m = m[m * dt >= least_s]
    if len(m) < LEAST_TIMES:
        needed = SHARE * 2.0 ** (LEAST_TIMES - 1) * max(least_s, dt)
        raise ValueError(
            f"{count * dt:g} s of data from {max(least_s, dt):g} s on give {len(m)} averaging times; allowed: at least "
            f"{LEAST_TIMES}, from about {needed:.0f} s"
        )
    tau = m * dt
    variance = np.column_stack([allan_deviation(increments[:, i : i + 1], dt, tau).adev[:, 0] ** 2 for i in range(n)])
    cross = _cross_spectra(m, count, dt)
    fits = [_fit_one(variance[:, i], tau, cross) for i in range(n)]
    squares, low, high, covariance = (np.array([fit[k] for fit in fits]) for k in range(4))
    misfit = np.array([fit[4] for fit in fits])
    return NoiseFit(tau, variance, covariance, np.sqrt(squares), np.sqrt(low), np.sqrt(high), misfit)


def terms(tau: Array) -> Array:
    """Return the Allan variances (T, 4) of noises with Q, N, B or K of one."""
    return np.column_stack([3.0 / tau**2, 1.0 / tau, np.full_like(tau, FLICKER), tau / 3.0])


def _cross_spectra(m: Array, count: int, dt: float) -> tuple[Array, Array]:
    """Return what the covariance of Allan variances is made of.

    cov(v_j, v_k) = 2 / T_jk int S(f)^2 |H_j(f)|^2 |H_k(f)|^2 df over all frequencies of the samples. The spectrum is
    S = sum of the squared coefficients times ``spectra`` (F, 4). ``weights`` (F, T, T) has all the rest.
    """
    edges = 0.5 / dt / 2.0 ** np.arange(int(math.log2(count)) + 3)[::-1]
    places = (np.arange(POINTS) + np.modf(np.arange(POINTS) * 0.6180339887)[0]) / POINTS  # no rhythm with the sines
    f = np.concatenate([low + (high - low) * places for low, high in itertools.pairwise(edges.tolist())])
    step = np.repeat(np.diff(edges) / POINTS, POINTS)
    half = np.sin(np.pi * f * dt)
    gain = 2.0 * np.sin(np.pi * f[:, None] * m * dt) ** 4 / (m * half[:, None]) ** 2
    spectra = np.column_stack([4.0 * half**2 / dt, np.ones_like(f), 1.0 / (2.0 * np.pi * f), dt**2 / (4.0 * half**2)])
    lasts = (count - 2 * m + 1) * dt
    length = np.sqrt(lasts[:, None] * lasts)  # of the shorter one, exactly; the mean keeps the matrix positive definite
    return spectra, gain[:, :, None] * gain[:, None, :] * (4.0 * step)[:, None, None] / length


def _fit_one(v: Array, tau: Array, cross: tuple[Array, Array]) -> tuple[Array, Array, Array, Array, float]:
    """Return the squared coefficients (4,), the ends of their intervals, the covariance of the variances, and the misfit.

    An interval is that of the fit without bounds, with the normal quantile. Its upper end is at least that of a chi-square
    variable of the same spread, because a spread that is taken from a low estimate is too small.
    """
    A = terms(tau)
    scale: Array = np.diag(v)
    squares = _least_squares(A, v, scale)
    for _ in range(ROUNDS):
        C = _covariance(squares, cross)
        squares = _least_squares(A, v, np.asarray(np.linalg.cholesky(C)))
    L = np.linalg.cholesky(C)
    white = np.linalg.solve(L, np.column_stack([A, v]))
    misfit = float(np.sum((white[:, :4] @ squares - white[:, 4]) ** 2)) / (len(v) - np.count_nonzero(squares))
    P = np.linalg.inv(white[:, :4].T @ white[:, :4])
    free, std = P @ white[:, :4].T @ white[:, 4], np.sqrt(np.diag(P))
    low = np.clip(free - NORMAL_95 * std, 0.0, squares)
    dof = np.maximum(2.0 * (squares / std) ** 2, LEAST_DOF)  # Satterthwaite's
    high = np.maximum(free + NORMAL_95 * std, squares * dof / (2.0 * gammaincinv(dof / 2.0, 0.025)))
    return squares, low, high, C, misfit


def _least_squares(A: Array, v: Array, L: Array) -> Array:
    """Return x >= 0 that minimises |L^-1 (A x - v)|."""
    from scipy.optimize import nnls  # slow to import, needed for a fit only

    white = np.linalg.solve(L, np.column_stack([A, v]))
    size = np.linalg.norm(white[:, :-1], axis=0)
    return np.asarray(nnls(white[:, :-1] / size, white[:, -1])[0]) / size


def _covariance(squares: Array, cross: tuple[Array, Array]) -> Array:
    spectra, weights = cross
    return np.asarray(np.tensordot((spectra @ squares) ** 2, weights, 1))


def fit_markov(fit: NoiseFit) -> MarkovFit:
    """Fit pulses, white noise and a Gauss-Markov bias to the mean Allan variance of the sensors of a fit.

    The correlation time is sought from 16 times the shortest averaging time to the whole record. A
    bias that gains less than 9 in chi-square is left out.
    """
    n = fit.variance.shape[1]
    v, L = fit.variance.mean(axis=1), np.linalg.cholesky(fit.covariance.sum(axis=0) / n**2)
    A = terms(fit.tau)[:, :2]

    def misfit(A: Array, x: Array) -> float:
        return float(np.sum(np.linalg.solve(L, A @ x - v) ** 2))

    plain = _least_squares(A, v, L)
    best, found = misfit(A, plain) - _GAIN, MarkovFit(PULSE * math.sqrt(plain[0]), math.sqrt(plain[1]), 0.0, 0.0)
    for T in np.geomspace(16.0 * fit.tau[0], SHARE * fit.tau[-1], 120).tolist():
        with_bias = np.column_stack([A, gauss_markov(1.0, T, fit.tau) ** 2])
        x = _least_squares(with_bias, v, L)
        if (chi2 := misfit(with_bias, x)) < best:
            best, found = chi2, MarkovFit(PULSE * math.sqrt(x[0]), math.sqrt(x[1]), math.sqrt(x[2]), T)
    return found


def imu_fields(gyro: MarkovFit, accel: MarkovFit) -> dict[str, float]:
    """Return the fields of an :class:`sins_env.specs.ImuSpec` that tell this noise; those of a part that is not there are zero."""
    return {
        "arw_deg_sqrt_h": gyro.white / DEG_PER_SQRT_H,
        "gyro_markov_deg_h": gyro.sigma / DEG_PER_H,
        **({"gyro_markov_s": gyro.time_constant_s} if gyro.sigma else {}),
        "gyro_lsb_arcsec": gyro.pulse / ARCSEC,
        "vrw_ug_sqrt_hz": accel.white / UG,
        "accel_markov_ug": accel.sigma / UG,
        **({"accel_markov_s": accel.time_constant_s} if accel.sigma else {}),
        "accel_lsb_mps": accel.pulse,
    }
