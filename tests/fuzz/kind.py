"""A kind of input: a strategy of examples, and what is done with one."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hypothesis.strategies import SearchStrategy

KINDS: dict[str, "Kind"] = {}
FOLDER = [Path()]  #: folder of this process for the files of examples


@dataclass(frozen=True)
class Kind:
    """A kind of input."""

    name: str
    examples: SearchStrategy[Any]
    go: Callable[[Any], str]  #: plays an example, and returns "refused" or "worked", or raises Failed
    share: float  #: part of all examples, relative to the other kinds
    slice: int  #: number of examples in the tests
    prepare: Callable[[], Any]  #: makes what all examples share


def kind(
    name: str, examples: SearchStrategy[Any], share: float, slice: int, prepare: Callable[[], Any] = lambda: None
) -> Callable[[Any], Any]:
    """Register a function that plays an example."""

    def register(go: Callable[[Any], str]) -> Callable[[Any], str]:
        KINDS[name] = Kind(name, examples, go, share, slice, prepare)
        return go

    return register


def folder() -> Path:
    """Return the folder for the files of examples."""
    if FOLDER[0] == Path():
        FOLDER[0] = Path(tempfile.mkdtemp(prefix="sins-env-fuzz-"))
    return FOLDER[0]


def put(name: str, data: bytes) -> Path:
    """Write a file into the folder, and return its path."""
    path = folder() / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path
