"""Finding, reading and writing of recordings. The ending of a name tells the format."""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Iterator
from collections.abc import Mapping as Dict
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

from sins_env.checks import choice, unknown
from sins_env.recordings.assembling import check_ranges
from sins_env.recordings.column_units import check_plausible
from sins_env.recordings.file_format import PARTS, Format, unpacked_name
from sins_env.recordings.findings import check_findings, findings
from sins_env.recordings.findings.mending import with_mended_fixes
from sins_env.recordings.formats import FORMATS
from sins_env.recordings.mapping import MOST_NAME, Mapping, companion, read_mapping, to_mapping
from sins_env.recordings.recording import Recording
from sins_env.recordings.stamps.bridging import bridged, unbridged

DATA_VARIABLE = "SINS_ENV_DATA"  #: environment variable with the folder in which recordings are sought, too


def load(path: str | os.PathLike[str], *, format: str | None = None, mapping: Any = None, **settings: Any) -> Recording:
    """Read the recording at ``path`` or, failing that, at ``$SINS_ENV_DATA/path``. A file is read once and then kept.

    Args:
        path: a file of any format in ``FORMATS``, or a mapping (``.json``) that names one.
        format: one of ``FORMATS``; None takes that of the ending.
        mapping: path of a mapping, or its keys; None takes NAME.json beside a KF-GINS text or a CSV, if there is one.
        settings: single keys of the mapping, which replace those of ``mapping``: ``axes="FRD"``, ``resample_hz=100.0``,
            ``drop_duplicates=True``, ``velocity_from_positions=True``, ``accept=["clock_offset"]``, ...

    Raises:
        FileNotFoundError: no such file; the error says where it was sought, and the nearest name there.
        ValueError: a file that is no recording, or one with a finding that would make results wrong. The error has the
            file, what is wrong, and the sample, the line or the time.
    """
    found = _find(Path(path)).resolve()
    with _named(found):
        data, kind, given = _with_mapping(found, format, mapping)
        given |= {name: value for name, value in settings.items() if value is not None}
        for key in given:
            if key in Mapping.__dataclass_fields__ and key not in FORMATS[kind].allowed_keys:
                raise unknown(f"key of a mapping of {kind} files", key, FORMATS[kind].allowed_keys)
        whole = to_mapping(given, str(data))
        beside = [data.parent / name for name in whole.companions() if len(name) <= MOST_NAME]
        stamps = tuple(file.stat().st_mtime_ns for file in (data, *beside) if file.is_file())
        return _load(data, kind, whole.text(), stamps)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Put the name of a file before an error that names neither it nor another file beside it."""
    try:
        yield
    except ValueError as error:
        if str(path.parent) in str(error):
            raise
        raise ValueError(f"{path}: {error}") from error


def _with_mapping(found: Path, format: str | None, mapping: Any) -> tuple[Path, str, dict[str, Any]]:
    """Return the file with the data, its format, and the keys of its mapping."""
    if format is not None:
        choice("format", format, FORMATS)
    data, given = found, {}
    if isinstance(mapping, Dict):
        given = dict(mapping)
    elif mapping is not None:
        given = read_mapping(_find(Path(mapping)))
    elif found.suffix.lower() == ".json":
        given = read_mapping(found)
        if not isinstance(given.get("file"), str):
            names = sorted(
                one.name for one in found.parent.iterdir() if unpacked_name(one).with_suffix(".json") == found
            )
            described = ", ".join(name for name in names if name != found.name)
            instead = f", or what it describes: {described}" if described else ""
            raise ValueError(f'{found}: no file named; allowed: a mapping with "file"{instead}')
        data = companion(found, given["file"], found.name)
    else:
        beside = unpacked_name(found).with_suffix(".json")
        if beside.is_file() and (format is not None or _with_ending(found)):
            one = FORMATS[format or format_of(found)]
            given = read_mapping(beside) if one.companions or one.save is None else {}
        elif beside.is_file():  # an ending of no format: the mapping tells it
            given = read_mapping(beside)
    named = given.get("format")
    if named is not None:
        choice("format", named, FORMATS)
    return data, format or named or format_of(data), given


def _with_ending(path: Path) -> list[Format]:
    """Return the formats of the files that end as a path does."""
    ending = unpacked_name(path).suffix.lower()
    return [format for format in FORMATS.values() if ending in (format.ending, *format.more_endings)]


def format_of(path: Path, writes: bool = False) -> str:
    """Return the format of a name's ending. If formats share the ending, it is the one that recognises the file.

    With ``writes`` it is one that can be written; what stands in a file that is written over says nothing.

    Raises:
        ValueError: an ending of no format, or a file that none of several formats recognises, or more than one.
    """
    ending = unpacked_name(path).suffix
    alike = _with_ending(path)
    if writes and any(format.save for format in alike):
        alike = [format for format in alike if format.save]
    found = [format for format in alike if len(alike) == 1 or (path.is_file() and format.recognises(path))]
    found = found or [format for format in alike if format.save]
    if len(found) == 1:
        return found[0].name
    if alike:
        names = ", ".join(format.name for format in alike)
        raise ValueError(f"{path}: the ending {ending!r} is that of {names}; allowed: one of them, given as the format")
    endings = ", ".join(f"{format.ending} ({name})" for name, format in FORMATS.items())
    raise ValueError(f"{path}: no format has the ending {ending!r}; allowed: {endings}, .json (a mapping), or format")


def _find(path: Path) -> Path:
    folder = os.environ.get(DATA_VARIABLE)  # empty is as good as unset
    places = list(dict.fromkeys([path, Path(folder) / path] if folder else [path]))
    for place in places:
        if place.is_file():
            return place
    endings = {format.ending for format in FORMATS.values() if format.distinctive}
    folders = [place.parent for place in places if place.parent.is_dir()]
    names = sorted({p.name for there in folders for p in there.iterdir() if p.suffix.lower() in endings})
    stems = {Path(name).stem: name for name in names}
    near = difflib.get_close_matches(path.stem, list(stems), n=1, cutoff=0.6)
    hint = f"; did you mean '{stems[near[0]]}'?" if near else f"; recordings there: {', '.join(names) or 'none'}"
    unset = "" if folder else f" (${DATA_VARIABLE} is not set)"
    sought = " and ".join(map(str, places))
    raise FileNotFoundError(f"no recording {str(path)!r}; sought at {sought}{unset}{hint}")


@lru_cache(maxsize=8)
def _load(path: Path, kind: str, mapping: str, stamps: tuple[int, ...]) -> Recording:
    """Read a recording, or return it from the cache; ``stamps``, times of change, let a changed file be read again."""
    told = to_mapping(json.loads(mapping), str(path))
    recording = with_mended_fixes(FORMATS[kind].load(path, told), told)
    check_plausible(path, recording.rate_hz, recording.dtheta, recording.dvel)
    check_ranges(path, recording)
    recording = bridged(recording, told.bridge_s)
    check_findings(findings(recording), told.accept)
    return recording


def save(
    recording: Recording, path: str | os.PathLike[str], *, format: str | None = None, overwrite: bool = False
) -> list[Path]:
    """Write a recording in the format of the ending, or in ``format``, and return the paths of the files.

    The files appear only when all are whole. :func:`left_out` names the parts that the format has no place for.

    Raises:
        ValueError: no such format.
        FileNotFoundError: no such directory.
        FileExistsError: a file that is there already, without ``overwrite``.
        OSError: files that cannot be written; nothing has changed then.
    """
    where = Path(path)
    kind = format or format_of(where, writes=True)
    choice("format", kind, FORMATS)
    write = FORMATS[kind].save
    if write is None:
        writable = ", ".join(name for name, format in FORMATS.items() if format.save)
        raise ValueError(f"{where}: {kind} is only read; allowed: {writable}")
    if not where.resolve().parent.is_dir():
        raise FileNotFoundError(f"{where}: the directory does not exist")
    there = [file for file in _targets(recording, where, kind) if file.exists()]
    if there and not overwrite:
        raise FileExistsError(f"{', '.join(map(str, there))} exists already; allowed: another name, or to overwrite it")
    return write(unbridged(recording), where)


def _targets(recording: Recording, path: Path, kind: str) -> list[Path]:
    beside = FORMATS[kind].beside(path)
    parts = (recording.gnss, recording.reference)
    there = [file for file, part in zip(beside, parts, strict=False) if part is not None]
    there += [path.with_name(f"{path.stem}_{name}{path.suffix}") for name in recording.aids if beside]
    return [path, *there, *([path.with_suffix(".json")] if beside else [])]


def left_out(recording: Recording, format: str) -> list[str]:
    """Name the parts of a recording that a format has no place for."""
    lacks = FORMATS[format].lacks
    return [part for part, has in PARTS.items() if part in lacks and has(recording)]
