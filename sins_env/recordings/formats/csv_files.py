"""CSV files with any columns, which a mapping names (:mod:`sins_env.recordings.mapping`). Fields are not quoted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sins_env import attitude, checks
from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.recordings import column_units
from sins_env.recordings.assembling import assemble, check_unit, geodetic
from sins_env.recordings.axes import swap_ned, to_rfu, turned
from sins_env.recordings.clock import Samples, check_increasing, clocked
from sins_env.recordings.file_format import TEXT_KEYS, Format
from sins_env.recordings.mapping import Mapping, companion
from sins_env.recordings.recording import Gnss, Recording, Reference
from sins_env.recordings.text import Style, header, read_table, write_files

FRAMES = ("ENU", "NED")  #: allowed frames of vectors
_IMU_KEYS = ("time", "gyro", "accel")
_FIX_KEYS = ("file", "time", "position", "velocity", "position_std", "velocity_std")
_REFERENCE_KEYS = ("file", "time", "attitude", "velocity", "position")


@dataclass(frozen=True)
class _Part:
    """Columns of a file that one object of the mapping names."""

    path: Path
    delimiter: str
    has_header: bool | None
    spec: dict[str, Any]  #: description of each field, {"columns": [...], "unit": ...}

    @cached_property
    def _columns(self) -> dict[str, list[int]]:
        """Places of the columns of each field, counted from 0."""
        names = header(self.path, Style(delimiter=self.delimiter))
        names = [name.strip("\"' ") for name in names]
        found: dict[str, list[int]] = {}
        for field, spec in self.spec.items():
            found[field] = []
            for column in _named(spec):
                if isinstance(column, str):
                    if column not in names:
                        raise ValueError(f"{self.path}: {unknown(f'column of {field}', column, names)}")
                    found[field].append(names.index(column))
                elif isinstance(column, int) and not isinstance(column, bool) and 1 <= column <= len(names):
                    found[field].append(column - 1)
                else:
                    allowed = f"a name of the header line, or a whole number from 1 to {len(names)}"
                    raise ValueError(f"{self.path}: {checks.refused(f'column of {field}', column, allowed)}")
        return found

    @cached_property
    def table(self) -> Any:
        wanted = sorted({place for places in self._columns.values() for place in places})
        named = any(isinstance(column, str) for spec in self.spec.values() for column in _named(spec))
        style = Style(delimiter=self.delimiter, header=named if self.has_header is None else self.has_header)
        return wanted, read_table(self.path, None, style, wanted)

    def __getitem__(self, field: str) -> Array:
        """Return the columns of a field, (n, columns)."""
        wanted, table = self.table
        return table.rows[:, [wanted.index(place) for place in self._columns[field]]]

    def place(self, row: int) -> str:
        return self.table[1].place(row)

    def unit(self, field: str, allowed: Any, default: str | None = None) -> Any:
        given = self.spec[field].get("unit", default)
        if not isinstance(given, str) or given not in allowed:
            raise ValueError(f"{self.path}: {unknown(f'unit of {field}', given, allowed)}")
        return allowed[given]

    def enu(self, field: str) -> Array | None:
        """Return the vectors of a field in East-North-Up, (n, 3); None if the file has none."""
        if field not in self.spec:
            return None
        frame = self.spec[field].get("frame")
        if frame not in FRAMES:
            raise ValueError(f"{self.path}: {unknown(f'frame of {field}', frame, FRAMES)}")
        return swap_ned(self[field]) if frame == "NED" else self[field]

    def time(self) -> Array:
        """Return the stamps, s, which must ascend."""
        t = self["time"][:, 0] * self.unit("time", column_units.TIME, "s")
        check_increasing(str(self.path), "time", self.place, t)
        return t

    def position(self) -> Array:
        llh = self["position"]
        return geodetic(self.path, "position", self.place, llh, self.unit("position", column_units.ANGLE, "deg"))


def _named(spec: dict[str, Any]) -> Any:
    """Return the columns of a field, by names or numbers."""
    return [spec["column"]] if "column" in spec else spec["columns"]


def _part(path: Path, mapping: Mapping, whose: str, given: Any, keys: tuple[str, ...], counts: dict[str, Any]) -> _Part:
    """Check an object of the mapping. ``counts`` has the allowed numbers of columns of each field, and if it is needed."""
    if not isinstance(given, dict):
        raise checks.refused(f"{whose} of the mapping of {path.name}", given, f"an object of {', '.join(keys)}")
    for key in given:
        if key not in keys:
            raise unknown(f"key of {whose} in the mapping of {path.name}", key, keys)
    spec = {key: value for key, value in given.items() if key != "file" and value is not None}
    for field, (count, needed) in counts.items():
        if field not in spec:
            if needed:
                raise ValueError(f"{path}: {whose} without {field!r}; allowed: a mapping that names its columns")
            continue
        value = spec[field]
        columns = _named(value) if isinstance(value, dict) and len({"column", "columns"} & value.keys()) == 1 else None
        if not isinstance(columns, list) or len(columns) not in count:
            allowed = f'{{"columns": [{" or ".join(map(str, count))} of them], "unit": ...}}'
            raise checks.refused(f"{field} of the mapping of {path.name}", value, allowed)
        for key in value:
            if key not in ("column", "columns", "unit", "frame"):
                raise unknown(
                    f"key of {field} in the mapping of {path.name}", key, ("column", "columns", "unit", "frame")
                )
    where = companion(path, given["file"], f"{whose} of the mapping of {path.name}") if "file" in given else path
    return _Part(where, mapping.delimiter, mapping.header, spec)


def load(path: Path, mapping: Mapping) -> Recording:
    """Read the columns that the mapping names. Without a column of times, samples follow each other at ``rate_hz``.

    Raises:
        ValueError: a mapping that lacks axes, columns, units or times, or a table of the wrong form.
        FileNotFoundError: no such file beside it.
    """
    if mapping.axes is None:
        raise ValueError(f"{path}: no axes; allowed: a mapping with axes, columns and units, {path.stem}.json")
    given = {key: getattr(mapping, key) for key in _IMU_KEYS if getattr(mapping, key) is not None}
    if "time" not in given and mapping.rate_hz is None:
        raise ValueError(f"{path}: neither time nor rate_hz; allowed: a mapping with one of them")
    imu = _part(path, mapping, "imu", given, _IMU_KEYS, {"gyro": ((3,), 1), "accel": ((3,), 1), "time": ((1,), 0)})
    turn = to_rfu(mapping.axes)
    gyro, accel = imu.unit("gyro", column_units.GYRO), imu.unit("accel", column_units.ACCEL)
    dtheta, dvel = turned(imu["gyro"], turn) * gyro.si, turned(imu["accel"], turn) * accel.si
    if "time" in given:
        t = imu["time"][:, 0] * imu.unit("time", column_units.TIME, "s")
    else:
        t = np.arange(1, len(dtheta) + 1) / (mapping.rate_hz or 1.0)
    trapezoid = mapping.rates == "trapezoid"
    samples = Samples(str(imu.path), "time", imu.place, t, dtheta, dvel, gyro.rate, accel.rate, trapezoid)
    clock = clocked(samples, mapping.rate_hz, mapping.resample_hz, mapping.drop_duplicates)
    gnss = None if mapping.gnss is None else _gnss(path, mapping)
    reference = None if mapping.reference is None else _reference(path, mapping, turn)
    lever = None if mapping.lever_arm_m is None else turn @ np.array(mapping.lever_arm_m)
    return assemble(path, mapping, clock, gnss, reference, lever)


def _gnss(path: Path, mapping: Mapping) -> Gnss:
    three = {"velocity": ((3,), 0), "position_std": ((3,), 0), "velocity_std": ((3,), 0)}
    part = _part(path, mapping, "gnss", mapping.gnss, _FIX_KEYS, {"time": ((1,), 1), "position": ((3,), 1), **three})
    stds = (part.enu("position_std"), part.enu("velocity_std"))
    pos_std, vel_std = (None if std is None else np.abs(std) for std in stds)
    return Gnss(part.time(), part.enu("velocity"), part.position(), pos_std, vel_std)


def _reference(path: Path, mapping: Mapping, turn: Array) -> Reference:
    """Read the reference. Its attitude is heading, pitch and roll, or a quaternion, scalar first.

    The quaternion turns the file's axes into East-North-Up or North-East-Down.
    """
    three = {"velocity": ((3,), 0), "position": ((3,), 0)}
    given = mapping.reference
    part = _part(
        path, mapping, "reference", given, _REFERENCE_KEYS, {"time": ((1,), 1), "attitude": ((3, 4), 1), **three}
    )
    values = part["attitude"]
    if values.shape[1] == 3:
        heading, pitch, roll = (values * part.unit("attitude", column_units.ANGLE)).T
        q_nb = attitude.from_euler(heading, pitch, roll)
    else:
        q = check_unit(part.path, "attitude", part.place, values)
        frame = part.spec["attitude"].get("frame")
        if frame not in FRAMES:
            raise ValueError(f"{part.path}: {unknown('frame of attitude', frame, FRAMES)}")
        q_nb = q
        if mapping.axes != "RFU":
            q_nb = attitude.multiply(attitude.normalize(q_nb), attitude.from_dcm(turn.T))
        if frame == "NED":
            q_nb = attitude.multiply(attitude.from_dcm(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])), q_nb)
    pos = part.position() if "position" in part.spec else None
    return Reference(part.time(), q_nb, part.enu("velocity"), pos)


def save(recording: Recording, path: Path) -> list[Path]:
    """Write NAME.csv, NAME_gnss.csv and NAME_reference.csv, and the mapping NAME.json that reads them.

    They are Right-Forward-Up, East-North-Up and SI, so that every number comes back with its bits. Returns the paths.

    Raises:
        OSError: files that cannot be written.
    """
    here = np.flatnonzero(~recording.missing)
    t = recording.t0 + (here + 1) / recording.rate_hz
    site = recording.site
    mapping: dict[str, Any] = {
        "format": "csv",
        "file": path.name,
        "axes": "RFU",
        "rate_hz": recording.rate_hz,
        "site": [*np.degrees(site.pos[:2]).tolist(), site.height],
        "time": {"column": "t"},
        "gyro": {"columns": ["dtheta_x", "dtheta_y", "dtheta_z"], "unit": "rad"},
        "accel": {"columns": ["dvel_x", "dvel_y", "dvel_z"], "unit": "m/s"},
    }
    if recording.lever_arm is not None:
        mapping["lever_arm_m"] = recording.lever_arm.tolist()
    files = [_table(path, ("t", *_xyz("dtheta"), *_xyz("dvel")), t, recording.dtheta[here], recording.dvel[here])]
    gnss, ref = recording.gnss, recording.reference
    fixes, truth = FORMAT.beside(path)
    enu, llh = ("E", "N", "U"), ("latitude", "longitude", "height")
    if gnss is not None:
        mapping["gnss"], table = _companion(
            fixes,
            gnss.t_s,
            ("position", llh, {"unit": "rad"}, gnss.pos),
            ("velocity", tuple(f"v{x}" for x in enu), {"frame": "ENU"}, gnss.vel),
            ("position_std", tuple(f"std_{x}" for x in enu), {"frame": "ENU"}, gnss.pos_std),
            ("velocity_std", tuple(f"std_v{x}" for x in enu), {"frame": "ENU"}, gnss.vel_std),
        )
        files.append(table)
    if ref is not None:
        mapping["reference"], table = _companion(
            truth,
            ref.t_s,
            ("attitude", ("qw", "qx", "qy", "qz"), {"frame": "ENU"}, ref.q_nb),
            ("velocity", tuple(f"v{x}" for x in enu), {"frame": "ENU"}, ref.vel),
            ("position", llh, {"unit": "rad"}, ref.pos),
        )
        files.append(table)
    return write_files(files, path.with_suffix(".json"), mapping)


def _xyz(name: str) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}" for axis in "xyz")


def _table(path: Path, names: tuple[str, ...], *columns: Array) -> tuple[Path, str, Array]:
    """Return path, header with the format of a row, and rows of a table."""
    return path, ",".join(names) + "\n" + ",".join(["%r"] * len(names)), np.column_stack(columns)


def _companion(path: Path, t: Array, *fields: Any) -> tuple[dict[str, Any], tuple[Path, str, Array]]:
    """Return the object of the mapping, and the table, for the fields that the recording has."""
    there = [field for field in fields if field[3] is not None]
    spec = {name: {"columns": list(columns), **more} for name, columns, more, _ in there}
    names = ("t", *(column for _, columns, _, _ in there for column in columns))
    table = _table(path, names, t, *(values for *_, values in there))
    return {"file": path.name, "time": {"column": "t"}, **spec}, table


FORMAT = Format(
    "csv",
    ".csv",
    load,
    save,
    keys=(*TEXT_KEYS, "time", "gyro", "accel", "rates", "delimiter", "header"),
    companions=("_gnss", "_reference"),
    lacks=("displacements",),
)
