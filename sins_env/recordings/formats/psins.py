"""PSINS files (Yan Gongmin's toolbox): ``.imu`` text and ``.mat``.

Found in WangShanpeng/PSINS at c1706f1. ``base/io/imufile.m``: a ``.imu`` file is text, not binary. Lines that begin
with % are comments, the first of which names PSINS and SIMU; then three rows of six numbers

    pitch, roll, yaw deg ("maybe inaccurate"); velocity East, North, Up m/s
    latitude, longitude deg; height m; t0 s; sample interval ms; g m/s^2
    arcsec per count of three gyros; ug s per count of three accelerometers, with that g

and rows of six whole counts, Right-Forward-Up; sample k ends at t0 + k dt. A seventh column (0 in the three rows above)
is what the stamps' steps exceed dt by; the file's own comment says milliseconds, the code that writes and reads it
microseconds, and so does this. Initial attitude and velocity are not read.

``.mat``: what its scripts load. ``imu`` (n, 7) angle increments rad, velocity increments m/s, time s
(``base/imu/imuresample.m``: the interval ends there); ``avp`` (m, 10) pitch, roll, yaw rad, velocity East, North, Up,
latitude, longitude rad, height m, time; ``gps`` (l, 7) velocity, position, time or (l, 4) position, time
(``base/base1/gpsidx.m``); or a struct ``trj`` of ``imu``, ``avp``, ``avp0``, ``ts`` (``base/io/trjfile.m``). Yaw is
counter-clockwise from north (``base/base0/a2mat.m``, whose Cnb takes body vectors to n; its comment says the reverse).
Written besides, and read back: ``att`` (m, 4) pitch, roll, yaw, time for a reference that is attitude only, ``pos0``
(3,), ``lever`` (3,) m.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sins_env import attitude, checks
from sins_env.arrays import Array
from sins_env.recordings.assembling import assemble, geodetic, site
from sins_env.recordings.axes import heading_pitch_roll, to_rfu, turned
from sins_env.recordings.clock import Samples, check_increasing, clocked, hz_of
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Gnss, Recording, Reference
from sins_env.recordings.text import Style, read_table, replacing, write_rows
from sins_env.units import ARCSEC

AXES = "RFU"
G = 9.780327  #: m/s^2, as PSINS prints its glv.g0
GYRO_LSB_ARCSEC, ACCEL_LSB_UG_S = 1e-4, 1e-2  #: of files written: 5e-10 rad and 1e-7 m/s, far below any sensor's pulses
_STYLE = Style(comment="%")

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


def load_imu(path: Path, mapping: Mapping) -> Recording:
    """Counts of a ``.imu`` file; no fixes, no reference."""
    with path.open("rb") as stream:
        first = stream.readline(200)
    if not (b"PSINS" in first and b"SIMU" in first):
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
    return Recording(path.stem, clock.rate_hz, clock.t0, clock.dtheta, clock.dvel, site(pos))


def save_imu(recording: Recording, path: Path) -> list[Path]:
    """Write counts, the remainder of each sum carried on; fixes and reference have no place here."""
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


def load_mat(path: Path, mapping: Mapping) -> Recording:
    """``imu`` and whatever of fixes and reference lies beside it."""
    file = _variables(path)
    imu = _matrix(path, file, "imu", (7,))
    turn = to_rfu(mapping.axes or AXES)

    def row(name: str) -> Any:
        return lambda i: f"row {i + 1} of {name}"

    samples = Samples(str(path), "imu(:,7)", row("imu"), imu[:, 6], turned(imu[:, :3], turn), turned(imu[:, 3:6], turn))
    rate = mapping.rate_hz
    if rate is None and "ts" in file:
        rate = hz_of(checks.number(f"{path}: ts", np.asarray(file["ts"]).item(), "a positive step in s", above=0.0))
    clock = clocked(samples, rate, mapping.resample_hz, mapping.drop_duplicates)
    gnss = reference = None
    if "gps" in file:
        gps = _matrix(path, file, "gps", (4, 7))
        check_increasing(str(path), "gps time", row("gps"), gps[:, -1])
        pos = geodetic(path, "gps", row("gps"), gps[:, -4:-1], 1.0)
        gnss = Gnss(gps[:, -1].copy(), gps[:, :3].copy() if gps.shape[1] == 7 else None, pos)
    for name, columns in (("avp", 10), ("att", 4)):
        if name in file and reference is None:
            avp = _matrix(path, file, name, (columns,))
            check_increasing(str(path), f"{name} time", row(name), avp[:, -1])
            q = attitude.from_euler(-avp[:, 2], avp[:, 0], avp[:, 1])
            whole = columns == 10
            llh = geodetic(path, name, row(name), avp[:, 6:9], 1.0) if whole else None
            reference = Reference(avp[:, -1].copy(), q, avp[:, 3:6].copy() if whole else None, llh)
    lever = mapping.lever_arm_m if mapping.lever_arm_m is not None else file.get("lever")
    arm = None if lever is None else turn @ np.array(checks.numbers("lever", np.ravel(lever), 3, "three numbers in m"))
    if mapping.site is None:
        start = _start(path, file)
        if start is not None:
            mapping = replace(mapping, site=(*np.degrees(start[:2]).tolist(), float(start[2])))
    return assemble(path, mapping, clock, gnss, reference, arm)


def _start(path: Path, file: dict[str, Any]) -> Array | None:
    """Latitude rad, longitude rad, height m where the file names them."""
    for name, last in (("pos0", None), ("avp0", 9)):
        if name in file:
            values = np.ravel(np.asarray(file[name], dtype=float))[:last][-3:]
            return geodetic(path, name, lambda i: "its end", values[None], 1.0)[0]
    return None


def _variables(path: Path) -> dict[str, Any]:
    """The variables of a ``.mat`` file; those of ``trj`` where it is one of them."""
    from scipy.io import loadmat  # slow to import
    from scipy.io.matlab import MatReadError

    try:
        with path.open("rb") as stream:
            file = loadmat(stream, squeeze_me=False)
    except NotImplementedError as error:
        raise ValueError(f"{path}: MATLAB 7.3 (HDF5); allowed: save(..., '-v7') or older") from error
    except (MatReadError, ValueError, TypeError, OSError, EOFError, KeyError, IndexError, MemoryError) as error:
        raise ValueError(f"{path}: not a readable .mat file, or a truncated one ({error})") from error
    except Exception as error:  # zlib.error, struct.error and whatever damaged bytes provoke
        raise ValueError(f"{path}: not a readable .mat file, or a damaged one ({error})") from error
    trj = file.get("trj")
    if isinstance(trj, np.ndarray) and trj.dtype.names and trj.size == 1:
        file = {**file, **{name: trj[name].item() for name in trj.dtype.names}}
    return file


def _matrix(path: Path, file: dict[str, Any], name: str, columns: tuple[int, ...]) -> Array:
    if name not in file:
        there = ", ".join(key for key in file if not key.startswith("__")) or "none"
        raise ValueError(f"{path}: no variable {name!r}; variables there: {there}")
    raw = np.asarray(file[name])
    allowed = " or ".join(map(str, columns))
    if raw.dtype.kind not in "iuf" or raw.ndim != 2 or raw.shape[1] not in columns or not len(raw):
        raise ValueError(f"{path}: {name} is {raw.dtype} of shape {raw.shape}; allowed: numbers, (n, {allowed})")
    matrix = raw.astype(np.float64)
    bad = np.argwhere(~np.isfinite(matrix))
    if len(bad):
        raise ValueError(f"{path}: {name} is not finite at row {bad[0, 0] + 1}, column {bad[0, 1] + 1}")
    return matrix


def save_mat(recording: Recording, path: Path) -> list[Path]:
    """Write ``imu``, ``ts``, ``pos0``, and ``gps``, ``avp`` or ``att``, ``lever`` where there is one."""
    from scipy.io import savemat

    here = np.flatnonzero(~recording.missing)
    t = recording.t0 + (here + 1) / recording.rate_hz
    arrays: dict[str, Any] = {
        "imu": np.column_stack([recording.dtheta[here], recording.dvel[here], t]),
        "ts": 1.0 / recording.rate_hz,
        "pos0": recording.site.pos[:, None],
    }
    gnss, ref = recording.gnss, recording.reference
    if gnss is not None:
        arrays["gps"] = np.column_stack([*([] if gnss.vel is None else [gnss.vel]), gnss.pos, gnss.t_s])
    if ref is not None:
        heading, pitch, roll = heading_pitch_roll(ref.q_nb).T
        att = np.column_stack([pitch, roll, -attitude.wrap(heading)])
        if ref.vel is not None and ref.pos is not None:
            arrays["avp"] = np.column_stack([att, ref.vel, ref.pos, ref.t_s])
        else:
            arrays["att"] = np.column_stack([att, ref.t_s])
    if recording.lever_arm is not None:
        arrays["lever"] = recording.lever_arm[:, None]
    with replacing([path]) as (new,), new.open("wb") as stream:
        savemat(
            stream, arrays, do_compression=True
        )  # its checksums tell of damage, which scipy's reader may not survive
    return [path]
