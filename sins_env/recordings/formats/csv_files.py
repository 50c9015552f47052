"""CSV and other text tables with any columns, which a mapping names (:mod:`sins_env.recordings.mapping`)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.recordings import column_units
from sins_env.recordings.assembling import assemble, check_unit
from sins_env.recordings.axes import to_rfu, turned
from sins_env.recordings.clock import Samples, clocked
from sins_env.recordings.columns import FRAMES, PARTS_OF_DATE, Part, make_part, unwrapped
from sins_env.recordings.file_format import TEXT_KEYS, Format, unpacked_name
from sins_env.recordings.formats import rtklib
from sins_env.recordings.mapping import Mapping, companion
from sins_env.recordings.readings import WAYS, readings_of
from sins_env.recordings.recording import Gnss, Readings, Recording, Reference
from sins_env.recordings.text import read_head, write_files
from sins_env.recordings.times import Times, on_scale_of

_FIX_KEYS = ("file", "time", "position", "velocity", "position_std", "velocity_std")
_REFERENCE_KEYS = ("file", "time", "attitude", "velocity", "position")
_TIME = (1, 2, PARTS_OF_DATE)  #: allowed numbers of columns of times
#: Names of columns that count samples, without signs, in lower case.
COUNTERS = ("packetcounter", "counter", "samplecounter", "packetcount", "framecount", "seq", "sequence")


def load(path: Path, mapping: Mapping) -> Recording:
    """Read the columns that the mapping names.

    Without a column of times, samples follow each other at ``rate_hz``, counted by a column that counts them if there is one.

    Raises:
        ValueError: a mapping that lacks axes, columns, units or times, or a table of the wrong form.
        FileNotFoundError: no such file beside it.
    """
    if mapping.axes is None:
        raise ValueError(
            f"{path}: no axes; allowed: a mapping with axes, columns and units, {unpacked_name(path).stem}.json"
        )
    if mapping.time is None and mapping.rate_hz is None:
        raise ValueError(f"{path}: neither time nor rate_hz; allowed: a mapping with one of them")
    parts = _inertial(path, mapping)
    turn, gyros, accels = to_rfu(mapping.axes), parts["gyro"], parts["accel"]
    gyro, accel = gyros.unit("gyro", column_units.GYRO), accels.unit("accel", column_units.ACCEL)
    increments = [turned(gyros.view("gyro"), turn), turned(accels.view("accel"), turn)]
    for values, unit in zip(increments, (gyro, accel), strict=True):
        values *= unit.si
    many = len(increments[0])
    times = parts["time"].times() if "time" in parts else _counted(path, mapping, parts, many)
    for name, found in (("accel", len(increments[1])), ("time", len(times.t))):
        if found != many:
            where = parts.get(name, accels).path
            raise ValueError(f"{where}: {found} rows, {gyros.path.name} {many}; allowed: a row for each sample in both")
    trapezoid, stamped = mapping.rates == "trapezoid", parts.get("time", gyros)
    units = (gyro.rate, accel.rate, trapezoid, _stamped_counter(path, mapping, parts), times.scale)
    for part in parts.values():
        part.release()
    del values
    clock = clocked(  # which alone holds what was read, and lets it go
        Samples(str(stamped.path), "time", stamped.place, times.t, increments.pop(0), increments.pop(0), *units),
        mapping.rate_hz,
        mapping.resample_hz,
        mapping.drop_duplicates,
    )
    gnss = None if mapping.gnss is None else _gnss(path, mapping, times)
    reference = None if mapping.reference is None else _reference(path, mapping, turn, times)
    lever = None if mapping.lever_arm_m is None else turn @ np.array(mapping.lever_arm_m)
    aids = readings_of(path, mapping, times)
    return replace(assemble(path, mapping, clock, gnss, reference, lever), aids=aids)


def _inertial(path: Path, mapping: Mapping) -> dict[str, Part]:
    """Return the part with the columns of each field; fields of one file share theirs."""
    counts: dict[str, tuple[tuple[int, ...], bool]] = {
        "gyro": ((3,), True),
        "accel": ((3,), True),
        "time": (_TIME, False),
        "counter": ((1,), False),
    }
    given = {key: value for key in counts if (value := getattr(mapping, key)) is not None}
    whole = make_part(path, mapping, "imu", given, tuple(counts), counts)
    files: dict[Path, list[str]] = {}
    for field, spec in whole.spec.items():
        where = companion(path, spec["file"], f"{field} of the mapping of {path.name}") if "file" in spec else path
        files.setdefault(where, []).append(field)
    return {
        field: part
        for where, fields in files.items()
        for part in [Part(where, whole.style, whole.measured, {field: whole.spec[field] for field in fields})]
        for field in fields
    }


def _counted(path: Path, mapping: Mapping, parts: dict[str, Part], many: int) -> Times:
    """Return the times of samples at ``rate_hz``, which a counter numbers; lost ones leave a gap."""
    rate = mapping.rate_hz or 1.0
    counter = parts.get("counter") or _found_counter(path, mapping)
    count = np.arange(1.0, many + 1)
    if counter is not None:
        values = counter["counter"][:, 0]
        values = unwrapped(values, counter.spec["counter"].get("wraps") or _modulus(values))
        if mapping.counter is not None or np.mean(np.diff(values) == 1) > 0.5:
            count = values - values[0] + 1
    return Times(count / rate)


def _stamped_counter(path: Path, mapping: Mapping, parts: dict[str, Part]) -> Array | None:
    """Return the counter of samples that have stamps, too, (n,); one that the mapping does not name must count each of them."""
    if "time" not in parts:
        return None
    if "counter" in parts:
        return parts["counter"]["counter"][:, 0]
    found = _found_counter(path, mapping) if parts["gyro"].path == path else None
    values = None if found is None else found["counter"][:, 0]
    steps = np.zeros(0) if values is None else np.diff(unwrapped(values, _modulus(values)))
    return values if len(steps) and steps.min() >= 1 and np.mean(steps == 1) > 0.5 else None


def _found_counter(path: Path, mapping: Mapping) -> Part | None:
    """Return the column that counts the samples, judged by its name."""
    head = read_head(path, mapping.style(), mapping.delimiter is None)
    for name in head.names:
        if "".join(filter(str.isalnum, name)).lower() in COUNTERS:
            return Part(path, mapping.style(), mapping.delimiter is None, {"counter": {"column": name}})
    return None


def _modulus(values: Array) -> float:
    """Return the least power of two bytes that a counter stays below: there it begins again."""
    top = float(np.max(values))
    return next((float(2**bits) for bits in (8, 16, 32) if top < 2**bits), float(2**64))


def _gnss(path: Path, mapping: Mapping, imu: Times) -> Gnss:
    counts: dict[str, tuple[tuple[int, ...], bool]] = {"time": (_TIME, True), "position": ((3,), True)}
    counts |= {name: ((3,), False) for name in ("velocity", "position_std", "velocity_std")}
    if isinstance(mapping.gnss, str):
        return _fixes_of(companion(path, mapping.gnss, f"gnss of the mapping of {path.name}"), imu)
    part = make_part(path, mapping, "gnss", mapping.gnss, _FIX_KEYS, counts, optional=True)
    stds = (part.enu("position_std"), part.enu("velocity_std"))
    pos_std, vel_std = (None if std is None else np.abs(std) for std in stds)
    t = on_scale_of(part.increasing(), imu, part.path, "fixes")
    return Gnss(t, part.enu("velocity"), part.position(), pos_std, vel_std)


def _fixes_of(path: Path, imu: Times) -> Gnss:
    """Read the fixes of a file that describes itself."""
    if not rtklib.holds_fixes(path):
        allowed = f"an object of {', '.join(_FIX_KEYS)}, or a .pos file of RTKLIB"
        raise ValueError(f"{path}: no fixes that describe themselves; allowed: {allowed}")
    return rtklib.fixes(path, imu)


def _reference(path: Path, mapping: Mapping, turn: Array, imu: Times) -> Reference:
    """Read the reference. Its attitude is heading, pitch and roll, or a quaternion, scalar first.

    The quaternion turns the file's axes into East-North-Up or North-East-Down.
    """
    counts: dict[str, tuple[tuple[int, ...], bool]] = {"time": (_TIME, True), "attitude": ((3, 4), True)}
    counts |= {name: ((3,), False) for name in ("velocity", "position")}
    part = make_part(path, mapping, "reference", mapping.reference, _REFERENCE_KEYS, counts, optional=True)
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
    t = on_scale_of(part.increasing(), imu, part.path, "the reference")
    return Reference(t, q_nb, part.enu("velocity"), pos)


def save(recording: Recording, path: Path) -> list[Path]:
    """Write NAME.csv, NAME_gnss.csv and NAME_reference.csv, and the mapping NAME.json that reads them.

    They are Right-Forward-Up, East-North-Up and SI, so that every number comes back with its bits. Returns the paths.

    Raises:
        OSError: files that cannot be written.
    """
    here = np.flatnonzero(~recording.missing)
    t = recording.t0 + (here + 1) / recording.rate_hz
    site = recording.site
    time = {"column": "t"} | ({} if recording.scale is None else {"scale": recording.scale})
    mapping: dict[str, Any] = {
        "format": "csv",
        "file": path.name,
        "axes": "RFU",
        "rate_hz": recording.rate_hz,
        "site": [*np.degrees(site.pos[:2]).tolist(), site.height],
        "time": time,
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
            time,
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
            time,
            ref.t_s,
            ("attitude", ("qw", "qx", "qy", "qz"), {"frame": "ENU"}, ref.q_nb),
            ("velocity", tuple(f"v{x}" for x in enu), {"frame": "ENU"}, ref.vel),
            ("position", llh, {"unit": "rad"}, ref.pos),
        )
        files.append(table)
    for name, readings in recording.aids.items():
        held = _held(name, readings)
        there, table = _companion(path.with_name(f"{path.stem}_{name}{path.suffix}"), time, readings.t_s, *held)
        mapping.setdefault("aids", {})[name] = there
        files.append(table)
    return write_files(files, path.with_suffix(".json"), mapping)


def _held(name: str, readings: Readings) -> list[tuple[str, tuple[str, ...], dict[str, Any], Array]]:
    """Return field, columns, unit and values of the readings of an aid, in the first way of ``WAYS`` that holds them."""
    values = readings.values
    if readings.unit:
        heading = np.arctan2(values[:, 0], values[:, 1])[:, None]
        angles: list[tuple[str, tuple[str, ...], dict[str, Any], Array]] = [
            ("heading", ("heading",), {"unit": "rad"}, heading)
        ]
        if values.shape[1] == 3:
            angles.append(("pitch", ("pitch",), {"unit": "rad"}, np.arcsin(np.clip(values[:, 2:], -1.0, 1.0))))
        return angles
    if name == "heading":
        return [("baseline", ("E", "N", "U"), {"unit": "m", "frame": "ENU"}, values)]
    field = next(iter(WAYS[name][0].columns))
    unit = {"dvl": "m/s", "magnetometer": "T"}.get(name, "m")
    columns = _xyz(field) if values.shape[1] == 3 else (field,)
    return [(field, columns, {"unit": unit}, values)]


def _xyz(name: str) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}" for axis in "xyz")


def _table(path: Path, names: tuple[str, ...], *columns: Array) -> tuple[Path, str, Array]:
    """Return path, header with the format of a row, and rows of a table."""
    return path, ",".join(names) + "\n" + ",".join(["%r"] * len(names)), np.column_stack(columns)


def _companion(
    path: Path, time: dict[str, Any], t: Array, *fields: Any
) -> tuple[dict[str, Any], tuple[Path, str, Array]]:
    """Return the object of the mapping, and the table, for the fields that the recording has."""
    there = [field for field in fields if field[3] is not None]
    spec = {name: {"columns": list(columns), **more} for name, columns, more, _ in there}
    names = ("t", *(column for _, columns, _, _ in there for column in columns))
    table = _table(path, names, t, *(values for *_, values in there))
    return {"file": path.name, "time": time, **spec}, table


FORMAT = Format(
    "csv",
    ".csv",
    load,
    save,
    keys=(*TEXT_KEYS, "time", "gyro", "accel", "rates", "delimiter", "header", "counter", "aids"),
    companions=("_gnss", "_reference"),
    lacks=("displacements",),
)
