"""Keyword arguments of ``SINS/Replay-v0``, and the assumed noise of its fixes."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from sins_env import checks
from sins_env.prior import PRIORS
from sins_env.reading.datasheets import in_own_units
from sins_env.recordings import BRIDGE_S, MOST_BRIDGE_S, Recording, accepted
from sins_env.sensors.gps import ZERO_VELOCITY
from sins_env.specs import GPS_PRESETS, GpsSpec, gps_spec
from sins_env.worlds.receiver_std import FixStd, ReceiverStd
from sins_env.worlds.settings import STARTS, check_coarse, check_duration, check_epoch, check_misalignment

MODES = ("align", "navigate")  #: allowed values of ``mode``
#: Default of ``coarse``, s. A recording made for an alignment stands still longer.
COARSE_S = {"align": 90.0, "navigate": 60.0}
EPOCH_S = 0.1  #: default length of an epoch, s
BRIDGES = f"a number of seconds, 0 to {MOST_BRIDGE_S:g}"


def check_window(given: Any) -> tuple[float | str, float]:
    """Check start and length of a window.

    Raises:
        ValueError: anything else.
    """
    allowed = "(start, length) in seconds, the start perhaps +SECONDS or a date, or None"
    pair = checks.items(given)
    if pair is None or len(pair) != 2:
        raise checks.refused("window", given, allowed)
    start, length = pair
    if not isinstance(start, str):
        return checks.numbers("window", given, 2, allowed)[0], float(length)
    if isinstance(length, bool) or not isinstance(length, (int, float)) or not math.isfinite(length):
        raise checks.refused("window", given, allowed)
    return start, float(length)


@dataclass(frozen=True)
class ReplaySettings:
    """Settings of ``SINS/Replay-v0``. Values are those that JSON can hold.

    ``recording`` is a path, sought as it is given and then in $SINS_ENV_DATA. It may also be a recording in memory.

    ``window`` is (start, length) in s on the clock of the recording, and begins at the sample edge nearest to the start.
    A start in text may be "+60", s from the start of the recording, or a date of UTC. None takes all of it, or of a
    recording with gaps the longest part without one. ``duration``, s, without a window takes this length from the first
    epoch on. ``stride``, s, makes windows that begin at these intervals. Lengths are cut to whole epochs.

    ``epoch``, s, is a wish: an epoch is the nearest number of whole samples. None is 0.1 s, or the interval of the fixes if
    that is shorter. Fixes may lie anywhere in an epoch. ``n_sub`` None follows from the epoch and the sample rate.

    ``bridge``, s, is the longest gap between samples that interpolated increments fill.
    ``mode`` "navigate" asks for attitude, velocity and position
    of the IMU, "align" for attitude alone. ``coarse`` None is 90 s to align, 60 s to navigate, or 0 for a told start.

    ``imu`` and ``gps`` are the assumed errors of the sensors: the name of a preset or a dict of fields. Fixes have by
    default those of the preset "dgps", because real fixes scatter less within a minute but wander over minutes. Rate and
    lever arm are the recording's own. ``outages_s``, in s of the window, withholds fixes.

    Standard deviations that the receiver states are the noise of each fix, unless ``gps`` has a preset or tells them.
    ``fix_std`` has their ``factor``, ``vel_floor_mps`` and ``pos_floor_m``.

    ``aids`` tells of the recording's other sensors, each by a preset, a dict of fields, or "off". None has their defaults.

    A recording without GNSS has zero-velocity updates at the known site, by default with 0.03 m/s at every epoch. The
    ``rate_hz`` of a ``gps`` dict makes them rarer.

    ``start`` "told" needs a reference. ``misalignment_deg`` fixes the misalignment of a told start, E, N, U; None draws it.

    ``accept`` has names of findings with which a recording is taken as it is (:mod:`sins_env.recordings.findings`).

    Raises:
        ValueError: any value out of its range.
    """

    recording: Any = ""
    window: tuple[float | str, float] | None = None
    duration: float | None = None
    stride: float | None = None
    epoch: float | None = None
    n_sub: int | None = None
    coarse: float | None = None
    imu: Any = "rlg-car"
    gps: Any = None
    fix_std: Any = None
    aids: Any = None
    start: str = "unknown"
    misalignment_deg: tuple[float, ...] | None = None
    prior: str = "matched"
    mode: str = "align"
    accept: tuple[str, ...] = ()
    bridge: float = BRIDGE_S

    def __post_init__(self) -> None:
        checks.choice("start", self.start, STARTS)
        checks.choice("prior", self.prior, PRIORS)
        checks.choice("mode", self.mode, MODES)
        object.__setattr__(self, "accept", accepted(self.accept))
        if not isinstance(self.recording, (str, os.PathLike, Recording)) or self.recording == "":
            raise checks.refused("recording", self.recording, "the path of a recording, or a recording")
        set_ = object.__setattr__
        set_(self, "epoch", None if self.epoch is None else check_epoch(self.epoch))
        set_(self, "bridge", checks.number("bridge", self.bridge, BRIDGES, least=0.0, most=MOST_BRIDGE_S))
        set_(self, "fix_std", ReceiverStd.made(self.fix_std))
        set_(self, "coarse", check_coarse(self.coarse, self.start, COARSE_S[self.mode]))
        set_(self, "misalignment_deg", check_misalignment(self.misalignment_deg, self.start))
        if self.n_sub is not None:
            checks.number("n_sub", self.n_sub, "a whole number of samples per epoch, or None")
        if self.window is not None:
            set_(self, "window", check_window(self.window))
        if self.duration is not None:
            set_(self, "duration", check_duration(self.duration, 0.0))
            if self.window is not None:
                raise ValueError(f"duration = {self.duration:g} with a window; allowed: window = (start, length) alone")
        if self.stride is not None:
            checks.number("stride", self.stride, "a positive number of seconds, or None", above=0.0)

    def samples_per_epoch(self, recording: Recording) -> int:
        """Return the number of samples in an epoch: the whole number that comes nearest to the wish.

        Raises:
            ValueError: an ``n_sub`` that does not fit the wish.
        """
        rate, wish = recording.rate_hz, self.epoch
        if wish is None:
            gnss = recording.gnss
            step = np.inf if gnss is None or len(gnss.t_s) < 2 else float(np.median(np.diff(gnss.t_s)))
            wish = min(EPOCH_S, step)
        whole = max(round(wish * rate), 1)
        if self.n_sub is not None and self.n_sub != whole:
            fitting = f"{whole} for epochs of {wish:g} s at {rate:g} Hz"
            raise ValueError(f"n_sub = {self.n_sub!r}; allowed: {fitting}, or None")
        return whole

    def on_epochs(self, recording: Recording) -> ReplaySettings:
        """Return the settings with the length of an epoch, and a coarse phase of whole epochs, for this recording.

        Raises:
            ValueError: an ``n_sub`` that does not fit the wish.
        """
        samples = self.samples_per_epoch(recording)
        exact, wish = samples / recording.rate_hz, EPOCH_S if self.epoch is None else self.epoch
        epoch = wish if math.isclose(wish, exact, rel_tol=1e-9) else exact
        assert self.coarse is not None
        count = self.coarse / epoch
        coarse = self.coarse if abs(count - round(count)) < 1e-6 else round(count) * epoch
        return replace(self, epoch=epoch, coarse=coarse)

    def fixes(self, recording: Recording) -> GpsSpec:
        """Return the assumed noise of the fixes, with their rate, lever arm and outages.

        If the receiver states the noise of each fix, it is the median of that.

        Raises:
            ValueError: a setting that only a simulation can have, or a rate that is not the recording's.
        """
        spec, each = self._told(recording)[0], self.std_of_fixes(recording)
        return spec if each is None else each.typical(spec)

    def std_of_fixes(self, recording: Recording) -> FixStd | None:
        """Return the assumed noise of each fix; None if ``gps`` tells it, or if the receiver states nothing."""
        spec, told = self._told(recording)
        return None if recording.gnss is None else self.fix_std.of(recording.gnss, told, spec)

    def _told(self, recording: Recording) -> tuple[GpsSpec, Collection[str]]:
        """Return what ``gps`` tells of the fixes, with the defaults, and the names of the fields that it tells."""
        gnss = recording.gnss
        if gnss is None:
            base = replace(ZERO_VELOCITY, rate_hz=1.0 / (self.epoch or EPOCH_S))
        else:
            lever = np.zeros(3) if recording.lever_arm is None else recording.lever_arm
            rate = 1.0 / float(np.median(np.diff(gnss.t_s))) if len(gnss.t_s) > 1 else 1.0
            base = replace(GPS_PRESETS["dgps"], rate_hz=rate, lever_arm_m=tuple(map(float, lever)))
        if self.gps is None:
            return base, ()
        settings = {"preset": self.gps} if isinstance(self.gps, str) else self.gps
        told: Collection[str] = GpsSpec.__dataclass_fields__
        if not isinstance(settings, Mapping):  # a specification, or what is none
            spec = replace(gps_spec(settings), rate_hz=base.rate_hz, lever_arm_m=base.lever_arm_m)
        else:
            settings = dict(settings)
            if "preset" in settings:
                named = gps_spec(str(settings.pop("preset")))
                base = replace(named, rate_hz=base.rate_hz, lever_arm_m=base.lever_arm_m)
            else:
                told = in_own_units(settings, asdict(base), "GpsSpec").values
            spec = gps_spec(settings, base)
        for name in ("jump_mps", "spoof_mps2"):
            if value := getattr(spec, name):
                raise ValueError(f"{name} = {value:g} in a replay; allowed: in a simulation only, the fixes are real")
        if gnss is not None and not math.isclose(spec.rate_hz, base.rate_hz):
            raise ValueError(f"GpsSpec.rate_hz = {spec.rate_hz:g}; allowed: {base.rate_hz:g}, the recording's own")
        return spec, told
