"""Sources of error of a task: what the start, the inertial sensors, the fixes and the aids each add to the covariance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Mask
from sins_env.evaluation.bound.error_dynamics import DP, DV, FIXES, PHI, ErrorDynamics
from sins_env.states import FIX


class Source(NamedTuple):
    """A source of error, as its part of P0, of the driving noise, and of the noise of readings."""

    name: str
    start: Mask  #: (n,) the states whose variance at the start is its own
    drive: Mask  #: (n,) the states whose driving noise is its own
    noise: Mapping[str, Mask]  #: rows (m,) of the named readings whose noise is its own


_BIASES = {
    "accel_bias": "accelerometer bias",
    "accel_markov": "accelerometer bias, wandering",
    "gyro_bias": "gyro bias",
    "gyro_markov": "gyro bias, wandering",
}


def sources(model: ErrorDynamics) -> list[Source]:
    """Return the sources of error that are not zero. Together they are all of P0, of the driving noise, and of every R."""
    none = np.zeros(model.full.size, dtype=bool)

    def among(*states: slice) -> Mask:
        out = none.copy()
        for one in states:
            out[one] = True
        return out[model.kept]

    nothing, found = among(), []
    for name, states in (("start attitude", PHI), ("start velocity", DV), ("start position", DP)):
        found.append(Source(name, among(states), nothing, {}))
    for name, states in (("gyro noise", PHI), ("accelerometer noise", DV)):
        found.append(Source(name, nothing, among(states), {}))
    for states, kind in sorted(model.biases, key=lambda pair: not pair[1].gyro):
        found.append(Source(_BIASES[kind.name], among(states), among(states), {}))
    for name, block in (("fixes of velocity", "dv"), ("fixes of position", "dp")):
        rows = np.isin(model.shown, range(FIX.size)[FIX[block]])
        found.append(Source(name, nothing, nothing, {FIXES: rows}))
    for name, (_, term) in model.aids.items():
        rows = np.ones(len(term.noise()), dtype=bool)
        found.append(Source(f"{name}, noise", nothing, nothing, {name: rows}))
    for states, own in model.own:
        found.append(Source(own.block.name.replace(".", ", "), among(states), among(states), {}))
    return [one for one in found if _is_there(one, model)]


def _is_there(source: Source, model: ErrorDynamics) -> bool:
    starts, drives = np.diagonal(model.P0)[source.start], model.driven[source.drive]
    return bool(starts.any() or drives.any() or any(rows.any() for rows in source.noise.values()))
