"""KF-GINS text files: IMU increments, GNSS fixes, truth.

The README of i2Nav-WHU/KF-GINS at 079e59c (section 2.2) and its loaders (``src/fileio``) define them. Numbers in a row are
separated by spaces, tabs or commas:

    IMU    seconds of week; 3 angle increments rad; 3 velocity increments m/s [; odometer m/s]; axes Forward-Right-Down
    GNSS   seconds of week; latitude, longitude deg; height m; standard deviations North, East, Down m: 7 columns,
           or 13 with velocity North, East, Down m/s before them and its standard deviations behind (the loader's own
           comment says only that 13 columns hold a velocity and takes the deviations from columns 8 to 10)
    truth  week (0 in what KF-GINS writes); seconds of week; latitude, longitude deg; height m; velocity North, East,
           Down m/s; roll, pitch, yaw deg, yaw clockwise from north, turned yaw, pitch, roll (``src/common/rotation.h``)

IMU and GNSS rows of others may have the week before the seconds; it is told by its whole numbers, which hardly change.
A stamp lies at the end of its increments. A mapping joins the files (``gnss``, ``reference``). It also has the lever arm,
which KF-GINS keeps in its configuration (``antlever``, Forward-Right-Down).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sins_env import attitude, checks
from sins_env.arrays import Array
from sins_env.recordings.assembling import assemble, geodetic
from sins_env.recordings.axes import heading_pitch_roll, swap_ned, to_rfu, turned
from sins_env.recordings.clock import Samples, clocked
from sins_env.recordings.file_format import TEXT_KEYS, Format
from sins_env.recordings.formats import rtklib
from sins_env.recordings.mapping import Mapping, companion
from sins_env.recordings.recording import Gnss, Recording, Reference
from sins_env.recordings.stamps.scales import WEEK_S
from sins_env.recordings.stamps.wraps import check_increasing, unrolled
from sins_env.recordings.text import Style, Table, header, read_table, write_files
from sins_env.recordings.times import MOST_WEEK, Times, on_scale_of

AXES = "FRD"
IMU_COLUMNS, GNSS_COLUMNS, TRUTH_COLUMNS = (7, 8, 9), (7, 8, 13, 14), (11,)
POS_STD_M, VEL_STD_MPS = 1.0, 0.1  #: standard deviations that are written if a recording has none


def has_increments(path: Path) -> bool:
    """Return whether the first row has as many numbers as a row of increments."""
    return len(header(path, Style())) in IMU_COLUMNS


def load(path: Path, mapping: Mapping) -> Recording:
    """Read the increments of a file, with the fixes and the truth that the mapping names; the site is the first fix.

    Raises:
        ValueError: a table of the wrong form, or no place on the Earth.
        FileNotFoundError: no such file beside it.
    """
    style = mapping_style(mapping)
    table = read_table(path, IMU_COLUMNS, style)
    turn = to_rfu(mapping.axes or AXES)
    times, rows = _weeks_apart(table, 7)
    dtheta, dvel = turned(rows[:, 1:4], turn), turned(rows[:, 4:7], turn)
    samples = Samples(str(path), "time", table.place, times.t, dtheta, dvel, scale=times.scale)
    clock = clocked(samples, mapping.rate_hz, mapping.resample_hz, mapping.drop_duplicates)
    gnss = None if mapping.gnss is None else _gnss(_file(path, "gnss", mapping.gnss), style, times)
    reference = None if mapping.reference is None else _truth(_file(path, "reference", mapping.reference), style, times)
    lever = None if mapping.lever_arm_m is None else turn @ np.array(mapping.lever_arm_m)
    return assemble(path, mapping, clock, gnss, reference, lever)


def mapping_style(mapping: Mapping) -> Style:
    """Return the style of its tables: white space and commas separate, unless commas are decimal marks."""
    return replace(mapping.style(), delimiter=None, header=False)


def _weeks_apart(table: Table, least: int) -> tuple[Times, Array]:
    """Return the times of the rows, and the rows from their seconds on; a week before the seconds is taken off."""
    rows = table.rows
    weeks = rows[:, 0]
    whole = (weeks == np.rint(weeks)).all() and weeks.min() >= 0 and weeks.max() <= MOST_WEEK
    if rows.shape[1] <= least or not whole or not np.mean(np.diff(weeks) == 0) > 0.5:
        return Times(unrolled(rows[:, 0])), rows
    return Times(weeks * WEEK_S + rows[:, 1], "GPS"), rows[:, 1:]


def _file(path: Path, key: str, given: Any) -> Path:
    if not isinstance(given, str):
        raise checks.refused(f"{key} of {path.name}", given, "the name of a file beside it")
    return companion(path, given)


def _gnss(path: Path, style: Style, imu: Times) -> Gnss:
    if rtklib.holds_fixes(path):
        return rtklib.fixes(path, imu)
    table = read_table(path, GNSS_COLUMNS, style)
    times, rows = _weeks_apart(table, 7)
    if rows.shape[1] not in (7, 13):
        raise ValueError(f"{path}: {rows.shape[1]} columns; allowed: 7 or 13, or one more with a whole week in front")
    check_increasing(str(path), "time", table.place, times.t)
    t = on_scale_of(times, imu, path, "fixes")
    pos = geodetic(path, "position", table.place, rows[:, 1:4])
    if rows.shape[1] == 7:
        return Gnss(t, None, pos, np.abs(swap_ned(rows[:, 4:7])))
    vel, pos_std, vel_std = (swap_ned(rows[:, i : i + 3]) for i in (4, 7, 10))
    return Gnss(t, vel, pos, np.abs(pos_std), np.abs(vel_std))


def _truth(path: Path, style: Style, imu: Times) -> Reference:
    table = read_table(path, TRUTH_COLUMNS, style)
    rows = table.rows
    t = unrolled(rows[:, 1])
    check_increasing(str(path), "time", table.place, t)
    pos = geodetic(path, "position", table.place, rows[:, 2:5])
    angles = rows[:, 8:11]
    bad = np.flatnonzero((np.abs(angles) > [180.0, 90.0, 360.0]).any(axis=1))
    if len(bad):
        text = f"{angles[bad[0]]} at {table.place(int(bad[0]))}; allowed: within 180, 90 and 360 deg"
        raise ValueError(f"{path}: roll, pitch, yaw are {text}")
    roll, pitch, yaw = np.radians(angles).T
    t = on_scale_of(Times(t), imu, path, "the reference")
    return Reference(t, attitude.from_euler(yaw, pitch, roll), swap_ned(rows[:, 5:8]), pos)


def save(recording: Recording, path: Path) -> list[Path]:
    """Write NAME.txt, NAME_gnss.txt and NAME_truth.txt, if they have contents, and their mapping NAME.json.

    Increments keep their bits; times are written to the nanosecond, positions to 1e-12 deg. Returns the paths.

    Raises:
        OSError: files that cannot be written.
    """
    here = np.flatnonzero(~recording.missing)
    t = recording.t0 + (here + 1) / recording.rate_hz
    turn = to_rfu(AXES).T
    imu = np.column_stack([t, turned(recording.dtheta[here], turn), turned(recording.dvel[here], turn)])
    files = [(path, "%.9f" + " %r" * 6, imu)]
    mapping: dict[str, Any] = {"format": "kfgins", "file": path.name, "axes": AXES, "rate_hz": recording.rate_hz}
    mapping["site"] = [*np.degrees(recording.site.pos[:2]).tolist(), recording.site.height]
    if recording.lever_arm is not None:
        mapping["lever_arm_m"] = (turn @ recording.lever_arm).tolist()
    fixes, truth = FORMAT.beside(path)
    if recording.gnss is not None:
        mapping["gnss"] = fixes.name
        files.append((fixes, *_gnss_rows(recording.gnss)))
    if recording.reference is not None:
        mapping["reference"] = truth.name
        files.append((truth, *truth_rows(recording.reference, recording.site.pos)))
    return write_files(files, path.with_suffix(".json"), mapping)


def _llh(pos: Array) -> Array:
    return np.column_stack([np.degrees(pos[:, :2]), pos[:, 2]])


def _gnss_rows(gnss: Gnss) -> tuple[str, Array]:
    shape = gnss.pos.shape
    pos_std = np.full(shape, POS_STD_M) if gnss.pos_std is None else swap_ned(gnss.pos_std)
    place, std = " %.12f %.12f %.6f", " %r" * 3
    if gnss.vel is None:
        return "%.9f" + place + std, np.column_stack([gnss.t_s, _llh(gnss.pos), np.abs(pos_std)])
    vel_std = np.full(shape, VEL_STD_MPS) if gnss.vel_std is None else swap_ned(gnss.vel_std)
    columns = [gnss.t_s, _llh(gnss.pos), swap_ned(gnss.vel), np.abs(pos_std), np.abs(vel_std)]
    return "%.9f" + place + " %r" * 3 + std * 2, np.column_stack(columns)


def truth_rows(ref: Reference, parked: Array) -> tuple[str, Array]:
    """Return format and rows of the truth; a reference without velocity and position stands still at its site."""
    count = len(ref.t_s)
    heading, pitch, roll = np.degrees(heading_pitch_roll(ref.q_nb)).T
    pos = np.broadcast_to(parked, (count, 3)) if ref.pos is None else ref.pos
    vel = np.zeros((count, 3)) if ref.vel is None else swap_ned(ref.vel)
    row = "%d %.9f %.12f %.12f %.6f" + " %r" * 3 + " %.12f" * 3
    return row, np.column_stack([np.zeros(count), ref.t_s, _llh(pos), vel, roll, pitch, heading])


FORMAT = Format(
    "kfgins",
    ".txt",
    load,
    save,
    keys=TEXT_KEYS,
    companions=("_gnss", "_truth"),
    lacks=("displacements", "aids"),
    recognises=has_increments,
    distinctive=False,
)
