"""NPZ archives of others: their arrays one by one, each with its declared size checked before it is read."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sins_env.reading.files import FREE_BYTES, MOST_RATIO, opened, size

MOST_MEMBERS = 1000  #: most arrays of an archive
_BROKEN = (OSError, EOFError, ValueError, KeyError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error)


class Archive:
    """The arrays of an NPZ file. Only those that are asked for are read."""

    def __init__(self, path: Path, stream: BinaryIO) -> None:
        self.path = path
        try:
            self._zip = zipfile.ZipFile(stream)
            members = self._zip.infolist()
            most = MOST_RATIO * stream.seek(0, 2) + FREE_BYTES
        except _BROKEN as error:
            raise self._broken(error) from error
        if len(members) > MOST_MEMBERS:
            raise ValueError(f"{path}: {len(members)} arrays; allowed: at most {MOST_MEMBERS}")
        whole = sum(member.file_size for member in members)
        if whole > most:
            raise ValueError(f"{path}: expands to {size(whole)}; allowed: at most {size(most)} for a file of this size")
        self._members = {member.filename.removesuffix(".npy"): member for member in members}

    def keys(self) -> list[str]:
        """Return the names of the arrays."""
        return list(self._members)

    def read(self, key: str) -> np.ndarray[Any, np.dtype[Any]]:
        """Return an array. Objects, which could run code when read, are refused.

        Raises:
            ValueError: a damaged array, or one of another size than the archive declares.
        """
        member = self._members[key]
        try:
            with self._zip.open(member) as stream:
                version = np.lib.format.read_magic(stream)
                reader = (
                    np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                )
                shape, _, dtype = reader(stream)
                declared, there = math.prod(shape) * dtype.itemsize, member.file_size - stream.tell()
                if dtype.hasobject:
                    raise ValueError(f"{key} holds Python objects; allowed: numbers and text")
                if declared != there:
                    raise ValueError(f"{key} of shape {shape} needs {declared} bytes, and {there} are there")
            with self._zip.open(member) as stream:
                return np.asarray(np.lib.format.read_array(stream, allow_pickle=False))
        except Exception as error:  # NumPy reads the header as Python, and damaged bytes provoke anything
            raise self._broken(error) from error

    def _broken(self, error: BaseException) -> ValueError:
        text = " ".join(str(error).split())[:300] or type(error).__name__
        return ValueError(f"{self.path}: not a readable NPZ archive, or a truncated one ({text})")


@contextmanager
def archive(path: Path) -> Iterator[Archive]:
    """Open an NPZ file.

    Raises:
        ValueError: no NPZ file, too many arrays, or one that expands beyond all measure.
        OSError: no such file, or one that cannot be read.
    """
    with opened(path) as stream:
        yield Archive(path, stream)
