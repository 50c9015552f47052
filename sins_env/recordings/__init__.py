"""Recordings: files of many formats are read into one form, and written from it.

A file comes in, with a mapping if it does not describe itself. A :class:`Recording` goes out: increments, fixes and
reference in the frames of this package.

    load("drive.npz")                        one of the NPZ layouts (:mod:`sins_env.recordings.formats.npz`)
    load("Leador-A15.txt")                   KF-GINS text; GNSS and truth as Leador-A15.json names them
    load("lasergyro.imu"), load("x.mat")     PSINS
    load("imu.csv"), load("imu.json")        a text table, with a mapping (:mod:`sins_env.recordings.mapping`)
    load("span.asc"), load("oxts/timestamps.txt")    NovAtel, KITTI; NaveGo .mat too
    save(recording, "drive.txt")             the format of the ending

Increments are Right-Forward-Up on one uniform clock. Stamps that jitter about it are evened out, gaps of up to 0.1 s are
bridged and told, longer ones stay gaps (NaN), and nothing is resampled without being asked. Stamps that run back,
impossible units, and files of the wrong form are one clear error. It has the file, the line or sample, what is there and
what is allowed. Each recording is checked against itself when it is read (``findings``): what would make results wrong is
refused.

Read ``recording``, ``files``, ``formats``; then ``mapping``, ``text``, ``columns``, ``times``, ``axes``, ``column_units``,
``stamps``, ``clock``, ``assembling``, ``findings``; then what uses a recording: ``interpolation``, ``summary``.
``guessing`` makes a first mapping of a file.
"""

from sins_env.recordings.axes import heading_pitch_roll, to_rfu
from sins_env.recordings.clock import resample
from sins_env.recordings.files import DATA_VARIABLE, FORMATS, format_of, left_out, load, save
from sins_env.recordings.findings import REFUSING, Finding, findings
from sins_env.recordings.formats.npz import LAYOUTS, Layout
from sins_env.recordings.interpolation import reference_at
from sins_env.recordings.mapping import accepted
from sins_env.recordings.recording import (
    Displacements,
    Gap,
    Gnss,
    Readings,
    Recording,
    Reference,
    first_few,
    seconds,
    stated,
)
from sins_env.recordings.stamps.bridging import BRIDGE_S, MOST_BRIDGE_S, bridged
from sins_env.recordings.stamps.instants import on_clock, told_time
from sins_env.recordings.summary import North, Summary, north, summarise

__all__ = [
    "BRIDGE_S",
    "DATA_VARIABLE",
    "FORMATS",
    "LAYOUTS",
    "MOST_BRIDGE_S",
    "REFUSING",
    "Displacements",
    "Finding",
    "Gap",
    "Gnss",
    "Layout",
    "North",
    "Readings",
    "Recording",
    "Reference",
    "Summary",
    "accepted",
    "bridged",
    "findings",
    "first_few",
    "format_of",
    "heading_pitch_roll",
    "left_out",
    "load",
    "north",
    "on_clock",
    "reference_at",
    "resample",
    "save",
    "seconds",
    "stated",
    "summarise",
    "to_rfu",
    "told_time",
]
