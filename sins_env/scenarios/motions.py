"""Kinds of motion: each with its environment, its own keys, and where common keys go if not to the usual setting."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

from sins_env import checks
from sins_env.recordings import accepted
from sins_env.scenarios.key import Key, number, one_of, whole
from sins_env.trajectory.oscillations import AXES, MOTIONS, TURNS, components_of, sea
from sins_env.trajectory.plan import MAX_SPEED_MPS
from sins_env.trajectory.segments import Segment
from sins_env.trajectory.track import BANKS, TABLE_FILES, TrackPlan
from sins_env.worlds.flight import FlightSettings
from sins_env.worlds.profiles import PROFILES, flight_profile
from sins_env.worlds.replay_settings import BRIDGES, MOST_BRIDGE_S, ReplaySettings, check_window
from sins_env.worlds.sway import AlignSettings
from sins_env.worlds.vehicle import VehicleSettings, check_events

WAVE = "one component or a list of them; a phase_deg that is left out is drawn in each run"


@dataclass(frozen=True)
class MotionKind:
    """A kind of motion."""

    name: str
    what: str  #: description in one sentence
    env_id: str
    settings: type  #: settings of the environment, which also tell which common keys it has
    keys: tuple[Key, ...]
    to: Mapping[str, str] = field(default_factory=dict)  #: other targets of common keys
    defaults: Mapping[str, Any] = field(default_factory=dict)  #: settings by target beside given ones of the same dict
    apart: tuple[tuple[str, ...], ...] = ()  #: groups of targets, of which only one group may be given

    def target(self, key: Key) -> str:
        """Return the setting that a key becomes; empty if this kind has no such setting."""
        to = self.to.get(key.path, key.to)
        head = to.partition(".")[0]
        return to if head == "task" or head in {one.name for one in fields(self.settings)} else ""

    def default(self, key: Key) -> Any:
        """Return the value of the setting of a key that is left out."""
        to = self.target(key)
        if to in self.defaults:
            return self.defaults[to]
        return next((one.default for one in fields(self.settings) if one.name == to), None)


def _segments(name: str, given: Any) -> list[Any]:
    rows = checks.items(given)
    if not rows:
        raise checks.refused(name, given, "a list of manoeuvres such as [accelerate, 10, 0.2] (duration s, size)")
    for i, row in enumerate(rows):
        try:
            Segment.of(row)
        except ValueError as error:
            raise ValueError(f"{name}[{i}] = {checks.shown(row)}: {error}") from None
    return rows


def _profile(name: str, given: Any) -> str:
    if not isinstance(given, (str, os.PathLike)):
        raise checks.refused(name, given, f"{', '.join(PROFILES)}, or a YAML or JSON file of a flight")
    flight_profile(given)
    return str(given)


def _file(name: str, given: Any) -> str:
    if not isinstance(given, (str, os.PathLike)) or not str(given):
        raise checks.refused(name, given, "the path of a recording, or its name in $SINS_ENV_DATA")
    return str(given)


def _axis(axis: str, name: str, given: Any) -> Any:
    components_of(axis, given)
    return given


def _spectrum(name: str, given: Any) -> Any:
    sea(given)
    return given


def _table(name: str, given: Any) -> str:
    if not isinstance(given, (str, os.PathLike)):
        raise checks.refused(name, given, f"the path of a table that ends in {', '.join(TABLE_FILES)}")
    TrackPlan.of({"track": given})
    return str(given)


@dataclass(frozen=True)
class TrackSettings(FlightSettings):
    """Settings of a flight whose profile is a track."""

    profile: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.profile, Mapping) or "track" not in self.profile:
            raise checks.refused("motion.table", None, "the path of a table, which a motion of kind track needs")
        super().__post_init__()


def _smooth(name: str, given: Any) -> float:
    return checks.number(name, given, least=0.0, most=1e4)


def _events(name: str, given: Any) -> Any:
    check_events(given)
    return given


def _accepted(name: str, given: Any) -> Any:
    accepted(checks.items(given) or given)
    return given


def _window(name: str, given: Any) -> Any:
    check_window(given)
    return given


VIBRATION = Key("motion.vibration", "adds the vibration of 000 (2.5.5), at 250 to 400 Hz", "vibration", checks.flag)

#: Keys of the site that a flight along segments has in its plan.
PLAN_SITE = ("latitude_deg", "longitude_deg", "height_m", "heading_deg", "earth")

KINDS = {
    kind.name: kind
    for kind in (
        MotionKind(
            "sway",
            "a base that sways at its place: that of the thesis, or one's own",
            "SINS/AlignSway-v0",
            AlignSettings,
            (
                Key(
                    "motion.preset",
                    "the sway of 000 section 2.5.1, or amplitudes and periods that each run draws about it",
                    "motion",
                    one_of(*MOTIONS),
                ),
                *(
                    Key(
                        f"motion.{axis}",
                        f"{'angle about' if axis in TURNS else 'way along'} this axis: {WAVE}",
                        f"motion.{axis}",
                        partial(_axis, axis),
                    )
                    for axis in AXES
                ),
                Key(
                    "motion.spectrum",
                    "a sea: jonswap or bretschneider with height_m, peak_period_s and answers such as roll: {deg_per_m: 3}",
                    "motion.spectrum",
                    _spectrum,
                ),
                VIBRATION,
            ),
            apart=(("motion",), tuple(f"motion.{name}" for name in (*AXES, "spectrum"))),
        ),
        MotionKind("still", "a base that stands still", "SINS/AlignStatic-v0", AlignSettings, (VIBRATION,)),
        MotionKind(
            "vehicle",
            "a parked car with people about it; gps left out means zero-velocity updates",
            "SINS/AlignVehicle-v0",
            VehicleSettings,
            (
                Key(
                    "motion.scene",
                    "what happens: a scene, a list with one for each heading, or a script of events",
                    "events",
                    _events,
                ),
                Key(
                    "motion.events_per_min",
                    "mean number of events of a scene in a minute",
                    "event_rate_per_min",
                    number(least=0.0, most=60.0),
                ),
            ),
        ),
        MotionKind(
            "flight",
            "a flight along segments, or a profile of the papers",
            "SINS/NavFlight-v0",
            FlightSettings,
            (
                Key(
                    "motion.profile",
                    "a flight with its place, sensors and spreads, by name, or a file of a flight",
                    "profile",
                    _profile,
                    is_file=True,
                ),
                Key("motion.segments", "manoeuvres from the start on, as rows or dicts", "profile.segments", _segments),
                Key(
                    "motion.speed_mps", "speed at the start", "profile.speed_mps", number(least=0.0, most=MAX_SPEED_MPS)
                ),
            ),
            to={f"site.{name}": f"profile.{name}" for name in PLAN_SITE},
            defaults={"profile.latitude_deg": 39.96, "profile.longitude_deg": 116.3},
            apart=(("profile",), tuple(f"profile.{name}" for name in ("segments", "speed_mps", *PLAN_SITE))),
        ),
        MotionKind(
            "track",
            "a smooth motion through the places of a table, and perhaps with its attitudes",
            "SINS/NavFlight-v0",
            TrackSettings,
            (
                Key("motion.table", "the table of a track, a CSV or NPZ file", "profile.track", _table, is_file=True),
                Key("motion.bank", "roll in turns, if the table has none", "profile.bank", one_of(*BANKS)),
                Key("motion.smooth_m", "standard deviation of the places of the table", "profile.smooth_m", _smooth),
            ),
            to={f"site.{name}": f"profile.{name}" for name in ("latitude_deg", "longitude_deg", "height_m", "earth")},
        ),
        MotionKind(
            "recording",
            "windows of a recorded IMU with its fixes",
            "SINS/Replay-v0",
            ReplaySettings,
            (
                Key("motion.file", "the recording", "recording", _file, is_file=True),
                Key(
                    "motion.window_s",
                    "start and length of the first window; left out, all of the recording",
                    "window",
                    _window,
                ),
                Key(
                    "motion.stride_s",
                    "interval from the start of one window to that of the next",
                    "stride",
                    number(above=0.0),
                ),
                Key("motion.windows", "number of windows, which are the runs", "task.windows", whole(1, 1e6)),
                Key(
                    "motion.bridge_s",
                    "longest gap between samples that interpolated increments fill",
                    "bridge",
                    number(allowed=BRIDGES, least=0.0, most=MOST_BRIDGE_S),
                ),
                Key("motion.accept", "findings with which the recording is taken as it is", "accept", _accepted),
            ),
        ),
    )
}
