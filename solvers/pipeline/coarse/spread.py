"""What a coarse attitude is off by, to first order: its covariance, from the told errors of IMU and fixes.

    phi = gyro eps + accel nabla + white noise

The biases eps and nabla stay as they are in the fine phase, whose prior must know how the misalignment hangs together with them.
Equations: docs/mathematics/coarse_alignment.md#spread.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.prior import ANY_HEADING_STD_DEG, Prior
from sins_env.states import ERRORS
from sins_env.units import DEG
from solvers.blocks.square_root import symmetrize

PHI, DV, GYRO, ACCEL = (ERRORS[name] for name in ("phi", "dv", "gyro_bias", "accel_bias"))

BLOCK = 50  #: number of epochs whose matrices are held at a time


class Spread(NamedTuple):
    """The misalignment that is left, in terms of the biases in body axes, and the rest."""

    gyro: Array  #: (..., 3, 3) d phi / d eps, s
    accel: Array  #: (..., 3, 3) d phi / d nabla, s^2/m
    noise: Array  #: (..., 3, 3) covariance by white noise, rad^2


class Readings(NamedTuple):
    """How the errors of fixes or other readings enter a fit to K pairs."""

    c: Array  #: (K, ..., 3), coefficients of the pairs
    R: Array  #: (K, ..., 3, 3) covariance of the errors in the inertial frame, in the unit of the pairs
    #: (K, ..., 3) what is read along the body and taken from the pairs, turned by the gyros; None: readings in n.
    along: Array | None = None
    #: (K, ..., 3, m) errors that m constants of a sensor cause, of one standard deviation each.
    constants: Array | None = None
    walk: float = 0.0  #: variance that an epoch adds to an error of the readings that walks, per axis


def told_by(spread: Spread, prior: Prior, q_nb: Array | None = None) -> Array:
    """Return P0 (..., 15, 15) in the layout ERRORS, with the misalignment of the spread in place of the prior's.

    The biases are in body axes, or with an attitude q_nb (..., 4) in n.

    A heading that may be anything has the standard deviation of one that is drawn over the circle.
    """
    told = prior.P0
    P0 = np.broadcast_to(told, (*spread.noise.shape[:-2], *told.shape)).copy()
    P0[..., PHI, PHI] = symmetrize(spread.noise)
    for slope, bias in ((spread.gyro, GYRO), (spread.accel, ACCEL)):
        if q_nb is not None:
            slope = slope @ attitude.to_dcm(q_nb).mT
        cross = slope @ told[bias, bias]
        P0[..., PHI, PHI] += symmetrize(cross @ slope.mT)
        P0[..., PHI, bias], P0[..., bias, PHI] = cross, cross.mT
    scale = np.ones(P0.shape[:-1])
    sigma = np.sqrt(np.diagonal(P0[..., PHI, PHI], axis1=-2, axis2=-1))
    scale[..., PHI] = np.minimum(1.0, ANY_HEADING_STD_DEG * DEG / np.maximum(sigma, attitude.TINY))
    return P0 * (scale[..., :, None] * scale[..., None, :])


def of_means(
    form: int, latitude: float, gravity: float, rate: float, epochs: int, epoch_s: float, C: Array, prior: Prior
) -> Spread:
    """Return the spread of analytic alignment over so many epochs, for the attitude C (..., 3, 3)."""
    east, tan = 1.0 / (rate * np.cos(latitude)), np.tan(latitude)
    gyro = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-east, 0.0, 0.0]])
    accel = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [tan, 0.0, 0.0]]) / gravity
    if form == 1:  # half of the error of shape goes into the level
        gyro[0, 2] += 0.5 * east
        accel[0] += np.array([0.0, 0.5, -0.5 * tan]) / gravity
    T = epochs * epoch_s
    noise = epochs * (gyro @ prior.Q[PHI, PHI] @ gyro.T + accel @ prior.Q[DV, DV] @ accel.T) / T**2
    return Spread(gyro @ C, accel @ C, np.broadcast_to(noise, C.shape))


def of_pairs(
    du: Array,
    coefficients: Array,
    information: Array,
    C_b: Callable[[slice], Array],
    C_n: Array,
    epoch_s: float,
    prior: Prior,
    readings: Readings,
    bridged: Mapping[int, Array],
) -> Spread:
    """Return the spread of a fit to K pairs of vectors in the inertial frame, at the last epoch.

    With errors delta_j of the vectors, the fit turns by theta = -N^-1 sum_j c_j x delta_j.

    Args:
        du: (K, ..., 3) m/s, velocity increments by specific force, in the inertial frame.
        coefficients: (K, ..., 3), the c_j of velocities.
        information: (..., 3, 3), N.
        C_b: gives for a slice of epochs (k, ..., 3, 3), turns from body axes into the inertial frame, means over the epochs.
        C_n: (K, 3, 3) or (K, ..., 3, 3), turns from n into the inertial frame.
        epoch_s: s, length of an epoch.
        prior: the told errors of the IMU.
        readings: the errors of what the pairs are compared with.
        bridged: covariances (..., 6, 6) of what bridged samples are off by in body axes, by the index of the epoch.
    """
    solved, eye = np.linalg.inv(information), np.eye(3)
    later = np.zeros(du.shape[1:])  # sum of c_j from an epoch on
    after = np.zeros(information.shape)  # sum of D from an epoch on
    noise, gyro, accel = (np.zeros(information.shape) for _ in range(3))
    constants: Array | float = 0.0
    walk = prior.Q[DV, DV] + readings.walk * eye
    for end in range(len(du), 0, -BLOCK):
        part = slice(max(end - BLOCK, 0), end)
        c = coefficients[part]
        sums = later + from_the_end(c)
        B = -solved @ attitude.skew(sums)  # theta = sum B nabla h
        G = solved @ attitude.skew(readings.c[part])  # theta = sum G (errors of readings)
        D = -B @ attitude.skew(du[part])  # theta = sum D psi, psi the turn by the gyros so far
        if readings.along is not None:
            D = D - G @ attitude.skew(readings.along[part])
        turns = after + from_the_end(D)
        A = eye + turns - 0.5 * D  # theta + psi = sum A eps h, psi at mid-epoch
        later, after = sums[0], turns[0]
        R = readings.R[part]
        noise += (A @ prior.Q[PHI, PHI] @ A.mT + B @ walk @ B.mT + G @ R @ G.mT).sum(axis=0)
        body = C_b(part)
        of_gyro, of_accel = A @ body, B @ body
        gyro += epoch_s * of_gyro.sum(axis=0)
        accel += epoch_s * of_accel.sum(axis=0)
        for k in filter(bridged.__contains__, range(part.start, end)):
            both = np.concatenate([of_gyro[k - part.start], of_accel[k - part.start]], axis=-1)
            noise += both @ bridged[k] @ both.mT
        if readings.constants is not None:
            constants = constants + (G @ readings.constants[part]).sum(axis=0)
    if readings.constants is not None:
        noise += constants @ np.swapaxes(constants, -1, -2)
    to_n = -C_n[-1].mT  # phi is the turn back, in n
    return Spread(to_n @ gyro, to_n @ accel, to_n @ noise @ to_n.mT)


def from_the_end(a: Array) -> Array:
    """Return the sums of a (K, ...) from each epoch to the last."""
    return np.flip(np.cumsum(np.flip(a, 0), axis=0), 0)


def outer(u: Array, v: Array) -> Array:
    """Return u v' (..., 3, 3)."""
    return u[..., :, None] * v[..., None, :]


def profile(u: Array, v: Array) -> Array:
    """Return the sum of u v' (..., 3, 3) over K pairs (K, ..., 3); a row of a batch has the bits of the row alone."""
    blocks = (slice(i, i + BLOCK) for i in range(0, len(u), BLOCK))
    return np.add.reduce([outer(u[block], v[block]).sum(axis=0) for block in blocks])
