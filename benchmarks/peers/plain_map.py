"""The epoch map of the ten errors in plain numbers, for packages that pass one state at a time, and for JAX.

:class:`solvers.pipeline.errors.alignment.AlignmentMap` is a compiled kernel. Here the same map is
written component by component, for floats (``math``) and for JAX (``jax.numpy``) alike.
Equations: docs/mathematics/error_models.md#epoch-map.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.pipeline.errors.model import ACCEL_UNIT, GYRO_UNIT
from solvers.pipeline.strapdown import EpochMotion

Array = NDArray[np.float64]


def coefficients(m: EpochMotion) -> Array:
    """Return the coefficients (..., 28) of an epoch.

    They are specific force 3, turn of n 3, transport 3, Coriolis 4, accelerometer biases 6 and gyro biases 9.
    """
    h, batch = m.dt, m.dvel_n.shape[:-1]
    T = np.broadcast_to(h * m.transport, (*batch, 3, 3))
    north, east, up = T[..., 0, 1], T[..., 1, 0], T[..., 2, 0]
    VE, VN, VU = np.moveaxis(m.vel, -1, 0)
    turn = h * (m.rate_ie + m.rate_en)
    coriolis = h * (2 * m.rate_ie + m.rate_en)[..., 2]
    by_velocity = [up * VN - east * VU, coriolis, -coriolis - up * VE, north * VU]
    accel, gyro = h * ACCEL_UNIT * m.C[..., :2], h * GYRO_UNIT * m.C
    return np.concatenate(
        [
            m.dvel_n,
            turn,
            np.stack([north, east, up, *by_velocity], axis=-1),
            accel.reshape(*batch, 6),
            gyro.reshape(*batch, 9),
        ],
        axis=-1,
    )


def map_with(numbers: Any) -> Callable[[Sequence[Any], Sequence[Any]], tuple[Any, ...]]:
    """Return the map from errors (10) and coefficients (28) to the errors after the epoch.

    ``numbers`` is the module with ``sin`` and ``cos`` for their type.
    """

    def after(x: Sequence[Any], epoch: Sequence[Any]) -> tuple[Any, ...]:
        dE, dN, pE, pN, pU, ax, ay, ex, ey, ez = x
        fE, fN, fU, wE, wN, wU, tN, tE, tU, kEE, kEN, kNE, kNN = epoch[:13]
        aEx, aEy, aNx, aNy, aUx, aUy, gEx, gEy, gEz, gNx, gNy, gNz, gUx, gUy, gUz = epoch[13:]
        sE, sN, sU = numbers.sin(pE), numbers.sin(pN), numbers.sin(pU)
        cE, cN, cU = numbers.cos(pE), numbers.cos(pN), numbers.cos(pU)
        # C_n^c(phi), rows [a b c], [d e f], [g i j]
        a, b, c = cN * cU - sN * sE * sU, cN * sU + sN * sE * cU, -sN * cE
        d, e, f = -cE * sU, cE * cU, sE
        g, i, j = sN * cU + cN * sE * sU, sN * sU - cN * sE * cU, cN * cE
        u, v, w = fE - aEx * ax - aEy * ay, fN - aNx * ax - aNy * ay, fU - aUx * ax - aUy * ay
        gainE, gainN = fE - (a * u + d * v + g * w), fN - (b * u + e * v + i * w)
        vE, vN = dE + 0.5 * gainE, dN + 0.5 * gainN  # mid-epoch
        turnE, turnN, turnU = wE - tN * vN, wN - tE * vE, wU - tU * vE
        rE = wE - (a * turnE + b * turnN + c * turnU) - (gEx * ex + gEy * ey + gEz * ez)
        rN = wN - (d * turnE + e * turnN + f * turnU) - (gNx * ex + gNy * ey + gNz * ez)
        rU = wU - (g * turnE + i * turnN + j * turnU) - (gUx * ex + gUy * ey + gUz * ez)
        hE, hN, hU = 0.5 * (rN * fU - rU * fN), 0.5 * (rU * fE - rE * fU), 0.5 * (rE * fN - rN * fE)  # r x f / 2
        k = (cN * rU - sN * rE) / cE
        sway = tU * vE
        return (
            dE + gainE - (a * hE + d * hN + g * hU) + kEE * vE + kEN * vN - sway * vN,
            dN + gainN - (b * hE + e * hN + i * hU) + kNE * vE + kNN * vN + sway * vE,
            pE + cN * rE + sN * rU,
            pN + rN - sE * k,
            pU + k,
            ax,
            ay,
            ex,
            ey,
            ez,
        )

    return after


def advance(x: Sequence[Any], epoch: Sequence[Any], numbers: Any) -> tuple[Any, ...]:
    """Return the ten errors after the epoch."""
    return map_with(numbers)(x, epoch)


def plain(epoch: Array, numbers: Any) -> Callable[[Array], Array]:
    """Return the map of one epoch (28,) for one state (10,), in floats."""
    values, after = epoch.tolist(), map_with(numbers)
    return lambda x: np.array(after(x.tolist(), values))
