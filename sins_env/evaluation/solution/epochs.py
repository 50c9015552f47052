"""The states of a solution: time, position, velocity, attitude, biases and sigmas at every epoch, and how they were made."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from sins_env import attitude, checks
from sins_env.arrays import Array, Mask
from sins_env.evaluation.replay.consistency import Consistency, judge
from sins_env.evaluation.replay.replaying import Replay
from sins_env.evaluation.replay.told import GPS, NIS, SIGMA, sigma_of_angles
from sins_env.recordings import heading_pitch_roll
from sins_env.states import NAVIGATION

BIASES = ("gyro_bias", "accel_bias")  #: names of the biases in ``diagnostics()``, rad/s and m/s^2


@dataclass(frozen=True, eq=False, repr=False)
class Epochs:
    """States at K epochs. What a solver does not tell is NaN."""

    recording: str  #: name of the recording
    solver: str  #: name of the solver
    smoothed: bool  #: whether the states are from all fixes, and not from those before
    time: Array  #: (K,) s on the recording's clock
    position: Array  #: (K, 3) latitude rad, longitude rad, height m, of the IMU
    velocity: Array  #: (K, 3) E, N, U, m/s
    attitude: Array  #: (K, 4) q_nb, Right-Forward-Up body to East-North-Up
    gyro_bias: Array  #: (K, 3) R, F, U, rad/s
    accel_bias: Array  #: (K, 3) R, F, U, m/s^2
    sigma_position: Array  #: (K, 3) E, N, U, m
    sigma_velocity: Array  #: (K, 3) E, N, U, m/s
    sigma_attitude: Array  #: (K, 3) heading, pitch, roll, rad
    sigma_gyro_bias: Array  #: (K, 3) rad/s
    sigma_accel_bias: Array  #: (K, 3) m/s^2
    parameters: Mapping[str, tuple[Array, Array]]  #: estimates (K, s) of aids' parameters and their sigmas, SI, by name
    nis: Array  #: (K,) normalised innovation squared of the fix; NaN without one
    consistent: Mask  #: (K,) whether the epoch lies in no span with a warning
    consistency: Consistency  #: warnings, and what was measured
    replay: Replay  #: the replay that it was made of, with one window

    @property
    def angles(self) -> Array:
        """Heading in [0, 2 pi), pitch, roll, (K, 3) rad."""
        return heading_pitch_roll(self.attitude)

    def at_rate(self, rate_hz: float | None) -> Self:
        """Return the epochs nearest to multiples of 1 / ``rate_hz`` s from the first; None keeps all.

        Raises:
            ValueError: a rate above that of the epochs, which nothing is interpolated for.
        """
        if rate_hz is None:
            return self
        own = 1.0 / float(np.median(np.diff(self.time))) if len(self.time) > 1 else np.inf
        allowed = f"a positive number up to {own:.6g} Hz, the rate of the epochs"
        checks.number("rate", rate_hz, allowed, above=0.0, most=own * (1 + 1e-9))
        wanted = np.arange(self.time[0], self.time[-1] + 1e-6, 1.0 / rate_hz)
        right = np.clip(np.searchsorted(self.time, wanted), 1, len(self.time) - 1)
        k = np.unique(np.where(wanted - self.time[right - 1] < self.time[right] - wanted, right - 1, right))
        found: dict[str, Any] = {
            one.name: value[k]
            for one in dataclasses.fields(self)
            if isinstance(value := getattr(self, one.name), np.ndarray)
        }
        found["parameters"] = {name: (value[k], sigma[k]) for name, (value, sigma) in self.parameters.items()}
        return dataclasses.replace(self, **found)


def epochs_of(one: Replay, window: int = 0, smoothed: bool = False) -> dict[str, Any]:
    """Return the fields of :class:`Epochs` of a window of a replay; epochs before the first smoothed state are left out.

    In an alignment the position is the site and the velocity NaN.
    """
    told, track, epochs = one.told, one.track, len(one.t)
    assert told is not None
    assert one.source is not None
    found = judge(one, window)
    cov = told.cov[window]
    q_nb = attitude.from_euler(*np.moveaxis(one.angles[window], -1, 0)) if track is None else track.q_nb[window]
    nothing = np.full((epochs, 3), np.nan)
    pos, vel = (
        (np.tile(one.source.site.pos, (epochs, 1)), nothing)
        if track is None
        else (track.pos[window], track.vel[window])
    )
    variance = np.abs(np.diagonal(cov, axis1=-2, axis2=-1))
    spread = np.full((epochs, NAVIGATION.size), np.nan)
    spread[:, : variance.shape[-1]] = np.sqrt(variance)
    phi = NAVIGATION["phi"]
    values = {
        "time": one.starts[window] + one.t,
        "position": pos,
        "velocity": vel,
        "attitude": q_nb,
        "sigma_position": spread[:, NAVIGATION["dp"]],
        "sigma_velocity": spread[:, NAVIGATION["dv"]],
        "sigma_attitude": sigma_of_angles(one.angles[window], cov[:, phi, phi]),
        "nis": told.value(f"{GPS}{NIS}", window),
        "consistent": found.inside,
    }
    for name in BIASES:
        values[name] = _three(told.value(name, window, 3))
        values[f"sigma_{name}"] = _three(told.value(f"{name}{SIGMA}", window, 3))
    others = [name for name in told.constants if name not in BIASES]
    more = {name: (told.value(name, window), told.value(f"{name}{SIGMA}", window)) for name in others}
    known = np.isfinite(one.angles[window]).all(axis=-1)
    first = int(known.argmax()) if smoothed else 0
    parts: dict[str, Any] = {name: value[first:] for name, value in values.items()}
    parameters = {name: (value[first:], sigma[first:]) for name, (value, sigma) in more.items()}
    return dict(
        recording=one.recording,
        solver=one.solver,
        smoothed=smoothed,
        parameters=parameters,
        consistency=found,
        replay=one,
        **parts,
    )


def _three(values: Array) -> Array:
    """Return three components, of which those that are not estimated are NaN."""
    out = np.full((len(values), 3), np.nan)
    out[:, : values.shape[-1]] = values
    return out
