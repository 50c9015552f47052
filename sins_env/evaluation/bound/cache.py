"""Cache of arrays that take long to compute, in $XDG_CACHE_HOME/sins_env or ~/.cache/sins_env.

A file appears whole or not at all, so any number of processes may write the same one. Nothing here raises: arrays that
cannot be read are computed again, and arrays that cannot be written are not kept.
"""

from __future__ import annotations

import os
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_DAMAGED = (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError)


def folder() -> Path | None:
    """Return the user's cache directory; None for a user without a home."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    try:
        base = Path(given) if os.path.isabs(given) else Path.home() / ".cache"
    except RuntimeError:
        return None
    return base / "sins_env"


def load(name: str) -> dict[str, NDArray[Any]] | None:
    """Return the arrays kept under that name; None if there are none or the file is damaged."""
    where = folder()
    if where is None:
        return None
    try:
        with open(where / f"{name}.npz", "rb") as file, np.load(file, allow_pickle=False) as found:
            return {key: found[key] for key in found.files}
    except _DAMAGED:
        return None


def save(name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Keep the arrays under that name, if the directory can be written."""
    where = folder()
    if where is None:
        return
    try:
        where.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(dir=where, suffix=".part")
    except OSError:
        return
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, allow_pickle=False, **dict[str, Any](arrays))
        os.replace(part, where / f"{name}.npz")
    except OSError:  # a full disk
        pass
    finally:
        Path(part).unlink(missing_ok=True)
