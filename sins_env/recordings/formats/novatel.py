"""NovAtel ASCII logs: ``RAWIMU``, ``RAWIMUS``, ``RAWIMUX``, ``RAWIMUSX``, with ``BESTPOS``, ``BESTVEL`` and ``INSPVA``.

The form is that of the OEM7 commands and logs reference manual. A line is ``#NAMEA,header;body*checksum``, or with a short
header ``%NAMEA,week,seconds;body*checksum``. Bodies that are read:

    RAWIMU(S)      week, seconds, status, counts of z, -y, x accelerometer, counts of z, -y, x gyro
    RAWIMU(S)X     IMU info, IMU type, and then the same
    BESTPOS        status, type, latitude, longitude deg, height and undulation m, datum, deviations N, E, U m
    BESTVEL        status, type, latency, age, horizontal speed m/s, track deg, vertical speed m/s
    INSPVA(S)      week, seconds, latitude, longitude deg, height m, velocity N, E, U m/s, roll, pitch, azimuth deg, status
    INSPVAX        status, type, latitude, longitude deg, height, undulation m, velocity N, E, U, roll, pitch, azimuth

A count has the weight that the type of the IMU tells. ``RAWIMU(S)X`` names the type; for the others the mapping does
(``imu``), or it tells the weights (``gyro``, ``accel``). Lines whose checksum fails while that of others holds are left
out; the samples are missing then. The counts are along the axes of the IMU's enclosure, which no log tells.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sins_env import attitude, checks
from sins_env.arrays import Array
from sins_env.checks import unknown
from sins_env.reading.files import text_blocks
from sins_env.recordings.assembling import assemble, geodetic
from sins_env.recordings.axes import to_rfu, turned
from sins_env.recordings.clock import Samples, check_increasing, clocked
from sins_env.recordings.file_format import SITE_KEYS, Format
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Gnss, Recording, Reference
from sins_env.recordings.text.head import first_lines
from sins_env.recordings.times import WEEK_S
from sins_env.units import ARCSEC, DEG, G0

FOOT = 0.3048  #: m
#: Weights of a count, rad and m/s, of the types of IMU, with their numbers in RAWIMUSX: the manual's table of scale factors,
#: https://docs.novatel.com/OEM7/Content/SPAN_Logs/RAWIMUSX.htm, as NovAtel's driver has it, github.com/novatel/novatel_oem7_driver.
#: Those of KVH are left out, because it is not clear there whether their gyros count degrees or radians.
TYPES: dict[str, tuple[tuple[int, ...], float, float]] = {
    "HG1700-AG58": ((1, 11), 2.0**-33, 2.0**-27 * FOOT),
    "HG1700-AG62": ((4, 12), 2.0**-33, 2.0**-26 * FOOT),
    "HG1900": ((5, 27), 2.0**-33, 2.0**-27 * FOOT),
    "HG1930": ((20, 28), 2.0**-33, 2.0**-27 * FOOT),
    "HG4930": ((58, 68, 69), 2.0**-33, 2.0**-29),
    "LN200": ((8,), 2.0**-19, 2.0**-14),
    "IMAR-FSAS": ((13,), 0.1 * 2.0**-8 * ARCSEC, 0.05 * 2.0**-15),
    "ISA-100C": ((26, 34, 38, 39), 1e-9, 2e-8),
    "uIMU": ((52,), 1e-9, 2e-8),
    "ADIS16488": ((31,), 720.0 / 2**31 * DEG, 200.0 / 2**31),
    "STIM300": ((32, 56), 2.0**-21 * DEG, 2.0**-22),
    # counts of rates in 0.008 (0.0151515) deg/s / 2^16 and 0.2 (0.4) mg / 2^16, at the rate of the type
    "EPSON-G320": ((41,), 0.008 * 2.0**-16 * DEG / 125, 0.2e-3 * G0 * 2.0**-16 / 125),
    "EPSON-G320-200Hz": ((62,), 0.008 * 2.0**-16 * DEG / 200, 0.2e-3 * G0 * 2.0**-16 / 200),
    "EPSON-G370": ((61,), 0.0151515 * 2.0**-16 * DEG / 200, 0.4e-3 * G0 * 2.0**-16 / 200),
}
_SOLVED = ("INS_SOLUTION_GOOD", "INS_SOLUTION_FREE", "INS_ALIGNMENT_COMPLETE", "INS_HIGH_VARIANCE")
_FIXED = "SOL_COMPUTED"
_GRAVITY = 9.8  #: m/s^2
_READ = ("RAWIMU", "RAWIMUX", "BESTPOS", "BESTVEL", "INSPVA", "INSPVAX")


class _Log(NamedTuple):
    """The lines of one kind of log."""

    numbers: list[int]  #: numbers of the lines in the file
    heads: list[list[str]]  #: fields of the header
    bodies: list[list[str]]  #: fields of the body

    def kept(self, keep: list[int]) -> _Log:
        """Return some of the lines."""
        return _Log([self.numbers[i] for i in keep], [self.heads[i] for i in keep], [self.bodies[i] for i in keep])


def names_itself(path: Path) -> bool:
    """Return whether one of the first lines is a log of raw IMU data or of a solution."""
    return any(_kind(line) in _READ for line in first_lines(path)[:200])


def _kind(line: str) -> str | None:
    """Return the name of a log without its ending for ASCII and for a short header; None for another line."""
    if not line.startswith(("#", "%")) or ";" not in line:
        return None
    name = line[1:40].partition(",")[0]
    if not name.endswith("A"):
        return None
    short = {"RAWIMUS": "RAWIMU", "RAWIMUSX": "RAWIMUX", "INSPVAS": "INSPVA"}
    return short.get(name[:-1], name[:-1])


def load(path: Path, mapping: Mapping) -> Recording:
    """Read the counts of the IMU, with fixes and a reference if the log has them.

    Raises:
        ValueError: no counts, an unknown type of IMU, no axes, or fields of another form.
    """
    logs = _logs(path)
    raw = logs["RAWIMU"] if logs["RAWIMU"].bodies else logs["RAWIMUX"]
    shift = 2 if raw is logs["RAWIMUX"] else 0
    if not raw.bodies:
        raise ValueError(f"{path}: no RAWIMU, RAWIMUS, RAWIMUX or RAWIMUSX; allowed: a log with one of them")
    rows = _numbers(path, raw, [shift, shift + 1, *range(shift + 3, shift + 9)])
    t = _seconds_of(rows)
    force, turn_ = rows[:, [4, 3, 2]] * [1, -1, 1], rows[:, [7, 6, 5]] * [1, -1, 1]
    gyro, accel = _weights(path, mapping, raw, shift, force, t)
    if mapping.axes is None:
        along = np.mean(force, axis=0)
        axis = int(np.argmax(np.abs(along)))
        up = f"{'+-'[int(along[axis] < 0)]}{'xyz'[axis]}"
        raise ValueError(f"{path}: no axes; allowed: axes in the mapping; the accelerometers say that {up} points up")
    turn = to_rfu(mapping.axes)

    def place(row: int) -> str:
        return f"line {raw.numbers[row]}"

    samples = Samples(str(path), "time", place, t, turned(turn_, turn) * gyro, turned(force, turn) * accel)
    clock = clocked(samples, mapping.rate_hz, mapping.resample_hz, mapping.drop_duplicates)
    lever = None if mapping.lever_arm_m is None else turn @ np.array(mapping.lever_arm_m)
    return assemble(path, mapping, clock, _fixes(path, logs), _reference(path, logs), lever)


def _logs(path: Path) -> dict[str, _Log]:
    """Return the lines of each kind that is read, whose checksums hold if any does."""
    found = {kind: _Log([], [], []) for kind in _READ}
    sound: dict[str, list[bool]] = {kind: [] for kind in _READ}
    before = 0
    for lines in text_blocks(path):
        for i, line in enumerate(lines):
            kind = _kind(line)
            if kind not in found:
                continue
            text, _, told = line[1:].rstrip().rpartition("*")
            head, _, body = text.partition(";")
            log = found[kind]
            log.numbers.append(before + i + 1)
            log.heads.append(head.split(","))
            log.bodies.append(body.split(","))
            sound[kind].append(f"{zlib.crc32(text.encode(), 0xFFFFFFFF) ^ 0xFFFFFFFF:08x}" == told.lower())
        before += len(lines)
    if any(map(any, sound.values())):
        for kind, log in found.items():
            keep = [i for i, good in enumerate(sound[kind]) if good]
            found[kind] = log.kept(keep)
    return found


def _numbers(path: Path, log: _Log, columns: list[int], heads: bool = False) -> Array:
    """Return columns of the bodies, or of the headers, as numbers, (n, columns).

    Raises:
        ValueError: a field that is no finite number; the error has its line.
    """
    source = log.heads if heads else log.bodies
    try:
        rows = np.array([[fields[i] for i in columns] for fields in source], dtype=float).reshape(-1, len(columns))
        bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    except (ValueError, IndexError):
        rows, bad = np.empty((0, len(columns))), np.arange(1)
        for row, fields in enumerate(source):
            if len(fields) <= max(columns) or not all(_is_number(fields[i]) for i in columns):
                bad = np.array([row])
                break
    if len(bad):
        raise ValueError(
            f"{path}: line {log.numbers[bad[0]]} has no finite numbers in fields "
            f"{', '.join(str(i + 1) for i in columns)} of its {'header' if heads else 'body'}; allowed: a whole log"
        )
    return rows


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _seconds_of(rows: Array) -> Array:
    """Return the times of rows that begin with week and seconds, in seconds of the first week."""
    return (rows[:, 0] - rows[0, 0]) * WEEK_S + rows[:, 1]


def _weights(path: Path, mapping: Mapping, raw: _Log, shift: int, force: Array, t: Array) -> tuple[float, float]:
    """Return the weights of a count of the gyros, rad, and of the accelerometers, m/s."""
    if mapping.gyro is not None or mapping.accel is not None:
        return _told_weight("gyro", mapping.gyro, "rad"), _told_weight("accel", mapping.accel, "m/s")
    if mapping.imu is not None:
        plain = {"".join(filter(str.isalnum, name)).lower(): name for name in TYPES}
        name = plain.get("".join(filter(str.isalnum, mapping.imu)).lower())
        if name is None:
            raise ValueError(
                f"{path}: {unknown('type of IMU', mapping.imu, TYPES)}, or gyro and accel with their scale"
            )
        return TYPES[name][1:]
    if shift:
        number = int(_numbers(path, raw, [1])[0, 0])
        for numbers, gyro, accel in TYPES.values():
            if number in numbers:
                return gyro, accel
        raise ValueError(f"{path}: IMU type {number} has no known weights; allowed: gyro and accel with their scale")
    per_second = float(np.linalg.norm(np.mean(force, axis=0))) / max(
        float(np.median(np.diff(t))) if len(t) > 1 else 1.0, 1e-9
    )
    fitting = [name for name, (_, _, accel) in TYPES.items() if abs(per_second * accel / _GRAVITY - 1) < 0.02]
    said = (
        f"the counts are gravity with {', '.join(fitting)}" if fitting else "the counts are gravity with none of them"
    )
    raise ValueError(
        f'{path}: RAWIMU does not name the type of the IMU; allowed: "imu" in the mapping, one of {", ".join(TYPES)} ({said}), '
        'or "gyro": {"scale": rad per count} and "accel": {"scale": m/s per count}'
    )


def _told_weight(name: str, given: Any, unit: str) -> float:
    allowed = f'{{"scale": {unit} per count}}'
    if (
        not isinstance(given, dict)
        or given.get("unit", unit) != unit
        or not {"scale"} <= given.keys() <= {"scale", "unit"}
    ):
        raise checks.refused(name, given, allowed)
    return checks.number(f"scale of {name}", given["scale"], allowed, above=0.0)


def _fixes(path: Path, logs: dict[str, _Log]) -> Gnss | None:
    """Return the computed positions, with the velocities of the same times if each has one."""
    log = _where(logs["BESTPOS"], 0, (_FIXED,))
    if not log.bodies:
        return None
    rows = _numbers(path, log, [2, 3, 4, 5, 7, 8, 9])
    t = _seconds_of(_numbers(path, log, [5, 6], heads=True))
    check_increasing(str(path), "time of BESTPOS", lambda i: f"line {log.numbers[i]}", t)
    pos = geodetic(path, "BESTPOS", lambda i: f"line {log.numbers[i]}", rows[:, :3] + rows[:, 3:4] * [0, 0, 1])
    speeds = _where(logs["BESTVEL"], 0, (_FIXED,))
    vel = None
    if speeds.bodies:
        found = _numbers(path, speeds, [4, 5, 6])
        at = _seconds_of(_numbers(path, speeds, [5, 6], heads=True))
        near = np.searchsorted(at, t - 1e-4).clip(max=len(at) - 1)
        if (np.abs(at[near] - t) < 1e-3).all():
            speed, track, up = found[near].T
            vel = np.column_stack([speed * np.sin(track * DEG), speed * np.cos(track * DEG), up])
    return Gnss(t, vel, pos, np.abs(rows[:, [5, 4, 6]]))


def _reference(path: Path, logs: dict[str, _Log]) -> Reference | None:
    """Return the solution of the receiver; its attitude is that of a Right-Forward-Up body."""
    extended = not logs["INSPVA"].bodies
    log = _where(logs["INSPVAX"], 0, _SOLVED) if extended else _where(logs["INSPVA"], 11, _SOLVED)
    if not log.bodies:
        return None
    if extended:
        rows = _numbers(path, log, [2, 3, 4, 6, 7, 8, 9, 10, 11, 5])
        t = _seconds_of(_numbers(path, log, [5, 6], heads=True))
        llh = rows[:, :3] + rows[:, 9:] * [0, 0, 1]
    else:
        t = _seconds_of(_numbers(path, log, [0, 1]))
        rows = _numbers(path, log, list(range(2, 11)))
        llh = rows[:, :3]

    def place(row: int) -> str:
        return f"line {log.numbers[row]}"

    check_increasing(str(path), "time of INSPVA", place, t)
    roll, pitch, azimuth = np.radians(rows[:, 6:9]).T
    q_nb = attitude.from_euler(azimuth, pitch, roll)
    return Reference(t, q_nb, rows[:, [4, 3, 5]], geodetic(path, "INSPVA", place, llh))


def _where(log: _Log, column: int, allowed: tuple[str, ...]) -> _Log:
    """Return the lines whose status is one of those allowed."""
    keep = [i for i, fields in enumerate(log.bodies) if len(fields) > column and fields[column] in allowed]
    return log.kept(keep)


FORMAT = Format(
    "novatel",
    ".asc",
    load,
    keys=(*SITE_KEYS, "imu", "gyro", "accel"),
    lacks=("displacements", "aids"),
    recognises=names_itself,
    more_endings=(".log", ".gps", ".txt"),
)
