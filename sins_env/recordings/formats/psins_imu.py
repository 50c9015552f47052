"""PSINS text files (Yan Gongmin's toolbox): ``.imu``, counts and no fixes.

The form is that of ``base/io/imufile.m`` in WangShanpeng/PSINS at c1706f1: a ``.imu`` file is text, not binary. Lines that
begin with % are comments, and the first names PSINS and SIMU. Then follow three rows of six numbers

    pitch, roll, yaw deg ("maybe inaccurate"); velocity East, North, Up m/s
    latitude, longitude deg; height m; t0 s; sample interval ms; g m/s^2
    arcsec per count of three gyros; ug s per count of three accelerometers, with that g

and rows of six whole counts, Right-Forward-Up. Sample k ends at t0 + k dt. A seventh column, 0 in the three rows above,
is the excess of a step between stamps over dt. It is in microseconds, as in the code of PSINS that writes and reads it;
the comment in the file says milliseconds. Initial attitude and velocity are not read.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sins_env import attitude
from sins_env.reading.files import beginning
from sins_env.recordings.assembling import geodetic, site
from sins_env.recordings.axes import heading_pitch_roll, to_rfu, turned
from sins_env.recordings.clock import Samples, clocked, hz_of
from sins_env.recordings.file_format import Format
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Recording
from sins_env.recordings.text import Style, read_table, write_rows
from sins_env.units import ARCSEC
from sins_env.writing.files import replacing

AXES = "RFU"
G = 9.780327  #: the value of glv.g0 that PSINS prints, m/s^2
#: Weights of a count in files that are written: 5e-10 rad and 1e-7 m/s, far below the pulses of any sensor.
GYRO_LSB_ARCSEC, ACCEL_LSB_UG_S = 1e-4, 1e-2
_STYLE = Style(comments=("%",))

_HEADER = """% PSINS-format SIMU log file. (DO NOT MODIFY!)
% written by sins_env
% 1st line of the data header includes(maybe inaccurate):
%   [pitch0(deg), roll0(deg), yaw0(deg), VE0(m/s), VN0(m/s), VU0(m/s)].
% 2nd line of the data includes:
%   [latitude0(deg), longitude0(deg), height0(m), t0(s), sampling-interval(ms), g(m/s^2)].
% 3rd line of the data header includes:
%   [gf_x, gf_y, gf_z, af_x, af_y, af_z]
%   where gf_* is gyro scale factor in arcsec, af_* is acc scale factor in ug*s.
% SIMU data columns include:
%   [g_x, g_y, g_z, a_x, a_y, a_z, dt]
%   where dt, if exists, is what the step of time exceeds the sampling interval by, in microseconds.
%   Conventionally, SIMU is mounted on vehicle with "x-Right,y-Forward,z-Up" orientations.

"""


def names_itself(path: Path) -> bool:
    """Return whether the first line says PSINS and SIMU."""
    first = beginning(path, 200).partition(b"\n")[0]
    return b"PSINS" in first and b"SIMU" in first


def load(path: Path, mapping: Mapping) -> Recording:
    """Read the counts of a ``.imu`` file, which has no fixes and no reference.

    Raises:
        ValueError: a file of another form, or numbers out of range.
    """
    if not names_itself(path):
        raise ValueError(f"{path}: line 1 does not say PSINS and SIMU; allowed: a PSINS-format SIMU log")
    table = read_table(path, (6, 7), _STYLE)
    if len(table.rows) < 5:
        raise ValueError(f"{path}: {len(table.rows)} rows; allowed: three of header and at least two samples")
    (_, place, lsb), rows = table.rows[:3], table.rows[3:]
    t0, step, g = place[3], place[4] * 1e-3, place[5]
    for name, value, least, most in (("sampling interval", step, 1e-6, 10.0), ("g", g, 9.0, 10.0)):
        if not least <= value <= most:
            raise ValueError(f"{path}: {name} is {value:g} in {table.place(1)}; allowed: {least:g} to {most:g}")
    if not (lsb[:6] > 0).all():
        raise ValueError(f"{path}: scale factors are {lsb[:6]} in {table.place(2)}; allowed: positive")
    turn = to_rfu(mapping.axes or AXES)
    t = t0 + step * np.arange(1, len(rows) + 1)
    if rows.shape[1] == 7:
        t = t + 1e-6 * np.cumsum(rows[:, 6])
    dtheta = turned(rows[:, :3] * (lsb[:3] * ARCSEC), turn)
    dvel = turned(rows[:, 3:6] * (lsb[3:6] * (1e-6 * g)), turn)
    samples = Samples(str(path), "time", lambda i: table.place(i + 3), t, dtheta, dvel)
    clock = clocked(samples, hz_of(step), mapping.resample_hz, mapping.drop_duplicates)
    pos = geodetic(path, "latitude, longitude, height", lambda i: table.place(1), place[None, :3])[0]
    if mapping.site is not None:
        pos = geodetic(path, "site", lambda i: "its mapping", np.array([mapping.site]))[0]
    return Recording(path.stem, clock.rate_hz, clock.t0, clock.dtheta, clock.dvel, site(pos), stamping=clock.stamping)


def save(recording: Recording, path: Path) -> list[Path]:
    """Write counts, with the rest of a count carried to the next sample. Returns the path.

    Fixes and reference have no place here.

    Raises:
        OSError: a file that cannot be written.
    """
    here = np.flatnonzero(~recording.missing)
    lsb = np.array([GYRO_LSB_ARCSEC * ARCSEC] * 3 + [ACCEL_LSB_UG_S * 1e-6 * G] * 3)
    sums = np.rint(np.cumsum(np.hstack([recording.dtheta[here], recording.dvel[here]]), axis=0) / lsb)
    counts = np.diff(sums, axis=0, prepend=0.0)
    step = 1.0 / recording.rate_hz
    extra = np.rint((np.diff(here, prepend=-1) - 1) * step * 1e6)
    gaps = extra.any()
    rows = np.column_stack([counts, extra]) if gaps else counts
    ref, end = recording.reference, " 0\n" if gaps else "\n"
    start = np.zeros(6)
    if ref is not None:
        heading, pitch, roll = np.degrees(heading_pitch_roll(ref.q_nb[0]))
        start[:3] = pitch, roll, -attitude.wrap(np.radians(heading)) * 180 / np.pi
        start[3:] = 0.0 if ref.vel is None else ref.vel[0]
    pos = [*np.degrees(recording.site.pos[:2]), recording.site.height, recording.t0]
    with replacing([path]) as (new,), new.open("w", encoding="ascii", newline="\n") as stream:
        stream.write(_HEADER)
        stream.write(" ".join(f"{value:.6f}" for value in start) + end)
        stream.write(" ".join(f"{value:.12f}" for value in pos[:4]) + f" {1e3 * step!r} {G!r}{end}")
        stream.write(" ".join([repr(GYRO_LSB_ARCSEC)] * 3 + [repr(ACCEL_LSB_UG_S)] * 3) + end + "\n")
        write_rows(stream, " ".join(["%d"] * rows.shape[1]) + "\n", rows)
    return [path]


FORMAT = Format(
    "psins-imu",
    ".imu",
    load,
    save,
    keys=("site",),
    lacks=("fixes", "reference", "lever arm", "displacements", "aids"),
    recognises=names_itself,
)
