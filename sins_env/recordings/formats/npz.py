"""NPZ files: two foreign layouts, recognised by their keys, and the package's own.

``LAYOUTS`` has the axes and the keys of each foreign layout. The package's own layout (:func:`save`) holds a
:class:`Recording` as it is in memory, so that it comes back with the same bits.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.checks import choice
from sins_env.reading.archives import Archive, archive
from sins_env.recordings.assembling import check_unit, geodetic, site
from sins_env.recordings.axes import to_rfu, turned
from sins_env.recordings.clock import Samples, check_increasing, clocked, on_grid, resample
from sins_env.recordings.file_format import Format
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.readings import SIZES, WAYS
from sins_env.recordings.recording import Displacements, Gnss, Readings, Recording, Reference, first_few, frozen
from sins_env.writing.files import replacing


class Layout(NamedTuple):
    """A foreign layout of an NPZ file."""

    axes: str  #: directions of the file's x, y, z, one letter each of R L F B U D
    keys: tuple[str, ...]  #: keys that it must have


#: Layouts of NPZ files by name.
LAYOUTS = {
    "counts": Layout(
        "RFU",
        (
            "fs_hz",
            "t0_s",
            "gyro_counts",
            "accel_counts",
            "gyro_lsb_rad",
            "accel_lsb_mps",
            "lat_deg",
            "lon_deg",
            "h_m",
        ),
    ),
    "increments": Layout("BRU", ("fs_hz", "imu_t_s", "dtheta_rad", "dvel_mps", "gnss_llh_deg_m")),
}
OWN = "sins_env_recording"  #: key that marks the package's own files; its value is the version
VERSION = 1


def load(path: Path, mapping: Mapping) -> Recording:
    """Read an NPZ file of any layout.

    Raises:
        ValueError: no readable NPZ file, no known layout, or an array of the wrong form.
    """
    with archive(path) as arrays:
        return _load(_File(path, arrays), mapping)


def _load(file: _File, mapping: Mapping) -> Recording:
    if OWN in file.keys:
        return _own(file, mapping)
    for name, layout in LAYOUTS.items():
        if set(layout.keys) <= file.keys:
            axes = mapping.axes or layout.axes
            return _counts(file, axes, mapping) if name == "counts" else _increments(file, axes, mapping)
    lacking = {name: sorted(set(layout.keys) - file.keys) for name, layout in LAYOUTS.items()}
    near = min(lacking, key=lambda name: len(lacking[name]))
    missing = ", ".join(lacking[near])
    raise ValueError(f"{file.path}: not a known layout; nearest is {near!r}, but keys are missing: {missing}")


class _File:
    """The arrays of an NPZ file, each read and checked on demand."""

    def __init__(self, path: Path, arrays: Archive) -> None:
        self.path, self._arrays, self.keys = path, arrays, set(arrays.keys())

    def scalar(self, key: str, positive: bool = False) -> float:
        value = float(self.array(key, ()))
        if positive and value <= 0:
            raise ValueError(f"{self.path}: {key} = {value:g}; allowed: positive")
        return value

    def array(self, key: str, shape: tuple[int | None, ...]) -> Array:
        """Return an array as float64; ``None`` in the shape stands for any length from 1 on."""
        if key not in self.keys:
            raise ValueError(f"{self.path}: {key} is missing; keys there: {first_few(self._arrays.keys(), 30)}")
        raw = self._arrays.read(key)
        if raw.dtype.kind not in "iuf":
            raise ValueError(f"{self.path}: {key} holds {raw.dtype}; allowed: numbers")
        fits = raw.ndim == len(shape) and all(n == (want or n) for n, want in zip(raw.shape, shape, strict=True))
        if not fits or raw.size == 0:
            allowed = ", ".join("any length" if n is None else str(n) for n in shape)
            raise ValueError(f"{self.path}: {key} has shape {raw.shape}; allowed: ({allowed})")
        bad = np.argwhere(~np.isfinite(raw))
        if len(bad):
            raise ValueError(f"{self.path}: {key} is not finite at sample {bad[0, 0] if raw.ndim else 0}")
        return raw.astype(np.float64)

    def text(self, key: str, default: str) -> str:
        return str(self._arrays.read(key)) if key in self.keys else default

    def optional(self, key: str, shape: tuple[int | None, ...]) -> Array | None:
        return self.array(key, shape) if key in self.keys else None

    def times(self, key: str) -> Array:
        t = self.array(key, (None,))
        check_increasing(str(self.path), key, sample, t)
        return t

    def positions(self, key: str, count: int) -> Array:
        return geodetic(self.path, key, sample, self.array(key, (count, 3)))

    def quaternions(self, key: str, count: int) -> Array:
        return check_unit(self.path, key, sample, self.array(key, (count, 4)))


def sample(i: int) -> str:
    """Return the place of a row of an array, for errors."""
    return f"sample {i}"


def _counts(file: _File, axes: str, mapping: Mapping) -> Recording:
    """Read the layout with pulse counts on a uniform clock, at a nominal site, without GNSS."""
    turn = to_rfu(axes)
    counts = file.array("gyro_counts", (None, 3))
    dtheta = counts @ turn.T * file.scalar("gyro_lsb_rad", positive=True)
    dvel = file.array("accel_counts", (len(counts), 3)) @ turn.T * file.scalar("accel_lsb_mps", positive=True)
    place = np.array([[file.scalar(key) for key in ("lat_deg", "lon_deg", "h_m")]])
    where = site(geodetic(file.path, "lat_deg, lon_deg, h_m", sample, place)[0])
    rate, t0 = file.scalar("fs_hz", positive=True), file.scalar("t0_s")
    reference = _reference(file, turn)
    recording = Recording(file.path.stem, rate, t0, frozen(dtheta), frozen(dvel), where, reference=reference)
    return resample(recording, mapping.resample_hz) if mapping.resample_hz else recording


def _increments(file: _File, axes: str, mapping: Mapping) -> Recording:
    """Read the layout with stamped increments and GNSS; the site is the first fix."""
    turn, rate = to_rfu(axes), file.scalar("fs_hz", positive=True)
    tags = file.array("imu_t_s", (None,))
    dtheta, dvel = (turned(file.array(key, (len(tags), 3)), turn) for key in ("dtheta_rad", "dvel_mps"))
    samples = Samples(str(file.path), "imu_t_s", sample, tags, dtheta, dvel)
    clock = clocked(samples, rate, mapping.resample_hz, mapping.drop_duplicates)
    t = file.times("gnss_t_imu_s")
    gnss = Gnss(t, file.array("gnss_vel_enu_mps", (len(t), 3)), file.positions("gnss_llh_deg_m", len(t)))
    lever = turn @ file.array("lever_arm_est_body_m", (3,)) if "lever_arm_est_body_m" in file.keys else None
    t0, rate, dtheta, dvel = clock[:4]
    parts = (gnss, lever, _reference(file, turn), _displacements(file), clock.stamping)
    return Recording(file.path.stem, rate, t0, dtheta, dvel, site(gnss.pos[0]), *parts)


def _displacements(file: _File) -> Displacements | None:
    """Read displacements, whose keys all layouts share; without a span they cover a second."""
    if "tdcp_t_imu_s" not in file.keys:
        return None
    t = file.times("tdcp_t_imu_s")
    span = file.scalar("tdcp_span_s", positive=True) if "tdcp_span_s" in file.keys else 1.0
    satellites, residual = (file.array(key, (len(t),)) for key in ("tdcp_nsat", "tdcp_res_rms_m"))
    return Displacements(t, span, file.array("tdcp_disp_enu_m", (len(t), 3)), satellites, residual)


def _reference(file: _File, turn: Array) -> Reference | None:
    if "ref_q_b2n_wxyz" not in file.keys:
        return None
    t = file.times("ref_t_s")
    q = file.quaternions("ref_q_b2n_wxyz", len(t))
    q_nb = attitude.multiply(attitude.normalize(q), attitude.from_dcm(turn.T))
    vel = file.array("ref_vel_enu_mps", (len(t), 3)) if "ref_vel_enu_mps" in file.keys else None
    pos = file.positions("ref_llh_deg_m", len(t)) if "ref_llh_deg_m" in file.keys else None
    return Reference(t, q_nb, vel, pos)


def _own(file: _File, mapping: Mapping) -> Recording:
    """Read the package's own layout, bit for bit what :func:`save` wrote."""
    version = file.scalar(OWN)
    if version != VERSION:
        raise ValueError(f"{file.path}: {OWN} = {version:g}; allowed: {VERSION}")
    if mapping.axes not in (None, "RFU"):
        raise ValueError(f"{file.path}: axes = {mapping.axes!r}; allowed: RFU, which the package's own files have")
    index = file.array("sample", (None,)).astype(np.int64)
    wrong = np.flatnonzero(np.diff(index, prepend=-1) < 1)
    if len(wrong):
        raise ValueError(f"{file.path}: sample does not increase at {sample(int(wrong[0]))}")
    n = len(index)
    if index[0] or index[-1] >= 2 * n:
        raise ValueError(f"{file.path}: sample goes from {index[0]} to {index[-1]}; allowed: 0 to {2 * n - 1} for {n}")
    dtheta, dvel = (on_grid(index, file.array(key, (n, 3))) for key in ("dtheta_rad", "dvel_mps"))
    place = _in_range(file, "site_rad_m", file.array("site_rad_m", (3,))[None])[0]
    gnss = reference = None
    if "gnss_t_s" in file.keys:
        t = file.times("gnss_t_s")
        vel, pos_std, vel_std = (
            file.optional(f"gnss_{key}", (len(t), 3)) for key in ("vel_enu_mps", "pos_std_enu_m", "vel_std_enu_mps")
        )
        pos = _in_range(file, "gnss_llh_rad_m", file.array("gnss_llh_rad_m", (len(t), 3)))
        gnss = Gnss(t, vel, pos, pos_std, vel_std)
    if "ref_t_s" in file.keys:
        t = file.times("ref_t_s")
        llh = file.optional("ref_llh_rad_m", (len(t), 3))
        reference = Reference(
            t,
            file.quaternions("ref_q_nb_wxyz", len(t)),
            file.optional("ref_vel_enu_mps", (len(t), 3)),
            None if llh is None else _in_range(file, "ref_llh_rad_m", llh),
        )
    recording = Recording(
        file.path.stem,
        file.scalar("rate_hz", positive=True),
        file.scalar("t0_s"),
        dtheta,
        dvel,
        site(place, file.text("site_earth", "wgs84")),
        gnss,
        file.optional("lever_arm_rfu_m", (3,)),
        reference,
        _displacements(file),
        scale=file.text("time_scale", "") or None,
        aids=_aids(file),
    )
    return resample(recording, mapping.resample_hz) if mapping.resample_hz else recording


def _aids(file: _File) -> dict[str, Readings]:
    """Read the readings of aiding sensors that the package's own layout holds."""
    found = {}
    for name in sorted(
        key[len("aid_") : -len("_t_s")] for key in file.keys if key.startswith("aid_") and key.endswith("_t_s")
    ):
        choice(f"{file.path}: aid", name, WAYS)
        t = file.times(f"aid_{name}_t_s")
        values = file.array(f"aid_{name}_values", (len(t), None))
        most = max(SIZES[name])
        if values.shape[1] not in SIZES[name]:
            raise ValueError(f"{file.path}: aid_{name}_values has {values.shape[1]} columns; allowed: {most}")
        found[name] = Readings(t, values, bool(file.scalar(f"aid_{name}_unit")))
    return found


def _in_range(file: _File, key: str, llh: Array) -> Array:
    """Return positions, latitude and longitude in rad, unchanged after a check of their range."""
    geodetic(file.path, key, sample, llh, 1.0)
    return llh


def save(recording: Recording, path: Path) -> list[Path]:
    """Write the package's own layout, which leaves nothing out. Returns the path.

    Raises:
        OSError: a file that cannot be written.
    """
    here = np.flatnonzero(~recording.missing)
    gnss, ref = recording.gnss, recording.reference
    arrays: dict[str, Any] = {
        OWN: VERSION,
        "rate_hz": recording.rate_hz,
        "t0_s": recording.t0,
        "time_scale": recording.scale,
        "sample": here,
        "dtheta_rad": recording.dtheta[here],
        "dvel_mps": recording.dvel[here],
        "site_rad_m": recording.site.pos,
        "site_earth": recording.site.earth,
        "lever_arm_rfu_m": recording.lever_arm,
    }
    if gnss is not None:
        arrays |= {"gnss_t_s": gnss.t_s, "gnss_vel_enu_mps": gnss.vel, "gnss_llh_rad_m": gnss.pos}
        arrays |= {"gnss_pos_std_enu_m": gnss.pos_std, "gnss_vel_std_enu_mps": gnss.vel_std}
    if ref is not None:
        arrays |= {"ref_t_s": ref.t_s, "ref_q_nb_wxyz": ref.q_nb, "ref_vel_enu_mps": ref.vel, "ref_llh_rad_m": ref.pos}
    for name, readings in recording.aids.items():
        arrays |= {f"aid_{name}_t_s": readings.t_s, f"aid_{name}_values": readings.values}
        arrays |= {f"aid_{name}_unit": int(readings.unit)}
    if recording.displacements is not None:
        keys = ("tdcp_t_imu_s", "tdcp_span_s", "tdcp_disp_enu_m", "tdcp_nsat", "tdcp_res_rms_m")
        arrays |= zip(keys, recording.displacements, strict=True)
    with replacing([path]) as (new,), new.open("wb") as stream:
        np.savez(stream, **{key: value for key, value in arrays.items() if value is not None})
    return [path]


FORMAT = Format("npz", ".npz", load, save)
