"""Opening files of others: regular files of a bounded size, and text whose lines are bounded as well."""

from __future__ import annotations

import codecs
import gzip
import io
import os
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any, BinaryIO

MOST_BYTES = 8 << 30  #: largest file of a recording
MOST_LINE = 1 << 20  #: bytes within which a text file must have an end of line
#: Bytes to which an archive may expand: this many times its own size, and these at least. Counts of a sensor at rest
#: compress to a tenth.
MOST_RATIO, FREE_BYTES = 200, 64 << 20
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
_GZIP, _ZIP, _HDF5 = b"\x1f\x8b", b"PK\x03\x04", b"\x89HDF"
#: Byte order marks of other texts than UTF-8, with their encodings.
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
#: What the first bytes of a file tell, if it is not the text that its name promises.
_OTHER = {
    **dict.fromkeys(_MARKS, "UTF-16"),
    _GZIP: "compressed by gzip",
    _ZIP: "a ZIP archive",
    _HDF5: "HDF5",
}
TEXT = "UTF-8 text, or UTF-16 with a byte order mark"  #: the encodings of tables
#: What is told how far a text file has been read; the work is deep below those who show it.
_FOLLOWING: ContextVar[Callable[[float], None] | None] = ContextVar("following", default=None)


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


def text_blocks(path: Path, told: bool = True) -> Iterator[list[str]]:
    """Yield the lines of a text file in blocks of about a megabyte, without their ends.

    The text is UTF-8, or UTF-16 with a byte order mark, and may be compressed by gzip or alone in a ZIP archive. Bytes that
    are no text become U+FFFD. ``following`` is told how far the file is read, unless ``told`` is False.

    Raises:
        ValueError: no regular file, a NUL byte, a line of a megabyte, or a damaged or too large archive; the line is named.
        OSError: no such file, or one that cannot be read.
    """
    with opened(path) as stream:
        whole = max(os.fstat(stream.fileno()).st_size, 1)
        follow = _FOLLOWING.get() if told else None
        decoder, rest, before, expanded = None, "", 0, 0
        for block in _unpacked_blocks(path, stream):
            expanded += len(block)
            if expanded > MOST_RATIO * whole + FREE_BYTES:
                most = size(MOST_RATIO * whole + FREE_BYTES)
                raise ValueError(f"{path}: expands to more than {most}; allowed: at most that for a file of this size")
            if decoder is None:
                encoding = next((name for mark, name in _MARKS.items() if block.startswith(mark)), "utf-8-sig")
                decoder = io.IncrementalNewlineDecoder(
                    codecs.getincrementaldecoder(encoding)("replace"), translate=True
                )
            text = decoder.decode(block)
            if "\0" in text:
                at = before + text.count("\n", 0, text.index("\0"))
                raise ValueError(f"{path}: a NUL byte in line {at + 1}; allowed: {TEXT}")
            *lines, rest = (rest + text).split("\n")
            before += len(lines)
            if len(rest) >= MOST_LINE:
                raise ValueError(
                    f"{path}: line {before + 1} has more than {size(MOST_LINE)}; allowed: a table, a row in each line"
                )
            if follow is not None:
                follow(min(stream.tell() / whole, 1.0))
            if lines:
                yield lines
        rest += decoder.decode(b"", final=True) if decoder is not None else ""
        if rest:
            yield rest.removesuffix("\n").split("\n")


def _unpacked_blocks(path: Path, stream: BinaryIO) -> Iterator[bytes]:
    """Yield the content of a file in blocks, expanded if it is compressed."""
    head = stream.read(4)
    stream.seek(0)
    try:
        inner: Any = stream
        if head.startswith(_GZIP):
            inner = gzip.GzipFile(fileobj=stream)
        elif head == _ZIP:
            packed = zipfile.ZipFile(stream)
            members = [one for one in packed.infolist()[:1000] if not one.is_dir()]
            if len(members) != 1:
                raise ValueError(
                    f"{path}: a ZIP archive of {len(members)} files; allowed: of one, or its files unpacked"
                )
            inner = packed.open(members[0])
        elif head == _HDF5:
            raise ValueError(f"{path}: HDF5; allowed: {TEXT}")
        while block := inner.read(MOST_LINE):
            yield block
    except (EOFError, RuntimeError, NotImplementedError, zlib.error, zipfile.BadZipFile, gzip.BadGzipFile) as error:
        raise ValueError(f"{path}: a damaged archive ({' '.join(str(error).split())[:200]})") from None


@contextmanager
def following(follow: Callable[[float], None]) -> Iterator[None]:
    """Call ``follow`` with the share of a text file, 0 to 1, that has been read, for each block read inside."""
    token = _FOLLOWING.set(follow)
    try:
        yield
    finally:
        _FOLLOWING.reset(token)
