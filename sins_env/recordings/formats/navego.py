"""NaveGo MATLAB files: ``.mat`` with structs of IMU, GNSS and reference.

The structs are those that rodralez/NaveGo's examples make (``ins_gnss.m``), Forward-Right-Down and North-East-Down:

    IMU        t s; fb (n, 3) specific force m/s^2; wb (n, 3) angular rate rad/s
    GNSS       t s; lat, lon rad; h m; vel (n, 3) m/s; stdm (3,) or (n, 3) m; stdv m/s; larm (3,) lever arm m
    reference  t s; roll, pitch, yaw rad, yaw clockwise from north; and lat, lon, h, vel if it has them

A struct is known by its fields. If several have those of an IMU, the mapping names one (``imu``).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.reading.matlab import MatFile, read_matlab
from sins_env.recordings.assembling import assemble, geodetic
from sins_env.recordings.axes import swap_ned, to_rfu, turned
from sins_env.recordings.clock import Samples, check_increasing, clocked
from sins_env.recordings.file_format import SITE_KEYS, Format
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Gnss, Recording, Reference

AXES = "FRD"
_IMU = {"t", "fb", "wb"}
_GNSS = {"t", "lat", "lon", "h"}
_REFERENCE = {"t", "roll", "pitch", "yaw"}


def has_structs(path: Path) -> bool:
    """Return whether a file has a struct with the fields of an IMU."""
    return bool(_structs(MatFile(path, *read_matlab(path)), _IMU))


def _structs(file: MatFile, needed: set[str], without: str = "") -> list[str]:
    """Return the names of the structs that have all of these fields."""
    fields: dict[str, set[str]] = {}
    for name in file.arrays:
        struct, dot, field = name.partition(".")
        if dot:
            fields.setdefault(struct, set()).add(field)
    return [name for name, there in fields.items() if needed <= there and without not in there]


def load(path: Path, mapping: Mapping) -> Recording:
    """Read the IMU, with fixes and reference if the file has them.

    Raises:
        ValueError: no readable file, several IMUs of which none is named, or a field of the wrong form.
    """
    file = MatFile(path, *read_matlab(path))
    imus = _structs(file, _IMU)
    if mapping.imu is not None and mapping.imu not in imus:
        raise ValueError(f"{path}: {unknown('IMU', mapping.imu, imus)}")
    if len(imus) != 1 and mapping.imu is None:
        found = f"the IMUs {', '.join(imus)}" if imus else "no struct with t, fb, wb"
        raise ValueError(f'{path}: {found}; allowed: one of them, as "imu" in the mapping')
    imu = mapping.imu or imus[0]
    t = file.column(f"{imu}.t")
    turn = to_rfu(mapping.axes or AXES)
    rates, force = (turned(_rows(file, f"{imu}.{field}", len(t)), turn) for field in ("wb", "fb"))
    samples = Samples(str(path), f"{imu}.t", lambda i: f"row {i + 1} of {imu}", t, rates, force, True, True)
    clock = clocked(samples, mapping.rate_hz, mapping.resample_hz, mapping.drop_duplicates)
    gnss, lever = _gnss(file)
    if mapping.lever_arm_m is not None:
        lever = np.array(mapping.lever_arm_m)
    return assemble(path, mapping, clock, gnss, _reference(file), None if lever is None else turn @ lever)


def _rows(file: MatFile, name: str, many: int) -> Array:
    """Return a matrix (n, 3) of as many rows as there are times; three numbers hold for all of them.

    Raises:
        ValueError: another form.
    """
    if name in file.arrays and np.size(file.arrays[name]) == 3:
        return np.broadcast_to(file.vector(name, 3), (many, 3))
    values = file.matrix(name, (3,))
    if len(values) != many:
        raise ValueError(f"{file.path}: {name} has {len(values)} rows; allowed: {many}, as its times")
    return values


def _place(file: MatFile, struct: str, many: int) -> Array:
    columns = [file.column(f"{struct}.{field}") for field in ("lat", "lon", "h")]
    if any(len(column) != many for column in columns):
        raise ValueError(f"{file.path}: lat, lon, h of {struct} have other lengths than t; allowed: one for each time")
    return geodetic(file.path, struct, lambda i: f"row {i + 1}", np.column_stack(columns), 1.0)


def _gnss(file: MatFile) -> tuple[Gnss | None, Array | None]:
    """Return the fixes and the lever arm of the only struct that has positions and no attitude."""
    found = _structs(file, _GNSS, without="roll")
    if not found:
        return None, None
    if len(found) > 1:
        raise ValueError(f"{file.path}: fixes in {', '.join(found)}; allowed: one struct with t, lat, lon, h")
    name = found[0]
    t = file.column(f"{name}.t")
    check_increasing(str(file.path), f"{name}.t", lambda i: f"row {i + 1}", t)
    vel, pos_std, vel_std = (
        swap_ned(_rows(file, f"{name}.{field}", len(t))) if f"{name}.{field}" in file else None
        for field in ("vel", "stdm", "stdv")
    )
    stds = (None if std is None else np.abs(std) for std in (pos_std, vel_std))
    lever = file.vector(f"{name}.larm", 3) if f"{name}.larm" in file else None
    return Gnss(t, vel, _place(file, name, len(t)), *stds), lever


def _reference(file: MatFile) -> Reference | None:
    found = _structs(file, _REFERENCE)
    if len(found) != 1:
        return None
    name = found[0]
    t = file.column(f"{name}.t")
    check_increasing(str(file.path), f"{name}.t", lambda i: f"row {i + 1}", t)
    angles = [file.column(f"{name}.{field}") for field in ("yaw", "pitch", "roll")]
    if any(len(angle) != len(t) for angle in angles):
        raise ValueError(
            f"{file.path}: roll, pitch, yaw of {name} have other lengths than t; allowed: one for each time"
        )
    vel = swap_ned(_rows(file, f"{name}.vel", len(t))) if f"{name}.vel" in file else None
    pos = _place(file, name, len(t)) if all(f"{name}.{field}" in file for field in ("lat", "lon", "h")) else None
    return Reference(t, attitude.from_euler(*angles), vel, pos)


FORMAT = Format(
    "navego",
    ".mat",
    load,
    keys=(*SITE_KEYS, "imu"),
    lacks=("displacements", "aids"),
    recognises=has_structs,
    distinctive=False,
)
