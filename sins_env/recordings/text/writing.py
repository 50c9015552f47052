"""Writing of tables of numbers: rows of one format, and several files that appear together with their mapping."""

from __future__ import annotations

import json
from pathlib import Path
from typing import IO, Any

from sins_env.arrays import Array
from sins_env.writing.files import replacing

_CHUNK = 20_000  #: rows that are formatted at once


def write_rows(stream: IO[str], row: str, rows: Array) -> None:
    """Write every row with the same %-format; %r is the shortest text that reads back to the same bits."""
    for first in range(0, len(rows), _CHUNK):
        part = rows[first : first + _CHUNK]
        stream.write(row * len(part) % tuple(part.ravel().tolist()))


def write_files(files: list[tuple[Path, str, Array]], mapping_path: Path, mapping: dict[str, Any]) -> list[Path]:
    """Write tables of (path, format of a row, rows) and their mapping, all of them or none. Returns the paths.

    Raises:
        OSError: files that cannot be written.
    """
    paths = [*(path for path, _, _ in files), mapping_path]
    with replacing(paths) as new:
        for target, (_, row, rows) in zip(new[:-1], files, strict=True):
            with target.open("w", encoding="ascii", newline="\n") as stream:
                head, newline, body = row.rpartition("\n")
                stream.write(head + newline)
                write_rows(stream, body + "\n", rows)
        new[-1].write_text(json.dumps(mapping, indent=2) + "\n", encoding="ascii")
    return paths
