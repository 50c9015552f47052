"""A motion through a table of places: a smooth curve with exact derivatives, as a plan of one segment.

Splines of fifth degree pass through the rows, so velocity, acceleration and its rate of change are continuous. An attitude that
the table does not have follows from the course, the climb and coordinated turns. See docs/mathematics/simulation.md#tracks.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, checks, earth
from sins_env.arrays import Array
from sins_env.reading.archives import archive
from sins_env.reading.documents import YAML_ENDINGS, read_document
from sins_env.recordings.text.head import read_head
from sins_env.recordings.text.style import Style
from sins_env.recordings.text.table import read_table
from sins_env.trajectory.plan import (
    FLIGHT_FILES,
    MAX_LATITUDE_DEG,
    MAX_PITCH_DEG,
    MAX_SPEED_MPS,
    FlightPlan,
    Kinematics,
)
from sins_env.trajectory.segments import MOST_S, Segment
from sins_env.types import Site
from sins_env.units import DEG, G0

if TYPE_CHECKING:  # SciPy is slow to import, and needed for tracks only
    from scipy.interpolate import BSpline  # slow to import, needed by tracks only

DEGREE = 5
TABLE_FILES = (".csv", ".txt", ".npz")  #: endings of the files that may hold a table
MOST_ROWS = 1_000_000
MOST_VALUE, LEAST_STEP_S = 1e10, 1e-4  #: largest number of a table, and least time from a row to the next, s
#: Columns by name, with other names that files use.
NAMES = {
    "t": ("time", "t_s", "time_s", "timestamp"),
    "latitude_deg": ("lat", "latitude", "lat_deg"),
    "longitude_deg": ("lon", "lng", "long", "longitude", "lon_deg"),
    "height_m": ("height", "h", "h_m", "alt", "altitude", "alt_m", "altitude_m"),
    "east_m": ("east", "e", "e_m"),
    "north_m": ("north", "n", "n_m"),
    "up_m": ("up", "u", "u_m"),
    "heading_deg": ("heading", "yaw", "yaw_deg"),
    "pitch_deg": ("pitch",),
    "roll_deg": ("roll",),
}
PLACES, METRES = ("latitude_deg", "longitude_deg", "height_m"), ("east_m", "north_m", "up_m")
ANGLES = ("heading_deg", "pitch_deg", "roll_deg")
BANKS = ("coordinated", "level")  #: roll in turns, if the table has none
SETTINGS = ("track", "latitude_deg", "longitude_deg", "height_m", "smooth_m", "bank", "earth")
SLOW_MPS = 0.5  #: speed below which the course tells no heading
ANGLE_STEP_S, ANGLE_SMOOTH_S = (
    0.05,
    0.3,
)  #: grid of angles that follow from the motion, and the width of their smoothing
STILL_M = 0.01  #: distance from the first row within which the vehicle stands


@dataclass(frozen=True, eq=False)
class Track:
    """The curve through the places of a table, from its start."""

    site: Site
    metres: BSpline  #: E, N, U (..., 3) over time, with the radii of the start

    @cached_property
    def _derivatives(self) -> tuple[BSpline, BSpline]:
        first = self.metres.derivative()
        return first, first.derivative()

    def place(self, t: Array) -> Array:
        """Return latitude, longitude in rad and height in m (..., 3) at times ``t`` s."""
        moved = self.metres(t) / units_at(self.site)
        return self.site.pos + np.stack([moved[..., 1], moved[..., 0], moved[..., 2]], axis=-1)

    def velocity(self, t: Array) -> tuple[Array, Array]:
        """Return velocity E, N, U (..., 3) in m/s and its derivative at times ``t`` s."""
        place, units = self.place(t), units_at(self.site)
        latitude, height = place[..., 0], place[..., 2]
        (turn, north, up), (turn2, north2, up2) = (np.moveaxis(one(t) / units, -1, 0) for one in self._derivatives)
        model = earth.get(self.site.earth)
        R_M, R_N = earth.radii(model, latitude)
        s, c = np.sin(latitude), np.cos(latitude)
        growth = model.e2 * s * c / (1.0 - model.e2 * s * s)  # R_N' / R_N; R_M grows three times as fast
        circle = (R_N + height) * c
        vel = np.stack([circle * turn, (R_M + height) * north, up], axis=-1)
        accel = [
            circle * turn2 + ((R_N * growth * north + up) * c - (R_N + height) * s * north) * turn,
            (R_M + height) * north2 + (3.0 * R_M * growth * north + up) * north,
            up2,
        ]
        return vel, np.stack(accel, axis=-1)


def units_at(site: Site) -> Array:
    """Return the metres in a radian of longitude, in one of latitude, and in a metre of height, (3,)."""
    R_M, R_N = earth.radii(earth.get(site.earth), site.latitude)
    return np.array([(R_N + site.height) * np.cos(site.latitude), R_M + site.height, 1.0])


@dataclass(frozen=True, eq=False)
class TrackPlan(FlightPlan):
    """A plan whose motion is that of splines over time."""

    path: Track | None = None
    angles: BSpline | None = None  #: heading, pitch, roll (..., 3), rad
    still_s: float = 0.0  #: time for which it stands at first, s

    @classmethod
    def of(cls, given: Any, folder: Path | None = None) -> TrackPlan:
        """Make a plan from the path of a CSV or NPZ table, or from a dict.

        The dict has ``track``, a path or a dict of columns. Columns in metres have their origin at ``latitude_deg``,
        ``longitude_deg`` and ``height_m``. Turns have a ``bank``, "coordinated" or "level". With ``smooth_m``, the standard
        deviation of the places, the motion passes beside them.

        Args:
            given: what is described above.
            folder: folder of relative paths; None is the present one.

        Raises:
            ValueError: a table or a setting that does not fit; an error of a row says which.
            FileNotFoundError: no such file.
        """
        settings = dict(given) if isinstance(given, Mapping) else {"track": given}
        for name in settings:
            checks.choice("setting of the track", name, SETTINGS)
        source = settings.pop("track", None)
        is_path = isinstance(source, (str, os.PathLike))
        try:
            t, columns = _columns(source, folder)
            for name in settings if METRES[0] not in columns else ():
                if name in PLACES:
                    raise checks.refused(
                        name, settings[name], f"for a table of metres; this one has {', '.join(PLACES)}"
                    )
            return cls._of_columns(t, columns, **settings)
        except ValueError as error:
            if not is_path or str(source) in str(error):
                raise
            raise ValueError(f"{source}: {error}") from None

    @classmethod
    def _of_columns(
        cls,
        t: Array,
        columns: dict[str, Array],
        *,
        latitude_deg: float = 39.96,
        longitude_deg: float = 116.3,
        height_m: float = 0.0,
        smooth_m: float = 0.0,
        bank: str = "coordinated",
        earth: str = "wgs84",
    ) -> TrackPlan:
        checks.choice("bank", bank, BANKS)
        smooth = checks.number("smooth_m", smooth_m, least=0.0, most=1e4)
        site, metres = _metres(columns, (latitude_deg, longitude_deg, height_m), earth)
        path = Track(site, _spline(t, metres, smooth))
        moving = _Moving(path, float(t[-1]))
        moving.check(t)
        away = np.flatnonzero(np.linalg.norm(metres - metres[0], axis=1) > STILL_M)
        still = float(t[max(away[0] - 1, 0)]) if len(away) else float(t[-1])
        angles = _angles(t, columns, moving, bank)
        return cls(
            latitude_deg=site.latitude / DEG,
            longitude_deg=site.longitude / DEG,
            height_m=site.height,
            segments=(Segment(float(t[-1])),),
            earth=earth,
            speed_mps=float(np.linalg.norm(moving.vel[0])),
            heading_deg=float(angles(0.0)[0] / DEG),
            path=path,
            angles=angles,
            still_s=still,
        )

    @property
    def rest_s(self) -> float:
        """Time for which the vehicle stands still at first, s."""
        return self.still_s

    @cached_property
    def _rates(self) -> BSpline:
        assert self.angles is not None
        return self.angles.derivative()

    def kinematics(self, t: Array, segment: NDArray[np.intp]) -> Kinematics:
        """Return velocity and attitude with their derivatives at times ``t`` s; the results are (..., 3)."""
        assert self.path is not None
        assert self.angles is not None
        t = np.asarray(np.broadcast_arrays(t, segment)[0], dtype=float)
        return Kinematics(*self.path.velocity(t), self.angles(t), self._rates(t))

    def check_grid(self, dt: float) -> None:
        """Do nothing, because no rate jumps."""

    def summary(self) -> list[tuple[str, Array]]:
        """Return one row, "track" with the end: time in s, speed in m/s, then heading, pitch and roll in deg."""
        end = self.kinematics(self.ends_s, np.zeros(1, dtype=np.intp))
        return [("track", np.concatenate([self.ends_s, [np.linalg.norm(end.vel[0])], end.angles[0] / DEG]))]


class _Moving:
    """A motion on a grid of times, from which angles follow."""

    def __init__(self, path: Track, end: float) -> None:
        self.t = np.linspace(0.0, end, int(np.clip(end / ANGLE_STEP_S, 50, MOST_ROWS)) + 1)
        self.vel, self.accel = path.velocity(self.t)
        self.level = np.linalg.norm(self.vel[:, :2], axis=1)
        self.cautious = np.hypot(self.level, SLOW_MPS)  # which does not vanish at rest

    def check(self, t: Array) -> None:
        """Check that no speed is beyond the limits of an observation."""
        speed = np.linalg.norm(self.vel, axis=1)
        worst = int(np.argmax(speed))
        if not speed[worst] <= MAX_SPEED_MPS:
            row = int(np.clip(np.searchsorted(t, self.t[worst]), 1, len(t) - 1))
            raise ValueError(
                f"rows {row} and {row + 1}, {t[row - 1]:g} to {t[row]:g} s: a speed of {speed[worst]:.3g} m/s; "
                f"allowed: at most {MAX_SPEED_MPS:g} m/s"
            )

    def heading(self) -> Array:
        """Return the course, rad; while the vehicle is slow, it goes over from the last course to the next."""
        fast = self.level > SLOW_MPS
        if not fast.any():
            return np.zeros(len(self.t))
        course = np.unwrap(np.arctan2(self.vel[fast, 0], self.vel[fast, 1]))
        if len(course) < 2 or fast.all():
            return np.interp(self.t, self.t[fast], course)
        from scipy.interpolate import PchipInterpolator  # slow to import, needed by tracks only

        inside = np.clip(self.t, *self.t[fast][[0, -1]])
        return np.asarray(PchipInterpolator(self.t[fast], course)(inside))

    def pitch(self) -> Array:
        """Return the angle of climb, rad."""
        return np.arctan2(self.vel[:, 2], self.cautious)

    def roll(self) -> Array:
        """Return the bank at which gravity and the turn add up to a force without a part to the side, rad."""
        (east, north, _), (east2, north2, _) = self.vel.T, self.accel.T
        return np.arctan((north * east2 - east * north2) / self.cautious / G0)


def _angles(t: Array, columns: Mapping[str, Array], moving: _Moving, bank: str) -> BSpline:
    """Return the spline of heading, pitch and roll: of the table's angles, and of those that follow from the motion."""
    made = {"heading_deg": moving.heading, "pitch_deg": moving.pitch, "roll_deg": moving.roll}
    given = {name: np.unwrap(columns[name] * DEG) for name in ANGLES if name in columns}
    if np.any(np.abs(given.get("pitch_deg", 0.0)) > MAX_PITCH_DEG * DEG):
        row = int(np.argmax(np.abs(given["pitch_deg"])))
        raise ValueError(
            f"row {row + 1}: pitch {columns['pitch_deg'][row]:g} deg; allowed: -{MAX_PITCH_DEG:g} to {MAX_PITCH_DEG:g}"
        )
    if len(given) == len(ANGLES):
        return _spline(t, np.stack([given[name] for name in ANGLES], axis=-1))
    from scipy.ndimage import gaussian_filter1d  # slow to import, needed by tables without attitudes only

    width = ANGLE_SMOOTH_S / (moving.t[1] - moving.t[0])
    parts = []
    for name in ANGLES:
        if name in given:
            parts.append(_spline(t, given[name])(moving.t))
        elif name == "roll_deg" and bank == "level":
            parts.append(np.zeros(len(moving.t)))
        else:
            parts.append(gaussian_filter1d(made[name](), width, mode="nearest"))
    return _spline(moving.t, np.stack(parts, axis=-1))


def _spline(t: Array, values: Array, std: float = 0.0) -> BSpline:
    """Return the spline of fifth degree through values (n,) or (n, c); with a standard deviation a smoother one beside them."""
    from scipy.interpolate import BSpline, make_interp_spline, make_splprep  # slow to import, needed by tracks only

    if not std:
        return make_interp_spline(t, values, k=DEGREE)
    smooth, _ = make_splprep(values.T, u=t, k=DEGREE, s=values.size * std**2)
    return BSpline(smooth.t, smooth.c, DEGREE)


def _metres(columns: Mapping[str, Array], origin: tuple[float, float, float], model: str) -> tuple[Site, Array]:
    """Return the place of the start, and metres E, N, U from it with its radii, (n, 3)."""
    checks.choice("earth model", model, earth.EARTHS)
    if METRES[0] in columns:
        names = ("latitude_deg", "longitude_deg", "height_m")
        limits = ((-89.0, 89.0), (-180.0, 180.0), (-1e3, 1e5))
        lat, lon, height = (
            checks.number(n, v, least=a, most=b) for n, v, (a, b) in zip(names, origin, limits, strict=True)
        )
        units = units_at(Site(lat * DEG, lon * DEG, height, model))
        moved = np.stack([columns[name] for name in METRES], axis=-1) / units
        place = moved[:, [1, 0, 2]] + np.array([lat * DEG, lon * DEG, height])
    else:
        place = np.stack([columns[name] for name in PLACES], axis=-1) * [DEG, DEG, 1.0]
        place[:, 1] = np.unwrap(place[:, 1])
    bad = np.flatnonzero(~(np.abs(place[:, 0]) <= MAX_LATITUDE_DEG * DEG))
    if len(bad):
        lat = place[bad[0], 0] / DEG
        raise ValueError(
            f"row {bad[0] + 1}: latitude {lat:g} deg; allowed: -{MAX_LATITUDE_DEG:g} to {MAX_LATITUDE_DEG:g} deg"
        )
    site = Site(place[0, 0], float(attitude.wrap(place[0, 1])), place[0, 2], model)
    return site, (place - place[0])[:, [1, 0, 2]] * units_at(site)


def _columns(source: Any, folder: Path | None) -> tuple[Array, dict[str, Array]]:
    """Return times from zero on, and the columns of a table by name; in the places there are no gaps."""
    if isinstance(source, (str, os.PathLike)):
        found = _read(Path(source) if folder is None else folder / source)
    elif isinstance(source, Mapping):
        found = {
            str(name): np.asarray(checks.numbers(str(name), value, None, "numbers")) for name, value in source.items()
        }
    else:
        raise checks.refused("track", source, "the path of a CSV or NPZ table, or a dict of columns")
    columns = {}
    for name, values in found.items():
        known = known_column(name)
        if known in columns:
            raise ValueError(f"column {name!r} is a second {known}; allowed: one of each")
        if known:
            columns[known] = values
    if all(name in columns for name in PLACES):  # they say more than metres beside them, which have an unknown origin
        columns = {name: values for name, values in columns.items() if name not in METRES}
    needed = METRES if any(name in columns for name in METRES) else PLACES
    missing = [name for name in ("t", *needed) if name not in columns]
    if missing:
        raise ValueError(
            f"no column {', '.join(missing)} among {', '.join(found)}; allowed: t with {', '.join(PLACES)}, or with "
            f"{', '.join(METRES)}, and perhaps {', '.join(ANGLES)}"
        )
    _check_rows(columns)
    t = columns.pop("t")
    return t - t[0], columns


def _check_rows(columns: Mapping[str, Array]) -> None:
    sizes = {name: len(values) for name, values in columns.items()}
    if len(set(sizes.values())) > 1:
        raise ValueError(
            f"columns of {', '.join(f'{n} {name}' for name, n in sizes.items())}; allowed: as many of each"
        )
    count = sizes["t"]
    if not DEGREE < count <= MOST_ROWS:
        raise ValueError(f"{count} rows; allowed: {DEGREE + 1} to {MOST_ROWS}")
    for name, values in columns.items():
        bad = np.flatnonzero(~(np.abs(values) <= MOST_VALUE))
        if len(bad):
            raise ValueError(
                f"row {bad[0] + 1}: {name} is {values[bad[0]]:g}; allowed: numbers up to {MOST_VALUE:g} in size"
            )
    t = columns["t"]
    back = np.flatnonzero(~(np.diff(t) >= LEAST_STEP_S))
    if len(back):
        a, b = t[back[0] : back[0] + 2]
        raise ValueError(
            f"row {back[0] + 2}: t = {b:.10g} s after {a:.10g} s; allowed: times that grow by {LEAST_STEP_S:g} s or more"
        )
    if t[-1] - t[0] > MOST_S:
        raise ValueError(f"{t[-1] - t[0]:g} s from the first row to the last; allowed: at most {MOST_S:g} s, a week")


def known_column(name: str) -> str:
    """Return the column that a name means, or an empty text."""
    plain = name.strip().lower()
    return next((known for known, others in NAMES.items() if plain == known or plain in others), "")


def column_names(path: Path) -> list[str]:
    """Return the names of the columns of a CSV file with a header, or of the arrays of an NPZ file; none without a header.

    Raises:
        ValueError: no such table.
    """
    if path.suffix.lower() == ".npz":
        with archive(path) as arrays:
            return list(arrays.keys())
    return list(read_head(path, Style(header=None), measured=True).names or ())


def _read(path: Path) -> dict[str, Array]:
    """Read the table of a CSV file with a header, or the arrays of an NPZ file."""
    ending = path.suffix.lower()
    if ending not in TABLE_FILES:
        raise ValueError(f"{path}: no table of a track; allowed: a file that ends in {', '.join(TABLE_FILES)}")
    if not path.is_file():
        raise FileNotFoundError(f"no file {checks.shown(str(path))}; allowed: the path of a table")
    if ending == ".npz":
        with archive(path) as arrays:
            return {name: _real(name, arrays.read(name)) for name in filter(known_column, arrays.keys())}
    head = read_head(path, Style(header=None), measured=True)
    if not head.names:
        raise ValueError(
            f"{path}: no header; allowed: names of the columns in the first row, such as t, {', '.join(PLACES)}"
        )
    rows = read_table(path, None, head).rows
    return dict(zip(head.names, rows.T, strict=False))


def _real(name: str, values: NDArray[Any]) -> Array:
    if values.dtype.kind not in "biuf":
        raise ValueError(f"{name} holds values of type {values.dtype}; allowed: real numbers")
    return values.astype(float).ravel()


def plan_of(given: Any) -> FlightPlan:
    """Make a plan from a flight or a track: a dict, a YAML or JSON file with one, a table of places, or a plan.

    Raises:
        ValueError: an impossible flight or track.
        FileNotFoundError: no such file.
    """
    if isinstance(given, FlightPlan):
        return given
    if isinstance(given, (str, os.PathLike)) and Path(given).suffix.lower() in TABLE_FILES:
        return TrackPlan.of(given)
    if isinstance(given, Mapping):
        return TrackPlan.of(given) if "track" in given else FlightPlan.of(given)
    path = Path(given)
    fields = read_document(path) if path.suffix.lower() in (*YAML_ENDINGS, *FLIGHT_FILES) else None
    if isinstance(fields, Mapping) and "track" in fields:
        try:
            return TrackPlan.of(fields, path.parent)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
    return FlightPlan.of(given)
