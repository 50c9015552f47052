"""Errors that say what was given, what is allowed, and the nearest valid name."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any, TypeVar

T = TypeVar("T")


def unknown(kind: str, given: object, allowed: Iterable[str]) -> ValueError:
    """The error for a name that does not exist: 'unknown task 'sway-whit-v0'; did you mean ...?'."""
    names = sorted(allowed)
    near = difflib.get_close_matches(str(given), names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? Allowed" if near else "allowed"
    return ValueError(f"unknown {kind} {given!r}; {hint}: {', '.join(names)}")


def build(cls: type[T], settings: Mapping[str, Any], kind: str) -> T:
    """``cls(**settings)`` for a dataclass; a misspelt field is one clear error.

    Raises:
        ValueError: a setting that ``cls`` does not have, or a value it refuses.
    """
    allowed = [f.name for f in fields(cls) if f.init]  # type: ignore[arg-type]
    for name in settings:
        if name not in allowed:
            raise unknown(f"setting of {kind}", name, allowed)
    return cls(**settings)
