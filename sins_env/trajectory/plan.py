"""A flight plan: its start, its segments, and the closed forms of velocity and attitude that follow from them.

A plan is a dict of the fields of :class:`FlightPlan`, in Python or in a YAML or JSON file.
See docs/mathematics/simulation.md#flight-plan.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env import checks, earth
from sins_env.arrays import Array
from sins_env.checks import build
from sins_env.reading.documents import YAML_ENDINGS, read_document
from sins_env.trajectory.segments import MOST_S, Segment
from sins_env.types import Site
from sins_env.units import DEG

MAX_PITCH_DEG, MAX_ROLL_DEG, MAX_HEADING_DEG = 85.0, 180.0, 1e6
MAX_SEGMENTS = 10_000
#: Largest latitude of the track on a sphere, which is off by less than 0.1 deg. The local-level frame ends at 89.9.
MAX_LATITUDE_DEG = 89.0
MAX_SPEED_MPS, MIN_HEIGHT_M, MAX_HEIGHT_M = 1e4, -1e3, 1e5  #: limits of the observation space
FLIGHT_FILES = (*YAML_ENDINGS, ".json")  #: endings of the files that may hold a plan


class Kinematics(NamedTuple):
    """Velocity and attitude with their derivatives at some instants."""

    vel: Array  #: (..., 3) m/s E, N, U
    accel: Array  #: (..., 3) m/s^2, the derivative of ``vel``
    angles: Array  #: (..., 3) heading, pitch, roll, rad
    rates: Array  #: (..., 3) their derivatives, rad/s


@dataclass(frozen=True)
class FlightPlan:
    """A flight from a place, a speed and a heading along its segments. It starts with zero pitch and roll.

    Raises:
        ValueError: an impossible flight; the error names the segment.
    """

    latitude_deg: float
    longitude_deg: float
    segments: tuple[Segment, ...]
    height_m: float = 0.0
    speed_mps: float = 0.0
    heading_deg: float = 0.0
    earth: str = "wgs84"

    def __post_init__(self) -> None:
        checks.choice("earth model", self.earth, earth.EARTHS)
        checks.keep(
            self,
            "latitude_deg",
            checks.number,
            f"-{MAX_LATITUDE_DEG:g} to {MAX_LATITUDE_DEG:g}",
            least=-MAX_LATITUDE_DEG,
            most=MAX_LATITUDE_DEG,
        )
        checks.keep(self, "longitude_deg", checks.number, "-180 to 180", least=-180.0, most=180.0)
        checks.keep(self, "height_m", checks.number, least=MIN_HEIGHT_M, most=MAX_HEIGHT_M)
        checks.keep(self, "speed_mps", checks.number, least=0.0, most=MAX_SPEED_MPS)
        allowed = f"a finite number, -{MAX_HEADING_DEG:g} to {MAX_HEADING_DEG:g}"
        checks.keep(self, "heading_deg", checks.number, allowed, least=-MAX_HEADING_DEG, most=MAX_HEADING_DEG)
        rows = checks.items(self.segments)
        if not rows:
            raise checks.refused("segments", self.segments, "a list of at least one segment")
        if len(rows) > MAX_SEGMENTS:
            raise ValueError(f"{len(rows)} segments; allowed: at most {MAX_SEGMENTS}")
        segments = []
        for number, given in enumerate(rows, start=1):
            try:
                segments.append(Segment.of(given))
            except ValueError as error:
                raise ValueError(f"segment {number} ({checks.shown(given)}): {error}") from None
        object.__setattr__(self, "segments", tuple(segments))
        if self.duration_s > MOST_S:
            raise ValueError(f"the segments last {self.duration_s:g} s together; allowed: at most {MOST_S:g} s, a week")
        self._check_corners()
        self._check_path()

    @classmethod
    def of(cls, given: Any) -> FlightPlan:
        """Make a plan from a dict of its fields, or from the path of a YAML or JSON file with them.

        A plan is returned as it is.

        Raises:
            ValueError: an impossible flight, or a field that does not exist.
            FileNotFoundError: no such file.
        """
        if isinstance(given, FlightPlan):
            return given
        if not isinstance(given, (str, os.PathLike)):
            return cls._of_fields(given)
        path = Path(given)
        fields = _read(path)
        try:
            return cls._of_fields(fields)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    @classmethod
    def _of_fields(cls, given: Any) -> FlightPlan:
        if not isinstance(given, Mapping):
            raise checks.refused(
                "flight", given, "a dict of latitude_deg, longitude_deg, segments, ..., or a file with it"
            )
        for field in ("latitude_deg", "longitude_deg", "segments"):
            if field not in given:
                raise ValueError(f"the flight has no {field}; it needs latitude_deg, longitude_deg and segments")
        return build(cls, given, "the flight")

    @property
    def site(self) -> Site:
        """The place at which the flight starts."""
        return Site(self.latitude_deg * DEG, self.longitude_deg * DEG, self.height_m, self.earth)

    @cached_property
    def ends_s(self) -> Array:
        """Times at which the segments end, s, (segments,)."""
        return np.cumsum([segment.duration_s for segment in self.segments])

    @property
    def duration_s(self) -> float:
        """Length of the flight, s."""
        return float(self.ends_s[-1])

    @property
    def rest_s(self) -> float:
        """Time for which the vehicle stands still at first, s."""
        still = 0.0
        if self.speed_mps == 0:
            for segment in self.segments:
                if segment.manoeuvre != "cruise":
                    break
                still += segment.duration_s
        return still

    @cached_property
    def _table(self) -> tuple[Array, Array, Array]:
        """Numbers of the S segments, angles in rad.

        They are durations (S,), rates of speed, heading, pitch and roll at the start (S, 4), and slopes of the heading
        rate (S,).
        """
        T = np.array([s.duration_s for s in self.segments])
        heading = DEG * np.array([s.heading_rates_deg_s for s in self.segments])
        others = np.array([(s.accel_mps2, s.pitch_rate_deg_s, s.roll_rate_deg_s) for s in self.segments])
        rates = np.column_stack([others[:, 0], heading[:, 0], DEG * others[:, 1:]])
        return T, rates, (heading[:, 1] - heading[:, 0]) / T

    @cached_property
    def _corners(self) -> Array:
        """Speed, heading, pitch and roll at the start and after each segment, (S + 1, 4)."""
        T, rates, slope = self._table
        steps = rates * T[:, None]
        steps[:, 1] += 0.5 * slope * T**2
        return np.cumsum(np.vstack([[self.speed_mps, self.heading_deg * DEG, 0.0, 0.0], steps]), axis=0)

    def kinematics(self, t: Array, segment: NDArray[np.intp]) -> Kinematics:
        """Return velocity and attitude with their derivatives at times ``t`` s, which lie in the given segments.

        ``t`` and ``segment``, an index, are arrays whose shapes broadcast; results are (..., 3).
        """
        _, rates, slope = self._table
        since = t - np.concatenate([[0.0], self.ends_s])[segment]
        accel, turn, pitching, rolling = np.moveaxis(rates[segment], -1, 0)
        speed, heading, pitch, roll = np.moveaxis(self._corners[segment], -1, 0)
        speed, pitch, roll = speed + accel * since, pitch + pitching * since, roll + rolling * since
        heading = heading + (turn + 0.5 * slope[segment] * since) * since
        turn = turn + slope[segment] * since
        cp, sp, ch, sh = np.cos(pitch), np.sin(pitch), np.cos(heading), np.sin(heading)
        forward = np.stack([cp * sh, cp * ch, sp], axis=-1)
        turning = np.stack(
            [cp * ch * turn - sp * sh * pitching, -cp * sh * turn - sp * ch * pitching, cp * pitching], -1
        )
        return Kinematics(
            speed[..., None] * forward,
            accel[..., None] * forward + speed[..., None] * turning,
            np.stack([heading, pitch, roll], axis=-1),
            np.stack(np.broadcast_arrays(turn, pitching, rolling), axis=-1),
        )

    def check_grid(self, dt: float) -> None:
        """Check that segments end on the grid of IMU samples of ``dt`` s, because rates jump there.

        Raises:
            ValueError: a segment that ends between two samples; the error says when it may end.
        """
        off = self.ends_s / dt - np.rint(self.ends_s / dt)
        bad = np.flatnonzero(np.abs(off) > 1e-6)
        if len(bad):
            end = self.ends_s[bad[0]]
            raise ValueError(
                f"{self._named(bad[0])} ends at {end:g} s, between IMU samples of {dt:g} s; allowed: the ends of samples, "
                f"for instance {np.rint(end / dt) * dt:g} s"
            )

    def summary(self) -> list[tuple[str, Array]]:
        """Return manoeuvre and end of each segment.

        The end is (5,): time in s, speed in m/s, then heading, pitch and roll in deg.
        """
        ends = np.column_stack([self.ends_s, self._corners[1:] / [1.0, DEG, DEG, DEG]])
        return [(segment.manoeuvre, end) for segment, end in zip(self.segments, ends, strict=True)]

    def _named(self, i: int) -> str:
        end, segment = self.ends_s[i], self.segments[i]
        return f"segment {i + 1} ({segment.manoeuvre}, {end - segment.duration_s:g} to {end:g} s)"

    def _check_corners(self) -> None:
        """Check speed, pitch and roll at the ends of the segments; in between they are linear."""
        rad = 1.0 / DEG
        limits = (
            (0, "speed {:g} m/s", 1.0, 0.0, MAX_SPEED_MPS),
            (2, "pitch {:g} deg", rad, -MAX_PITCH_DEG, MAX_PITCH_DEG),
            (3, "roll {:g} deg", rad, -MAX_ROLL_DEG, MAX_ROLL_DEG),
        )
        for i, corner in enumerate(self._corners[1:]):
            for column, what, unit, low, high in limits:
                value = unit * corner[column]
                if not low - 1e-6 <= value <= high + 1e-6:
                    raise ValueError(f"{self._named(i)} ends at {what.format(value)}; allowed: {low:g} to {high:g}")

    def track(self) -> tuple[Array, NDArray[np.intp], Kinematics, Array]:
        """Return a track with a point every second or more often, for figures and checks.

        It holds times (N,) in s, indices of segments (N,), kinematics (N, ...) and metres E, N, U from the start (N, 3).
        The metres come from the trapezoidal rule on a flat Earth; the truth is :class:`sins_env.trajectory.flight.Flight`.
        """
        t = np.linspace(0.0, self.duration_s, max(int(self.duration_s), 200) + 1)
        segment = np.minimum(np.searchsorted(self.ends_s, t), len(self.segments) - 1)
        at = self.kinematics(t, segment)
        steps = 0.5 * (at.vel[1:] + at.vel[:-1]) * np.diff(t)[:, None]
        return t, segment, at, np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])

    def _check_path(self) -> None:
        """Check that latitude and height stay within the domain of the frame and of the observations."""
        _, segment, _, moved = self.track()
        latitude, height = self.latitude_deg + moved[:, 1] / 6.37e6 / DEG, self.height_m + moved[:, 2]
        for what, value, low, high in (
            ("latitude {:.5g} deg", latitude, -MAX_LATITUDE_DEG, MAX_LATITUDE_DEG),
            ("height {:.5g} m", height, MIN_HEIGHT_M, MAX_HEIGHT_M),
        ):
            out = np.flatnonzero((value < low) | (value > high))
            if len(out):
                where = f"{self._named(segment[out[0]])} leads to {what.format(value[out[0]])}"
                raise ValueError(f"{where}; allowed: {low:g} to {high:g}")


def _read(path: Path) -> Any:
    """Read a YAML or JSON file."""
    if path.suffix.lower() not in FLIGHT_FILES:
        raise ValueError(f"{path}: no flight; allowed: a file that ends in {', '.join(FLIGHT_FILES)}")
    return read_document(path)
