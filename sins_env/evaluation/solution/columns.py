"""The columns of a solution: their names with units, their values, and how many digits a text file has of each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.solution.epochs import Epochs
from sins_env.recordings.axes import swap_ned
from sins_env.units import DEG, DEG_PER_H, UG

FRAMES = (
    "enu",
    "ned",
)  #: East-North-Up with a Right-Forward-Up body, or North-East-Down with a Forward-Right-Down body
_NAMES = {"enu": ("east", "north", "up"), "ned": ("north", "east", "down")}
_AXES = ("x", "y", "z")


class Column(NamedTuple):
    """One column."""

    name: str
    values: Array  #: (K,)
    form: str  #: printf format in a text file; a value that is NaN is left blank


def columns(one: Epochs, frame: str = "enu") -> list[Column]:
    """Return all columns. Angles are the same in both frames, because they are those of the same vehicle."""
    names, ned = _NAMES[frame], frame == "ned"

    def turned(values: Array, spread: bool = False) -> Array:
        """Return a vector (K, 3) in the frame; a sigma keeps its sign."""
        out = swap_ned(values) if ned else values
        return np.abs(out) if spread else out + 0.0  # no minus zero

    found = [
        Column("time_s", one.time, "%.6f"),
        Column("latitude_deg", one.position[:, 0] / DEG, "%.10f"),
        Column("longitude_deg", one.position[:, 1] / DEG, "%.10f"),
        Column("height_m", one.position[:, 2], "%.4f"),
    ]
    found += _vector("v_{}_mps", names, turned(one.velocity), "%.5f")
    found += _vector("{}_deg", ("heading", "pitch", "roll"), one.angles / DEG, "%.6f")
    found += _vector("gyro_bias_{}_deg_h", _AXES, turned(one.gyro_bias) / DEG_PER_H, "%.6g")
    found += _vector("accel_bias_{}_ug", _AXES, turned(one.accel_bias) / UG, "%.6g")
    found += _vector("sigma_{}_deg", ("heading", "pitch", "roll"), one.sigma_attitude / DEG, "%.6g")
    found += _vector("sigma_{}_m", names, turned(one.sigma_position, True), "%.6g")
    found += _vector("sigma_v_{}_mps", names, turned(one.sigma_velocity, True), "%.6g")
    found += _vector("sigma_gyro_bias_{}_deg_h", _AXES, turned(one.sigma_gyro_bias, True) / DEG_PER_H, "%.6g")
    found += _vector("sigma_accel_bias_{}_ug", _AXES, turned(one.sigma_accel_bias, True) / UG, "%.6g")
    found += [Column("nis", one.nis, "%.6g"), Column("consistent", one.consistent.astype(float), "%d")]
    for name, (values, sigmas) in one.parameters.items():
        stem, size = name.replace(".", "_"), values.shape[-1]
        ends = [""] if size == 1 else [f"_{axis}" for axis in (_AXES if size == 3 else range(1, size + 1))]
        found += [Column(stem + end, values[:, i], "%.6g") for i, end in enumerate(ends)]
        found += [Column(f"sigma_{stem}{end}", sigmas[:, i], "%.6g") for i, end in enumerate(ends)]
    return found


def _vector(name: str, parts: tuple[str, ...], values: Array, form: str) -> list[Column]:
    return [Column(name.format(part), values[:, i], form) for i, part in enumerate(parts)]
