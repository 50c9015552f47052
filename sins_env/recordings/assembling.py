"""Checks of fixes, references and places from any file, and the recording made of them. Errors name file, field and row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.recordings.clock import Clocked
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Gnss, Recording, Reference, seconds
from sins_env.types import Site
from sins_env.units import DEG

Place = Callable[[int], str]  #: function that tells the place of a row in its file, such as "line 17" or "sample 3"

#: Limits of the parts of a recording, far beyond those of vehicles.
MOST_ANGLE = 1e3
MOST_SPEED_MPS, MOST_HEIGHT_M, MOST_LEVER_M, MOST_STD = 1e5, 1e7, 1e4, 1e9
MOST_RATE_HZ, MOST_SAMPLE_S, MOST_TIME_S = 1e7, 1e4, 1e12
LATITUDE = "latitude within 89.9 deg, longitude within 360 deg, height in m"


def geodetic(path: Path, key: str, place: Place, llh: Array, unit: float = DEG) -> Array:
    """Return latitude rad, longitude rad in [-pi, pi) and height m, (n, 3), of angles in ``unit`` and heights in m.

    Raises:
        ValueError: angles out of range.
    """
    rad = llh[:, :2] * unit if unit != DEG else np.radians(llh[:, :2])
    bad = np.flatnonzero((np.abs(rad) > [earth.MAX_LATITUDE, 2 * np.pi * (1 + 1e-15)]).any(axis=1))
    if len(bad):
        raise ValueError(f"{path}: {key} is {llh[bad[0]]} at {place(int(bad[0]))}; allowed: {LATITUDE}")
    lon = rad[:, 1]
    return np.column_stack([rad[:, 0], np.where(np.abs(lon) < np.pi, lon, attitude.wrap(lon)), llh[:, 2]])


def check_unit(path: Path, key: str, place: Place, q: Array) -> Array:
    """Return the quaternions (n, 4).

    Raises:
        ValueError: a quaternion that is not of unit length.
    """
    bad = np.flatnonzero(np.abs(np.sum(q * q, axis=-1) - 1.0) > 1e-3)
    if len(bad):
        raise ValueError(f"{path}: {key} is not a unit quaternion at {place(int(bad[0]))}")
    return q


def site(pos: Sequence[float] | Array, earth_name: str = "wgs84") -> Site:
    """Make a site of latitude rad, longitude rad and height m."""
    return Site(float(pos[0]), float(pos[1]), float(pos[2]), earth_name)


def check_overlap(path: Path, what: str, t: Array, begin: float, end: float) -> None:
    """Check that some stamp lies within the time of the IMU, from ``begin`` to ``end``.

    Raises:
        ValueError: no stamp does; most likely there are two clocks.
    """
    if not ((t > begin) & (t <= end)).any():
        raise ValueError(
            f"{path}: {what} from {seconds(t[0])} to {seconds(t[-1])} s, the IMU from {seconds(begin)} to "
            f"{seconds(end)} s; allowed: one clock for both"
        )


def check_ranges(path: Path, recording: Recording) -> None:
    """Check that fixes, reference, lever arm and clock of a recording lie within what any vehicle near the Earth does.

    Raises:
        ValueError: a value out of its range.
    """
    gnss, ref = recording.gnss, recording.reference
    parts: dict[tuple[str, float], Any] = {
        ("velocity increments", MOST_SPEED_MPS): _ends(recording.dvel),
        ("angle increments", MOST_ANGLE): _ends(recording.dtheta),
        ("rate_hz", MOST_RATE_HZ): recording.rate_hz,
        ("1 / rate_hz", MOST_SAMPLE_S): 1.0 / recording.rate_hz,
        ("t0", MOST_TIME_S): recording.t0,
        ("lever arm", MOST_LEVER_M): recording.lever_arm,
        ("height of the site", MOST_HEIGHT_M): recording.site.height,
        ("velocity of the fixes", MOST_SPEED_MPS): gnss and gnss.vel,
        ("height of the fixes", MOST_HEIGHT_M): gnss and gnss.pos[:, 2],
        ("standard deviation of the fixes", MOST_STD): gnss and gnss.pos_std,
        ("standard deviation of the velocities", MOST_STD): gnss and gnss.vel_std,
        ("velocity of the reference", MOST_SPEED_MPS): ref and ref.vel,
        ("height of the reference", MOST_HEIGHT_M): None if ref is None or ref.pos is None else ref.pos[:, 2],
        ("displacements", MOST_HEIGHT_M): recording.displacements and recording.displacements.enu,
    }
    for (name, most), values in parts.items():
        if values is None:
            continue
        largest = float(np.max(np.abs(values), initial=0.0))
        if not largest <= most:
            raise ValueError(f"{path}: {name} is up to {largest:g}; allowed: at most {most:g}")


def _ends(values: Array) -> Array:
    """Return the least and the largest of ``values`` (n, m) that are there, without a copy of all."""
    return np.array([np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None)])


def with_velocities(gnss: Gnss) -> Gnss:
    """Return fixes with velocities, which are differences of the positions around each fix.

    Their errors are correlated from fix to fix, and they lag behind accelerations: better than none, worse than Doppler.
    Differences never span a missing fix.

    Raises:
        ValueError: fewer than two fixes in a row.
    """
    model = earth.get("wgs84")
    meridian, normal = earth.radii(model, gnss.pos[:, 0])
    scale = np.column_stack(
        [(normal + gnss.pos[:, 2]) * np.cos(gnss.pos[:, 0]), meridian + gnss.pos[:, 2], np.ones(len(gnss.pos))]
    )
    t, lon = gnss.t_s, np.unwrap(gnss.pos[:, 1])
    enu = np.column_stack([lon, gnss.pos[:, 0], gnss.pos[:, 2]])
    step = np.diff(t)
    breaks = np.flatnonzero(step > 1.5 * np.median(step)) + 1 if len(step) else np.array([], dtype=np.int64)
    parts = [part for part in np.split(np.arange(len(t)), breaks) if len(part) > 1]
    if not parts:
        raise ValueError(f"{len(t)} fixes, no two in a row; allowed: at least two for velocities from positions")
    keep = np.concatenate(parts)
    vel = np.concatenate([np.gradient(enu[part], t[part], axis=0) * scale[part] for part in parts])
    std = None if gnss.pos_std is None else gnss.pos_std[keep]
    return Gnss(t[keep], vel, gnss.pos[keep], std, None)


def assemble(
    path: Path, mapping: Mapping, clock: Clocked, gnss: Gnss | None, reference: Reference | None, lever: Array | None
) -> Recording:
    """Make a recording of text files on one clock. Its site is that of the mapping, of the first fix or of the reference.

    Raises:
        ValueError: fixes or a reference on another clock, or no place on the Earth.
    """
    t0, rate, dtheta, dvel = clock[:4]
    end = t0 + len(dtheta) / rate
    if gnss is not None:
        check_overlap(path, "fixes", gnss.t_s, t0, end)
    if reference is not None:
        check_overlap(path, "the reference", reference.t_s, t0, end)
    if mapping.site is not None:
        pos = geodetic(path, "site", lambda i: "its mapping", np.array([mapping.site]))[0]
    elif gnss is not None:
        pos = gnss.pos[0]
    elif reference is not None and reference.pos is not None:
        pos = reference.pos[0]
    else:
        raise ValueError(
            f"{path}: no place on the earth; allowed: site, gnss or reference in a mapping, for instance "
            f'{path.stem}.json with {{"site": [latitude deg, longitude deg, height m]}}'
        )
    more = (gnss, lever, reference, None, clock.stamping, clock.scale)
    return Recording(path.stem, rate, t0, dtheta, dvel, site(pos), *more)
