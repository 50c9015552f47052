"""Opening files of others: regular files of a bounded size, and text whose lines are bounded as well."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

MOST_BYTES = 8 << 30  #: largest file of a recording
MOST_LINE = 1 << 20  #: bytes within which a text file must have an end of line
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
#: What the first bytes of a file tell, if it is not the text that its name promises.
_OTHER = {
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
    b"\x1f\x8b": "compressed by gzip",
    b"PK\x03\x04": "a ZIP archive",
    b"\x89HDF": "HDF5",
}


@contextmanager
def opened(path: Path, most: int = MOST_BYTES) -> Iterator[BinaryIO]:
    """Open a regular file of at most ``most`` bytes for reading. It never waits for the other end of a pipe.

    Raises:
        ValueError: a folder, a pipe, a device or a larger file.
        OSError: no such file, or one that cannot be read.
    """
    with open(path, "rb", opener=_without_waiting) as stream:
        found = os.fstat(stream.fileno())
        kind = _KINDS.get(stat.S_IFMT(found.st_mode))
        if kind:
            raise ValueError(f"{path}: {kind}; allowed: a regular file")
        if found.st_size > most:
            raise ValueError(f"{path}: {size(found.st_size)}; allowed: a file of at most {size(most)}")
        yield stream


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))


def size(count: float) -> str:
    """Write a number of bytes, such as '4 MB'."""
    power = min(max(len(str(int(count))) - 1, 0) // 3, 4)
    return f"{count / 1000**power:.4g} {('bytes', 'kB', 'MB', 'GB', 'TB')[power]}"


def beginning(path: Path, most: int) -> bytes:
    """Return the first ``most`` bytes of a file, or all of a shorter one.

    Raises:
        ValueError: no regular file.
        OSError: no such file, or one that cannot be read.
    """
    with opened(path) as stream:
        return stream.read(most)


def read_text(path: Path, most: int) -> str:
    """Return the text of a UTF-8 file of at most ``most`` bytes, without a byte order mark and with plain ends of lines.

    Raises:
        ValueError: a larger file, one that is no UTF-8, or one that holds NUL bytes.
        OSError: no such file, or one that cannot be read.
    """
    with opened(path, most) as stream:
        data = stream.read(most + 1)  # files of /proc have no size
    if len(data) > most:
        raise ValueError(f"{path}: more than {size(most)}; allowed: a file of at most {size(most)}")
    check_bytes(path, data)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ValueError(f"{path}: line {line} is no UTF-8 text (byte {data[error.start]:#04x})") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def check_bytes(path: Path, data: bytes) -> None:
    """Check the beginning of a text file.

    Raises:
        ValueError: UTF-16, a compressed file, or NUL bytes.
    """
    for mark, what in _OTHER.items():
        if data.startswith(mark):
            raise ValueError(f"{path}: {what}; allowed: UTF-8 text")
    at = data.find(b"\0")
    if at >= 0:
        raise ValueError(f"{path}: a NUL byte in line {data.count(bytes([10]), 0, at) + 1}; allowed: UTF-8 text")


def check_lines(path: Path) -> None:
    """Check that a text file can be read line by line: a regular file without NUL bytes or lines of a megabyte.

    Raises:
        ValueError: another file; the error names the line.
        OSError: no such file, or one that cannot be read.
    """
    with opened(path) as stream:
        before = 0
        while block := stream.read(MOST_LINE):
            if before == 0:
                check_bytes(path, block)
            elif b"\0" in block:
                at = before + block.count(b"\n", 0, block.index(b"\0"))
                raise ValueError(f"{path}: a NUL byte in line {at + 1}; allowed: UTF-8 text")
            ends = block.count(b"\n") or block.count(b"\r")
            if not ends and len(block) == MOST_LINE:
                raise ValueError(
                    f"{path}: line {before + 1} has more than {size(MOST_LINE)}; allowed: a table, a row in each line"
                )
            before += ends
