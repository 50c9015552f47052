"""MATLAB files of others, read by SciPy in a process of its own: a damaged file ends that process, and no more.

The child has limits of memory and of time that grow with the file. It passes back plain arrays, without pickle.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.reading import matlab_child
from sins_env.reading.files import opened

MOST_FILE = 2 << 30  #: largest file
BASE_MEMORY, MEMORY_PER_BYTE = 2 << 30, 64  #: memory of the child, bytes, and what each byte of the file adds
#: CPU time of the child, s, and what each megabyte of the file adds; by the clock ten times that.
BASE_S, S_PER_MB = 20, 1


MOST_NAMES = 30  #: most names of variables that an error lists


def read_matlab(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Read the variables of a ``.mat`` file, and those of a struct of one element called ``trj``.

    Returns arrays of numbers or text by name, and descriptions of the other variables, such as "object of shape (1, 1)".
    The fields of a struct ``s`` of one element are ``s.field``. The last file is kept, for several formats may ask for it.

    Raises:
        ValueError: MATLAB 7.3, a damaged file, or one that needs more memory or time than it may.
        OSError: no such file, or one that cannot be read.
    """
    found = path.stat()
    return _read(path, (found.st_mtime_ns, found.st_size))


@lru_cache(maxsize=1)
def _read(path: Path, stamp: tuple[int, int]) -> tuple[dict[str, Any], dict[str, str]]:
    with opened(path, MOST_FILE) as stream:
        size = os.fstat(stream.fileno()).st_size
        seconds = BASE_S + S_PER_MB * (size >> 20)
        command = [sys.executable, "-P", matlab_child.__file__, str(BASE_MEMORY + MEMORY_PER_BYTE * size), str(seconds)]
        try:
            done = subprocess.run(
                command,
                stdin=stream,
                capture_output=True,
                timeout=10 * seconds,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        except subprocess.TimeoutExpired:
            raise ValueError(f"{path}: not read within {10 * seconds} s; allowed: a sound .mat file") from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        if done.returncode == 1 and said and said[-1].startswith("MATLAB 7.3"):
            raise ValueError(f"{path}: {said[-1]}")
        why = said[-1][:300] if done.returncode == 1 and said else f"it ended its reader with code {done.returncode}"
        raise ValueError(f"{path}: not a readable .mat file, or a damaged one ({why})")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as found:
        arrays = {name: found[name] for name in found.files if name != matlab_child.OTHERS}
        return arrays, json.loads(str(found[matlab_child.OTHERS]))


@dataclass(frozen=True)
class MatFile:
    """The variables of a file, each checked on demand."""

    path: Path
    arrays: dict[str, Any]
    others: dict[str, str]  #: descriptions of the variables that are no arrays of numbers or text

    def __contains__(self, name: str) -> bool:
        return name in self.arrays or name in self.others

    def _numbers(self, name: str, allowed: str, fits: Callable[[Array], bool]) -> Array:
        if name not in self:
            raise ValueError(f"{self.path}: no variable {name!r}; variables there: {self._there()}")
        raw = self.arrays.get(name)
        if raw is None or raw.dtype.kind not in "iuf" or not fits(raw):
            what = self.others[name] if raw is None else f"{raw.dtype} of shape {raw.shape}"
            raise ValueError(f"{self.path}: {name} is {what}; allowed: {allowed}")
        values = raw.astype(np.float64)
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            place = ", ".join(f"{axis} {i + 1}" for axis, i in zip(("row", "column"), bad[0], strict=False))
            raise ValueError(f"{self.path}: {name} is not finite at {place}")
        return values

    def _there(self) -> str:
        names = [name for name in (*self.arrays, *self.others) if "." not in name]
        more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
        return f"{', '.join(names[:MOST_NAMES])}{more}" or "none"

    def matrix(self, name: str, columns: tuple[int, ...]) -> Array:
        """Return a matrix (n, columns) of at least one row."""
        allowed = f"numbers, (n, {' or '.join(map(str, columns))})"
        return self._numbers(name, allowed, lambda a: a.ndim == 2 and a.shape[1] in columns and len(a) > 0)

    def vector(self, name: str, count: int) -> Array:
        """Return the first ``count`` numbers of a variable, (count,)."""
        return self._numbers(name, f"{count} finite numbers", lambda a: a.size >= count).ravel()[:count]

    def column(self, name: str) -> Array:
        """Return a variable of one column or row, (n,).

        Raises:
            ValueError: another form.
        """
        return self._numbers(
            name, "finite numbers in one column", lambda a: a.size == max(a.shape, default=0) > 0
        ).ravel()
