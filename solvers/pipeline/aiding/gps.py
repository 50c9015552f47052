"""GPS fixes as measurements of the error state: the law of their noise, and the lever arm of the antenna."""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.specs import GpsSpec
from solvers.types import NoiseLaw


def noise_law(gps: GpsSpec) -> NoiseLaw | None:
    """The law of the fixes' errors that the task tells; None: Gaussian."""
    if not (gps.contamination or gps.heavy_tail_dof):
        return None
    return NoiseLaw(gps.contamination, gps.contamination_factor, gps.heavy_tail_dof)


def arm_error(phi: Array, arm: Array) -> Array:
    """(I - C') a of the vectors ``arm`` (*batch, k, 3), one after another: (*batch, [points,] 3 k) for phi (..., 3)."""
    if phi.ndim >= arm.ndim:
        arm = arm[..., None, :, :]
    apart = arm - np.matmul(arm, attitude.misalignment_dcm(phi))  # rows: (C' a)' = a' C
    return apart.reshape(*apart.shape[:-2], -1)
