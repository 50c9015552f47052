"""Files of a solution: CSV, KML, TUM, KF-GINS and NPZ. A file appears whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as xml

import numpy as np

from sins_env import checks, earth
from sins_env.arrays import Array
from sins_env.evaluation.solution.columns import FRAMES, columns
from sins_env.evaluation.solution.epochs import Epochs
from sins_env.recordings import Reference, seconds
from sins_env.recordings.axes import swap_ned, swap_ned_attitude
from sins_env.recordings.formats.kfgins import truth_rows
from sins_env.writing.files import replacing
from sins_env.writing.visible import visible

KML = "http://www.opengis.net/kml/2.2"
#: Classes of the horizontal sigma, m, each up to its limit, with a colour in KML's order alpha, blue, green, red.
SIGMA_CLASSES = ((0.1, "ff50a000"), (0.5, "ff60d020"), (2.0, "ff00e0ff"), (10.0, "ff0080ff"), (np.inf, "ff0000e0"))
UNKNOWN = ("unknown", "ffa0a0a0")  #: name and colour of the class of a solver that tells no sigma


def save(
    one: Epochs, path: str | Path, kind: str | None = None, *, rate_hz: float | None = None, frame: str = "enu"
) -> None:
    """Write a solution in the format of the path's ending, or of ``kind``; without a rate every epoch is written.

    Raises:
        ValueError: an unknown ending, frame or rate, or a frame that the format does not have.
        OSError: a file that cannot be written.
    """
    name = check(path, frame) if kind is None else checks.choice("solution format", kind, FORMATS)
    _check_frame(name, frame)
    FORMATS[name](one.at_rate(rate_hz), path, frame)


def _check_frame(kind: str, frame: str) -> None:
    checks.choice("frame", frame, FRAMES)
    if frame != "enu" and kind in ONE_FRAME:
        raise ValueError(f"frame {frame!r} of a .{kind} file; allowed: none, the format has its own frame")


def check(path: str | Path, frame: str = "enu") -> str:
    """Return the format of a path by its ending, before anything is computed.

    Raises:
        ValueError: an ending that is none of a solution's, a frame that it does not have, or a directory that does not exist.
    """
    ending = Path(path).suffix.lower().removeprefix(".")
    if ending not in FORMATS:
        raise ValueError(f"{path}: allowed: a file that ends in {', '.join(f'.{name}' for name in FORMATS)}")
    if not Path(path).resolve().parent.is_dir():
        raise ValueError(f"{path}: the directory does not exist")
    _check_frame(ending, frame)
    return ending


def write(path: str | Path, put: Callable[[Path], Any]) -> None:
    """Have ``put`` write a file, which appears whole or not at all."""
    with replacing([Path(path)]) as (new,):
        put(new)


def _csv(one: Epochs, path: str | Path, frame: str) -> None:
    found = columns(one, frame)
    cells = [np.where(np.isnan(c.values), "", np.char.mod(c.form, np.nan_to_num(c.values))).tolist() for c in found]
    rows = map(",".join, zip(*cells, strict=True))
    text = "\n".join([",".join(column.name for column in found), *rows, ""])
    write(path, lambda new: new.write_text(text, encoding="utf-8"))


def _npz(one: Epochs, path: str | Path, frame: str) -> None:
    arrays: dict[str, Array] = {column.name: column.values for column in columns(one, frame)}

    def put(new: Path) -> None:
        with new.open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]

    write(path, put)


def _tum(one: Epochs, path: str | Path, frame: str) -> None:
    """Write stamp, x, y, z in m from the first position, and the quaternion x, y, z, w."""
    known = np.isfinite(one.position).all(axis=-1) & np.isfinite(one.attitude).all(axis=-1)
    pos, q, t = one.position[known], one.attitude[known], one.time[known]
    assert one.replay.source is not None
    model = earth.get(one.replay.source.site.earth)
    enu = earth.offset(model, np.broadcast_to(pos[:1], pos.shape), pos)
    if frame == "ned":
        enu, q = swap_ned(enu), swap_ned_attitude(q)
    rows = np.column_stack([t, enu, q[:, 1:], q[:, :1]])
    write(path, lambda new: np.savetxt(new, rows, fmt="%.6f" + " %.6f" * 3 + " %.9f" * 4))


def _nav(one: Epochs, path: str | Path, frame: str) -> None:
    """Write week (0), seconds, latitude, longitude, height, velocity N, E, D, roll, pitch, yaw."""
    known = np.isfinite(one.attitude).all(axis=-1)
    vel = np.nan_to_num(one.velocity[known])
    form, rows = truth_rows(Reference(one.time[known], one.attitude[known], vel, one.position[known]), one.position[0])
    text = "\n".join([*(form % tuple(row) for row in rows.tolist()), ""])
    write(path, lambda new: new.write_text(text, encoding="utf-8"))


def _kml(one: Epochs, path: str | Path, frame: str) -> None:
    """Write the track in pieces of one colour each, and its ends; heights are above the ellipsoid, so the map's ground is taken."""
    top = xml.Element("kml", xmlns=KML)
    document = xml.SubElement(top, "Document")
    _text(document, name=f"{one.recording} by {one.solver}{', smoothed' * one.smoothed}", open="1")
    _text(
        document,
        description=f"{seconds(one.time[0])} to {seconds(one.time[-1])} s; colour: horizontal sigma of the position",
    )
    names = [_class_name(i) for i in range(len(SIGMA_CLASSES))]
    for i, colour in enumerate([*(c for _, c in SIGMA_CLASSES), UNKNOWN[1]]):
        line = xml.SubElement(xml.SubElement(document, "Style", id=f"sigma{i}"), "LineStyle")
        _text(line, color=colour, width="4")
    folder = xml.SubElement(document, "Folder")
    _text(folder, name="track")
    for i, span in _pieces(one):
        mark = xml.SubElement(folder, "Placemark")
        when = f"{seconds(one.time[span][0])} to {seconds(one.time[span][-1])} s"
        _text(mark, name=f"sigma {[*names, UNKNOWN[0]][i]}", description=when, styleUrl=f"#sigma{i}")
        line = xml.SubElement(mark, "LineString")
        _text(line, tessellate="1", altitudeMode="clampToGround", coordinates=" ".join(_places(one.position[span])))
    for name, k in (("start", 0), ("end", -1)):
        mark = xml.SubElement(document, "Placemark")
        _text(mark, name=f"{name}, {seconds(one.time[k])} s")
        _text(xml.SubElement(mark, "Point"), coordinates=_places(one.position[[k]])[0])
    xml.indent(top, " ")
    text = xml.tostring(top, encoding="unicode", xml_declaration=False)
    write(path, lambda new: new.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', encoding="utf-8"))


def _text(parent: xml.Element, **parts: str) -> None:
    """Add elements with a text, in their order."""
    for name, text in parts.items():
        xml.SubElement(parent, name).text = visible(text)


def _class_name(i: int) -> str:
    limit = SIGMA_CLASSES[i][0]
    return f"up to {limit:g} m" if np.isfinite(limit) else f"above {SIGMA_CLASSES[i - 1][0]:g} m"


def _pieces(one: Epochs) -> Iterator[tuple[int, slice]]:
    """Yield the class of each piece of the track and its epochs, with the first of the next piece."""
    sigma = np.linalg.norm(one.sigma_position[:, :2], axis=-1)
    kind = np.searchsorted([limit for limit, _ in SIGMA_CLASSES], sigma)
    kind = np.where(np.isnan(sigma), len(SIGMA_CLASSES), kind)
    end = 0
    for i, same in groupby(kind.tolist()):
        first, end = end, end + len(list(same))
        yield i, slice(max(min(first, len(kind) - 2), 0), end + 1)


def _places(pos: Array) -> list[str]:
    known = pos[np.isfinite(pos).all(axis=-1)]
    return [f"{lon:.9f},{lat:.9f},{h:.3f}" for lat, lon, h in np.column_stack([np.degrees(known[:, :2]), known[:, 2]])]


#: Writers by ending; those of ONE_FRAME have a frame of their own.
FORMATS: dict[str, Callable[[Epochs, str | Path, str], None]] = {
    "csv": _csv,
    "kml": _kml,
    "tum": _tum,
    "nav": _nav,
    "npz": _npz,
}
ONE_FRAME = ("kml", "nav")
