"""Real recordings from NPZ files: increments, fixes and reference, delivered in the frames of this package.

A file's layout is recognised by its keys. ``LAYOUTS`` names what each one must hold and along which axes its
sensors lie; increments, reference attitude and lever arm are turned to Right-Forward-Up, whatever those are.
"""

from __future__ import annotations

import difflib
import os
import zipfile
import zlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.types import Site

Array = NDArray[np.float64]

DATA_VARIABLE = "SINS_ENV_DATA"


class Layout(NamedTuple):
    axes: str  #: where the file's x, y, z point: one letter each of R L F B U D
    keys: tuple[str, ...]


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


class Gnss(NamedTuple):
    """Fixes of the antenna, on the clock of the IMU."""

    t_s: Array  #: (M,)
    vel: Array  #: (M, 3) m/s East, North, Up
    pos: Array  #: (M, 3) latitude rad, longitude rad, height m


class Reference(NamedTuple):
    """What the recording is scored against; a smoothed solution at the IMU, not an outside truth."""

    t_s: Array  #: (L,)
    q_nb: Array  #: (L, 4) Right-Forward-Up body to East-North-Up
    vel: Array | None  #: (L, 3) m/s
    pos: Array | None  #: (L, 3) latitude rad, longitude rad, height m


@dataclass(frozen=True, eq=False)
class Recording:
    """Sample k covers (t0 + k / rate_hz, t0 + (k + 1) / rate_hz]. Arrays are shared and read-only."""

    name: str
    rate_hz: float
    t0: float  #: s, where the first sample begins
    dtheta: Array  #: (N, 3) rad, Right-Forward-Up; NaN where samples are missing
    dvel: Array  #: (N, 3) m/s
    site: Site
    gnss: Gnss | None = None
    lever_arm: Array | None = None  #: (3,) m from the IMU to the antenna, Right-Forward-Up
    reference: Reference | None = None

    @property
    def end(self) -> float:
        """s, where the last sample ends."""
        return self.t0 + len(self.dtheta) / self.rate_hz


def load(path: str | os.PathLike[str]) -> Recording:
    """The recording at ``path`` or, failing that, at ``$SINS_ENV_DATA/path``; each file is read once.

    Raises:
        FileNotFoundError: no such file; says where it was sought and the nearest name there.
        ValueError: a file that is not a recording, naming the file, the key and the sample.
    """
    found = _find(Path(path)).resolve()
    return _load(found, found.stat().st_mtime_ns)


def _find(path: Path) -> Path:
    folder = os.environ.get(DATA_VARIABLE)  # empty is as good as unset
    places = list(dict.fromkeys([path, Path(folder) / path] if folder else [path]))
    for place in places:
        if place.is_file():
            return place
    names = sorted({p.name for place in places if place.parent.is_dir() for p in place.parent.glob("*.npz")})
    near = difflib.get_close_matches(path.stem, [name.removesuffix(".npz") for name in names], n=1, cutoff=0.6)
    hint = f"; did you mean '{near[0]}.npz'?" if near else f"; recordings there: {', '.join(names) or 'none'}"
    unset = "" if folder else f" (${DATA_VARIABLE} is not set)"
    sought = " and ".join(map(str, places))
    raise FileNotFoundError(f"no recording {str(path)!r}; sought at {sought}{unset}{hint}")


@lru_cache(maxsize=8)
def _load(path: Path, mtime_ns: int) -> Recording:
    """``mtime_ns`` is part of the key: a file that has changed is read again."""
    file = _File(path)
    for name, layout in LAYOUTS.items():
        if set(layout.keys) <= file.arrays.keys():
            return _counts(file, layout) if name == "counts" else _increments(file, layout)
    lacking = {name: sorted(set(layout.keys) - file.arrays.keys()) for name, layout in LAYOUTS.items()}
    near = min(lacking, key=lambda name: len(lacking[name]))
    missing = ", ".join(lacking[near])
    raise ValueError(f"{path}: not a known layout; nearest is {near!r}, but keys are missing: {missing}")


class _File:
    """The arrays of an NPZ file, each checked when it is asked for."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with path.open("rb") as stream:  # np.load leaves a file that it opened itself open on failure
                data = np.load(stream, allow_pickle=False)
                if not isinstance(data, np.lib.npyio.NpzFile):
                    raise ValueError("one bare array")
                with data:
                    self.arrays = {key: data[key] for key in data.files}
        except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile, zlib.error) as error:
            raise ValueError(f"{path}: not a readable NPZ archive, or a truncated one ({error})") from error

    def scalar(self, key: str, positive: bool = False) -> float:
        value = float(self.array(key, ()))
        if positive and value <= 0:
            raise ValueError(f"{self.path}: {key} = {value:g}; allowed: positive")
        return value

    def array(self, key: str, shape: tuple[int | None, ...]) -> Array:
        """The array as float64; ``None`` in the shape stands for any length from 1."""
        raw = self.arrays[key]
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

    def times(self, key: str) -> Array:
        t = self.array(key, (None,))
        back = np.flatnonzero(np.diff(t) <= 0)
        if len(back):
            raise ValueError(f"{self.path}: {key} does not increase at sample {back[0] + 1}")
        return t

    def geodetic(self, key: str, llh: Array) -> Array:
        """Latitude rad, longitude rad in [-pi, pi), height m of degrees, degrees, metres (n, 3)."""
        bad = np.flatnonzero((np.abs(llh[:, :2]) > [np.degrees(earth.MAX_LATITUDE), 360.0]).any(axis=1))
        if len(bad):
            raise ValueError(
                f"{self.path}: {key} is {llh[bad[0]]} at sample {bad[0]}; allowed: latitude within 89.9 deg, "
                "longitude within 360 deg, height in m"
            )
        rad = np.radians(llh[:, :2])
        return np.column_stack([rad[:, 0], attitude.wrap(rad[:, 1]), llh[:, 2]])

    def positions(self, key: str, count: int) -> Array:
        return self.geodetic(key, self.array(key, (count, 3)))


def _counts(file: _File, layout: Layout) -> Recording:
    """Pulse counts on a uniform clock, a nominal site, no GNSS."""
    turn = to_rfu(layout.axes)
    counts = file.array("gyro_counts", (None, 3))
    dtheta = counts @ turn.T * file.scalar("gyro_lsb_rad", positive=True)
    dvel = file.array("accel_counts", (len(counts), 3)) @ turn.T * file.scalar("accel_lsb_mps", positive=True)
    place = np.array([[file.scalar(key) for key in ("lat_deg", "lon_deg", "h_m")]])
    site = _site(file.geodetic("lat_deg, lon_deg, h_m", place)[0])
    rate, t0 = file.scalar("fs_hz", positive=True), file.scalar("t0_s")
    return Recording(file.path.stem, rate, t0, _frozen(dtheta), _frozen(dvel), site, reference=_reference(file, turn))


def _increments(file: _File, layout: Layout) -> Recording:
    """Tagged increments with GNSS; the site is the first fix."""
    turn, rate = to_rfu(layout.axes), file.scalar("fs_hz", positive=True)
    tags = file.array("imu_t_s", (None,))
    index = _sample_index(file.path, tags, rate)

    def on_grid(key: str) -> Array:
        grid = np.full((index[-1] + 1, 3), np.nan)
        grid[index] = file.array(key, (len(tags), 3)) @ turn.T
        return _frozen(grid)

    dtheta, dvel = on_grid("dtheta_rad"), on_grid("dvel_mps")
    t = file.times("gnss_t_imu_s")
    gnss = Gnss(t, file.array("gnss_vel_enu_mps", (len(t), 3)), file.positions("gnss_llh_deg_m", len(t)))
    lever = turn @ file.array("lever_arm_est_body_m", (3,)) if "lever_arm_est_body_m" in file.arrays else None
    site = _site(gnss.pos[0])
    t0 = float(tags[0]) - 1.0 / rate
    return Recording(file.path.stem, rate, t0, dtheta, dvel, site, gnss, lever, _reference(file, turn))


def _sample_index(path: Path, tags: Array, rate: float) -> NDArray[np.int64]:
    """The place of each sample on a uniform clock; steps over two or more places are gaps.

    A tag that alone is off, while its neighbours lie two samples apart, is jitter of the tag.
    """
    tags = tags.copy()
    jitter = np.flatnonzero(np.abs(tags[2:] - tags[:-2] - 2 / rate) < 0.2 / rate) + 1
    tags[jitter] = 0.5 * (tags[jitter - 1] + tags[jitter + 1])
    index = np.rint((tags - tags[0]) * rate).astype(np.int64)
    back = np.flatnonzero(np.diff(index) < 1)
    if len(back):
        raise ValueError(f"{path}: imu_t_s does not increase by one sample of {rate:g} Hz at sample {back[0] + 1}")
    if index[-1] >= 2 * len(tags):
        raise ValueError(f"{path}: imu_t_s spans {index[-1] + 1} samples of {rate:g} Hz; only {len(tags)} are there")
    return index


def _site(pos: Array) -> Site:
    return Site(float(pos[0]), float(pos[1]), float(pos[2]))


def _reference(file: _File, turn: Array) -> Reference | None:
    if "ref_q_b2n_wxyz" not in file.arrays:
        return None
    t = file.times("ref_t_s")
    q = file.array("ref_q_b2n_wxyz", (len(t), 4))
    bad = np.flatnonzero(np.abs(np.sum(q * q, axis=-1) - 1.0) > 1e-3)
    if len(bad):
        raise ValueError(f"{file.path}: ref_q_b2n_wxyz is not a unit quaternion at sample {bad[0]}")
    q_nb = attitude.multiply(attitude.normalize(q), attitude.from_dcm(turn.T))
    vel = file.array("ref_vel_enu_mps", (len(t), 3)) if "ref_vel_enu_mps" in file.arrays else None
    pos = file.positions("ref_llh_deg_m", len(t)) if "ref_llh_deg_m" in file.arrays else None
    return Reference(t, q_nb, vel, pos)


def to_rfu(axes: str) -> Array:
    """(3, 3) matrix from components along the named axes ("BRU": backward, right, up) to Right-Forward-Up."""
    unit = {"R": (1, 0, 0), "F": (0, 1, 0), "U": (0, 0, 1), "L": (-1, 0, 0), "B": (0, -1, 0), "D": (0, 0, -1)}
    return np.array([unit[letter] for letter in axes], dtype=float).T


def _frozen(array: Array) -> Array:
    array.flags.writeable = False
    return array
