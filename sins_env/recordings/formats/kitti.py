"""KITTI raw data: a folder ``oxts`` with ``timestamps.txt`` and a text file for each sample in ``data``.

The form is that of the development kit's ``dataformat.txt``. The recording is named by its ``timestamps.txt``, a date in
each line. A file of ``data`` has 30 numbers:

    latitude, longitude deg; altitude m; roll, pitch, yaw rad (left side up, front down, counter-clockwise from east)
    velocity north, east, forward, left, up m/s
    acceleration x, y, z and forward, left, up m/s^2; angular rate x, y, z and forward, left, up rad/s
    accuracy of position m and of velocity m/s; five numbers of the receiver

Rates x, y, z are along Forward-Left-Up of the vehicle. Positions and velocities are those of a solution that has used the
IMU; they stand for fixes, and with the attitude for the reference. Samples that were taken "sync" have lost nine of ten.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.reading.files import read_text
from sins_env.recordings.assembling import assemble, geodetic
from sins_env.recordings.axes import to_rfu, turned
from sins_env.recordings.clock import Samples, check_increasing, clocked
from sins_env.recordings.file_format import SITE_KEYS, Format
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Gnss, Recording, Reference
from sins_env.recordings.text.dates import FORMS, calendar_seconds
from sins_env.recordings.text.head import first_lines

AXES = "FLU"
COLUMNS = 30
MOST_SAMPLE = 10_000  #: largest file of one sample, bytes
STAMPS = "timestamps.txt"


def has_samples(path: Path) -> bool:
    """Return whether a file is the list of stamps beside a folder of samples."""
    return path.name == STAMPS and (path.parent / "data").is_dir()


def load(path: Path, mapping: Mapping) -> Recording:
    """Read all samples of the folder beside ``timestamps.txt``.

    Raises:
        ValueError: another number of samples than of stamps, or samples of another form.
        OSError: a sample that cannot be read.
    """
    texts = [line for line in first_lines(path) if line.strip()]
    t = calendar_seconds(texts)
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        raise ValueError(f"{path}: line {bad[0] + 1} is {texts[bad[0]][:40]!r}; allowed: {FORMS}")
    files = sorted((path.parent / "data").glob("*.txt"))
    if len(files) != len(t):
        raise ValueError(f"{path}: {len(t)} stamps, and {len(files)} samples in data; allowed: a sample for each stamp")
    rows = np.array([_sample(file) for file in files])

    def place(row: int) -> str:
        return f"line {row + 1}"

    turn = to_rfu(mapping.axes or AXES)
    rates, force = turned(rows[:, 17:20], turn), turned(rows[:, 11:14], turn)
    samples = Samples(str(path), "time", place, t, rates, force, gyro_rates=True, accel_rates=True)
    clock = clocked(samples, mapping.rate_hz, mapping.resample_hz, mapping.drop_duplicates)
    check_increasing(str(path), "time", place, t)
    pos, vel = geodetic(path, "position", place, rows[:, :3]), rows[:, [7, 6, 10]]
    stds = [np.repeat(np.abs(rows[:, [i]]), 3, axis=1) for i in (23, 24)]
    roll, pitch, yaw = rows[:, 3:6].T
    reference = Reference(t, attitude.from_euler(0.5 * np.pi - yaw, -pitch, roll), vel, pos)
    lever = None if mapping.lever_arm_m is None else turn @ np.array(mapping.lever_arm_m)
    return assemble(path, mapping, clock, Gnss(t, vel, pos, *stds), reference, lever)


def _sample(path: Path) -> Array:
    """Return the numbers of a sample, (30,)."""
    words = read_text(path, MOST_SAMPLE).split()
    try:
        values = np.array(words, dtype=float)
    except ValueError:
        values = np.array([])
    if values.shape != (COLUMNS,) or not np.isfinite(values).all():
        raise ValueError(f"{path}: {len(words)} fields; allowed: {COLUMNS} finite numbers")
    return values


FORMAT = Format(
    "kitti",
    STAMPS,
    load,
    keys=SITE_KEYS,
    lacks=("displacements", "aids"),
    recognises=has_samples,
    distinctive=False,
    more_endings=(".txt",),
)
