"""Fisher information of fixes whose errors are not Gaussian. docs/mathematics/bound.md#fisher-information."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sins_env.arrays import Array
from sins_env.specs import GpsSpec

FIX_DIMENSION = 6  #: components of a fix; one random factor scales them all, so each is information on the others
LEAST_STD = 1e-6  #: standard deviation for a perfect receiver, m/s and m, so that S can be inverted
LEAST_SCALE = 1e-12  #: least factor of the variance of contaminated fixes, for the same reason


def fix_noise(gps: GpsSpec) -> Array:
    """Return R (6, 6) of a Gaussian fix with the same information on velocity (m/s) and position (m).

    Jumps and spoofing count as known; an estimator that has to find them does worse.
    """
    std = np.maximum([*gps.vel_std, *gps.pos_std], LEAST_STD)
    return np.diag(std**2) / fisher_factor(gps, FIX_DIMENSION if gps.velocity else FIX_DIMENSION // 2)


def fisher_factor(gps: GpsSpec, dimension: int) -> float:
    """Return the Fisher information of the mean of a fix's error vector, in units of R^-1: 1 for a Gaussian.

    The vector is s v0 with v0 ~ N(0, R). In a share of the fixes s^2 is ``contamination_factor``, else 1. Heavy tails
    multiply s^2 by dof / chi^2(dof). With q = v' R^-1 v and density g(q), the information is E[q (2 g'/g)^2] / dimension.
    """
    from scipy import integrate  # slow to import

    m, scale = dimension, _mixture(gps)[1]
    log_sphere = math.log(2) + 0.5 * m * math.log(math.pi) - math.lgamma(0.5 * m)  # surface of the unit sphere

    def integrand(log_r: float) -> float:
        q = np.exp(2 * np.array(log_r))
        slope, log_g = _slope(gps, q, m)
        return float(q * slope**2 * np.exp(log_sphere + m * log_r + log_g))  # density of log r

    bumps = 0.5 * np.log(m * scale)
    found, _ = integrate.quad(integrand, bumps.min() - 12, bumps.max() + 20, epsabs=1e-12, limit=400, points=bumps)
    return float(found) / m


def efficient(gps: GpsSpec) -> Callable[[Array], Array]:
    """Return a function of the errors (..., 6) of fixes that gives those with which an efficient estimator is left.

    They are the derivative of the logarithm of the density over the Fisher information: a Gaussian error stays as it is, and one
    far out in a tail counts little. Their covariance is :func:`fix_noise`, whatever the law.
    """
    std = np.maximum([*gps.vel_std, *gps.pos_std], LEAST_STD)
    factor = fisher_factor(gps, FIX_DIMENSION)

    def weighted(errors: Array) -> Array:
        slope, _ = _slope(gps, np.square(errors / std).sum(axis=-1), FIX_DIMENSION)
        out: Array = errors * (slope / factor)[..., None]
        return out

    return weighted


def _mixture(gps: GpsSpec) -> tuple[Array, Array]:
    """Return the shares and the variance factors of the components of a fix's error."""
    share = np.array([1 - gps.contamination, gps.contamination])
    scale = np.array([1.0, max(gps.contamination_factor, LEAST_SCALE)])
    return share[share > 0], scale[share > 0]


def _slope(gps: GpsSpec, q: Array, m: int) -> tuple[Array, Array]:
    """Return -2 g'/g and log g at q (...), for errors of ``m`` components."""
    share, scale = _mixture(gps)
    dof, q = gps.heavy_tail_dof, q[..., None]
    log_size = np.log(share) - 0.5 * m * np.log(scale)
    if dof:
        log_size += math.lgamma(0.5 * (dof + m)) - math.lgamma(0.5 * dof) - 0.5 * m * math.log(math.pi * dof)
        log_g, slopes = log_size - 0.5 * (dof + m) * np.log1p(q / (dof * scale)), (dof + m) / (dof * scale + q)
    else:
        log_size -= 0.5 * m * math.log(2 * math.pi)
        log_g, slopes = log_size - 0.5 * q / scale, np.broadcast_to(1 / scale, q.shape[:-1] + scale.shape)
    most = log_g.max(axis=-1)
    weight = np.exp(log_g - most[..., None])
    total = weight.sum(axis=-1)
    return (weight * slopes).sum(axis=-1) / total, most + np.log(total)
