"""A bundle: the rows of one solver with its name, sources, provenance and board, in one ZIP file.

    submission.json     what is claimed, and the SHA-256 of every other file
    results.sqlite      the rows, as a results file
    board.md            the table that they make
    solver/...          the Python files of the solver, unless it is one of this project

A bundle comes from a stranger. Its members are those names and nothing else, each is inflated up to what it declares, and each must
have its hash. Nothing of it is imported. The results file is inspected as any other when it is opened.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Any

from sins_env.reading.documents import MOST_BYTES, parse_json
from sins_env.reading.files import opened, size
from sins_env.writing.files import replacing
from sins_env.writing.visible import visible

FORMAT = 1
SUBMISSION, RESULTS, BOARD, SOURCES = "submission.json", "results.sqlite", "board.md", "solver"
MOST_FILES = 300  #: most members of a bundle
MOST_SIZE = 1 << 30  #: most bytes of a bundle, as it is and inflated
BLOCK = 1 << 20  #: bytes that are inflated at once
_PART = r"[A-Za-z_][A-Za-z0-9_]*"
_MEMBER = re.compile(rf"{re.escape(RESULTS)}|{re.escape(BOARD)}|{SOURCES}/({_PART}/)*{_PART}\.py")
_BROKEN = (OSError, EOFError, KeyError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True)
class Submission:
    """What an entrant claims; all of it can be checked with the rows and the sources in the bundle."""

    format: int
    made: str  #: UTC
    solver: str  #: name or path, such as ``--solver`` takes
    settings: dict[str, Any]
    code: str  #: version of the code of the rows, which holds the world, the solvers of this project and the entry
    project: str  #: version of the code of this project alone
    versions: dict[str, str]  #: versions of Python and of the packages that compute
    runs: dict[str, int]  #: number of runs by task
    digests: dict[str, str]  #: digest of each task's world
    checked: int  #: number of rows that the entrant's machine has run once more
    board: list[Any]  #: what ``board --json`` says of the rows
    files: dict[str, str]  #: SHA-256 of each other member


def sha256(data: bytes) -> str:
    """Return the hash of a member: 64 hex digits."""
    return hashlib.sha256(data).hexdigest()


def sources_hash(files: Mapping[str, str]) -> str:
    """Return one hash of the sources among the members of a bundle, to be published; empty if there are none."""
    lines = [f"{name} {digest}\n" for name, digest in sorted(files.items()) if name.startswith(f"{SOURCES}/")]
    return sha256("".join(lines).encode()) if lines else ""


def pack(path: Path, submission: Submission, members: Mapping[str, Path]) -> None:
    """Write a bundle, whole or not at all; ``members`` are the files by their names in it.

    Raises:
        ValueError: a name that a bundle does not have, or too many files.
        OSError: a file that cannot be read or written.
    """
    _check_names(list(members))
    with replacing([path]) as (new,), zipfile.ZipFile(new, "w", zipfile.ZIP_DEFLATED) as out:
        out.writestr(SUBMISSION, json.dumps(asdict(submission), indent=1))
        for name, file in members.items():
            out.write(file, name)


def unpack(path: Path, folder: Path) -> Submission:
    """Check a bundle and write its members into an empty folder.

    Raises:
        ValueError: no bundle, or one whose members are not what it says.
        OSError: no such file, or a folder that cannot be written.
    """
    with opened(path, MOST_SIZE) as stream:
        try:
            with zipfile.ZipFile(stream) as archive:
                return _unpacked(archive, folder)
        except _BROKEN as error:
            raise ValueError(f"{path}: not a readable bundle of sins-env ({_line(error)})") from error
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error


def _unpacked(archive: zipfile.ZipFile, folder: Path) -> Submission:
    infos = {one.filename: one for one in archive.infolist()}
    if len(infos) < len(archive.infolist()):
        raise ValueError("two members of one name; allowed: each once")
    if SUBMISSION not in infos:
        raise ValueError(f"it has no {SUBMISSION}, so it is no bundle of sins-env submit")
    _check_names([name for name in infos if name != SUBMISSION])
    whole = sum(one.file_size for one in infos.values())
    if whole > MOST_SIZE:
        raise ValueError(f"it inflates to {size(whole)}; allowed: at most {size(MOST_SIZE)}")
    said = infos.pop(SUBMISSION)
    if said.file_size > MOST_BYTES:
        raise ValueError(f"{SUBMISSION} has {size(said.file_size)}; allowed: at most {size(MOST_BYTES)}")
    claim = _inflated(archive, said)
    submission = _submission_of(claim)
    (folder / SUBMISSION).write_bytes(claim)
    if set(submission.files) != set(infos):
        odd = sorted(set(submission.files) ^ set(infos))
        raise ValueError(f"{SUBMISSION} and the members differ in {', '.join(map(visible, odd[:3]))}")
    for name, info in infos.items():
        data = _inflated(archive, info)
        if sha256(data) != submission.files[name]:
            raise ValueError(f"{name} has the SHA-256 {sha256(data)}, but {SUBMISSION} says {submission.files[name]}")
        target = folder / PurePosixPath(name)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
    return submission


def _inflated(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    """Return a member, of which no more is inflated than it declares."""
    parts, left = [], info.file_size
    with archive.open(info) as stream:
        while left > 0 and (block := stream.read(min(left, BLOCK))):
            parts.append(block)
            left -= len(block)
        if left or stream.read(1):
            raise ValueError(f"{info.filename} has another size than it declares")
    return b"".join(parts)


def _check_names(names: list[str]) -> None:
    if len(names) > MOST_FILES:
        raise ValueError(f"{len(names)} files; allowed: at most {MOST_FILES} in a bundle")
    for name in names:
        if not _MEMBER.fullmatch(name):
            raise ValueError(
                f"a file {visible(name[:100])!r}; allowed in a bundle: {SUBMISSION}, {RESULTS}, {BOARD} and "
                f"Python files below {SOURCES}/, whose names are letters, digits and underscores"
            )
    for name in (RESULTS, BOARD):
        if name not in names:
            raise ValueError(f"it has no {name}")


#: Check of a field in JSON, by its annotation.
_KINDS: dict[str, Any] = {
    "int": lambda value: type(value) is int and value >= 0,
    "str": lambda value: isinstance(value, str) and len(value) <= 500,
    "list[Any]": lambda value: isinstance(value, list),
    "dict[str, Any]": lambda value: isinstance(value, dict),
    "dict[str, str]": lambda value: isinstance(value, dict) and all(map(_KINDS["str"], value.values())),
    "dict[str, int]": lambda value: isinstance(value, dict) and all(map(_KINDS["int"], value.values())),
}


def _submission_of(data: bytes) -> Submission:
    try:
        given = parse_json(data.decode())
    except ValueError as error:
        raise ValueError(f"{SUBMISSION} is no JSON that can be read ({_line(error)})") from None
    if not isinstance(given, dict) or given.get("format") != FORMAT:
        raise ValueError(f"{SUBMISSION} is of no format that this version reads; allowed: {FORMAT}")
    wanted = {one.name: str(one.type) for one in fields(Submission)}
    wrong = [name for name, kind in wanted.items() if name not in given or not _KINDS[kind](given[name])]
    wrong += [visible(name[:100]) for name in given if name not in wanted]
    if wrong:
        raise ValueError(f"{SUBMISSION}: {wrong[0]} is missing, unknown or of another kind")
    return Submission(**given)


def _line(error: BaseException) -> str:
    return visible(" ".join(str(error).split())[:200]) or type(error).__name__


def keep(folder: Path, out: Path) -> None:
    """Move the members of a bundle from their folder to ``out``, which must be new: all of them, or none.

    The sources stand in ``out`` itself, so that ``--solver module:Factory`` finds them there.

    Raises:
        ValueError: there is something of that name.
        OSError: a folder that cannot be written.
    """
    if out.exists():
        raise ValueError(f"{out} exists; allowed: a new folder")
    with tempfile.TemporaryDirectory(dir=out.resolve().parent, prefix=f".{out.name}.") as place:
        new = Path(place) / out.name
        new.mkdir()
        for one in [*(folder / SOURCES).glob("*"), *folder.glob("*.*")]:
            shutil.move(one, new / one.name)
        new.rename(out)
