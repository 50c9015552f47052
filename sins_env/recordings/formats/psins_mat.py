"""PSINS MATLAB files (Yan Gongmin's toolbox): ``.mat``, the variables that its scripts load.

The variables are those of WangShanpeng/PSINS at c1706f1:

    imu (n, 7)    angle increments rad, velocity increments m/s, time s at their end (base/imu/imuresample.m)
    avp (m, 10)   pitch, roll, yaw rad; velocity East, North, Up m/s; latitude, longitude rad, height m; time s
    gps (l, 7)    velocity, position, time; or (l, 4) position, time (base/base1/gpsidx.m)
    trj           a struct with imu, avp, avp0, ts (base/io/trjfile.m)

Yaw is counter-clockwise from north: Cnb of ``base/base0/a2mat.m`` takes body vectors to n, although its comment says the
reverse. Three more variables are written, and read back: ``att`` (m, 4) with pitch, roll, yaw and time for a reference
of attitude alone, ``pos0`` (3,), and ``lever`` (3,) in m.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sins_env import attitude, checks
from sins_env.arrays import Array
from sins_env.reading.matlab import MatFile, read_matlab
from sins_env.recordings.assembling import assemble, geodetic
from sins_env.recordings.axes import heading_pitch_roll, to_rfu, turned
from sins_env.recordings.clock import Samples, check_increasing, clocked, hz_of
from sins_env.recordings.file_format import SITE_KEYS, Format
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Gnss, Recording, Reference
from sins_env.writing.files import replacing

AXES = "RFU"


def load(path: Path, mapping: Mapping) -> Recording:
    """Read ``imu``, with fixes and reference if the file has them.

    Raises:
        ValueError: no readable file, or a variable of the wrong form.
    """
    file = MatFile(path, *read_matlab(path))
    imu = file.matrix("imu", (7,))
    turn = to_rfu(mapping.axes or AXES)

    def row(name: str) -> Any:
        return lambda i: f"row {i + 1} of {name}"

    samples = Samples(str(path), "imu(:,7)", row("imu"), imu[:, 6], turned(imu[:, :3], turn), turned(imu[:, 3:6], turn))
    rate = mapping.rate_hz
    if rate is None and "ts" in file:
        rate = hz_of(checks.number(f"{path}: ts", float(file.vector("ts", 1)[0]), "a positive step in s", above=0.0))
    clock = clocked(samples, rate, mapping.resample_hz, mapping.drop_duplicates)
    gnss = reference = None
    if "gps" in file:
        gps = file.matrix("gps", (4, 7))
        check_increasing(str(path), "gps time", row("gps"), gps[:, -1])
        pos = geodetic(path, "gps", row("gps"), gps[:, -4:-1], 1.0)
        gnss = Gnss(gps[:, -1].copy(), gps[:, :3].copy() if gps.shape[1] == 7 else None, pos)
    for name, columns in (("avp", 10), ("att", 4)):
        if name in file and reference is None:
            avp = file.matrix(name, (columns,))
            check_increasing(str(path), f"{name} time", row(name), avp[:, -1])
            q = attitude.from_euler(-avp[:, 2], avp[:, 0], avp[:, 1])
            whole = columns == 10
            llh = geodetic(path, name, row(name), avp[:, 6:9], 1.0) if whole else None
            reference = Reference(avp[:, -1].copy(), q, avp[:, 3:6].copy() if whole else None, llh)
    lever: Any = mapping.lever_arm_m
    if lever is None and "lever" in file:
        lever = file.vector("lever", 3)
    arm = None if lever is None else turn @ np.array(lever)
    if mapping.site is None:
        start = _start(file)
        if start is not None:
            mapping = replace(mapping, site=(*np.degrees(start[:2]).tolist(), float(start[2])))
    return assemble(path, mapping, clock, gnss, reference, arm)


def _start(file: MatFile) -> Array | None:
    """Return latitude rad, longitude rad and height m, (3,), of the start, if the file has them."""
    for name, count in (("pos0", 3), ("avp0", 9)):
        if name in file:
            values = file.vector(name, count)[-3:]
            return geodetic(file.path, name, lambda i: "its end", values[None], 1.0)[0]
    return None


def save(recording: Recording, path: Path) -> list[Path]:
    """Write ``imu``, ``ts``, ``pos0``, and ``gps``, ``avp`` or ``att``, ``lever`` if the recording has them.

    Returns the path.

    Raises:
        OSError: a file that cannot be written.
    """
    from scipy.io import savemat  # slow to import

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


FORMAT = Format(
    "psins-mat", ".mat", load, save, keys=SITE_KEYS, lacks=("displacements", "aids", "standard deviations of the fixes")
)
