"""Aiding sensors of a recording, delivered at the ends of epochs like simulated ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import checks
from sins_env.arrays import Array, Mask
from sins_env.recordings import Readings, Recording, seconds
from sins_env.sensors import aids
from sins_env.sensors.gps import received
from sins_env.sensors.limits import Field, clip
from sins_env.specs import AidSpec

OFF = "off"  #: told of a sensor that is left out
TOTALS = ("odometer",)  #: sensors whose readings are sums, of which an observation has the increase in the epoch


def specs_of(given: Any, recording: Recording) -> tuple[AidSpec, ...]:
    """Return what is told of the sensors of a recording, in the order of their names.

    A sensor that ``given`` does not name has the defaults of its specification; "off" leaves it out.

    Raises:
        ValueError: a sensor that the recording does not have, or what a specification refuses.
    """
    if given is not None and not isinstance(given, Mapping):
        raise checks.refused("aids", given, "a dict with a preset, a dict of fields, or 'off' for each sensor, or None")
    told = dict(given or {})
    for name in told:
        aids.sensor_of(name)
        if name not in recording.aids:
            there = ", ".join(recording.aids) or "none"
            raise ValueError(
                f"aids: no {name} in {recording.name}; there: {there}; allowed: a mapping with aids.{name}"
            )
    left = {name: told.get(name, {}) for name in recording.aids if told.get(name) != OFF}
    found = aids.specs(left)
    for spec in found:
        for field in spec.faulty:
            name, value = f"aids.{spec.name}.{field}", checks.shown(getattr(spec, field))
            raise ValueError(f"{name} = {value} in a replay; allowed: in a simulation only, the readings are real")
    return found


class RecordedAid:
    """A sensor of a recording.

    A reading within half a sample of the end of an epoch counts there. Between readings that are no further apart than
    an epoch, the reading is interpolated.
    """

    def __init__(self, spec: AidSpec, readings: Readings, epoch_s: float, within_s: float) -> None:
        kind = aids.sensor_of(spec.name)
        self.spec, self.epoch_s, self._t, self._within = spec, epoch_s, readings.t_s, within_s
        self._total, self._size = spec.name in TOTALS, kind.size
        length = float(np.linalg.norm(spec.baseline_m)) if readings.unit else 1.0  # type: ignore[attr-defined]
        self._values = length * readings.values
        self._told = np.arange(kind.size) < self._values.shape[1]
        mark = Field.mark(f"1 where there is a reading of {spec.name} at t")
        if not self._told.all():
            mark = Field(np.zeros(kind.size, np.int8), np.ones(kind.size, np.int8), f"{mark.what}, for each component")
        low, high = -kind.limit, kind.limit
        self.fields = {
            spec.name: Field.of(kind.size, low, high, f"{kind.what}; zeros without one"),
            f"{spec.name}_valid": mark,
        }

    def readings(self, times: Array, number: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
        """Return the fields of the observations at the ends (runs, epochs) of epochs, on the recording's clock."""
        values, there = self._at(times)
        if self._total:
            before, too = self._at(times - self.epoch_s)
            values, there = values - before, there & too
        there &= received(self.spec, number * self.epoch_s)
        full = np.zeros((*times.shape, self._size))
        full[..., self._told] = np.where(there[..., None], values, 0.0)
        clip(self.spec.name, full, self.fields)
        valid = there[..., None] & (self._told if len(self.fields[f"{self.spec.name}_valid"].low) > 1 else True)
        return {self.spec.name: full, f"{self.spec.name}_valid": valid.astype(np.int8)}

    def _at(self, times: Array) -> tuple[Array, Mask]:
        """Return the readings at times, and whether there is one."""
        t, last = self._t, len(self._t) - 1
        i = np.clip(np.searchsorted(t, times), 1, max(last, 1))
        before, after = np.maximum(i - 1, 0), np.minimum(i, last)
        near = np.where(np.abs(t[before] - times) < np.abs(t[after] - times), before, after)
        exact = np.abs(t[near] - times) <= self._within
        gap = t[after] - t[before]
        between = (t[before] < times) & (times < t[after]) & (gap <= self.epoch_s + self._within)
        share = np.where(between, (times - t[before]) / np.where(gap > 0, gap, 1.0), 0.0)[..., None]
        blend = (1.0 - share) * self._values[before] + share * self._values[after]
        return np.where(exact[..., None], self._values[near], blend), exact | between

    def check(self, starts: Array, epochs: int, name: str) -> None:
        """Check that some window has a reading at the end of an epoch.

        Raises:
            ValueError: none has.
        """
        times = starts[:, None] + self.epoch_s * np.arange(1, epochs + 1)
        if self.readings(times, np.arange(1, epochs + 1))[f"{self.spec.name}_valid"].any():
            return
        step = float(np.median(np.diff(self._t))) if len(self._t) > 1 else 0.0
        what = (
            f"readings of {self.spec.name} from {seconds(self._t[0])} to {seconds(self._t[-1])} s, {step:.4g} s apart"
        )
        raise ValueError(
            f"{name}: {what}, and none at the end of an epoch of {self.epoch_s:g} s; allowed: a window with readings, "
            f"epochs of a sample ({2 * self._within:.4g} s), or aids = {{{self.spec.name!r}: {OFF!r}}}"
        )
