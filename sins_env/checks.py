"""Checks of what users type: on a command line, in JSON, in code.

Each returns the value in plain Python types, or raises one ValueError with the setting's name, what was given and
what is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from sins_env.errors import unknown


def refused(name: str, given: object, allowed: str) -> ValueError:
    """The error for a value: 'epoch = -1.0; allowed: a positive number of seconds'."""
    return ValueError(f"{name} = {given!r}; allowed: {allowed}")


def number(
    name: str,
    given: Any,
    allowed: str = "a finite number",
    *,
    least: float = -math.inf,
    above: float = -math.inf,
    most: float = math.inf,
) -> float:
    """A finite number within limits; neither a bool nor a string that looks like a number."""
    if isinstance(given, bool) or not isinstance(given, (int, float, np.integer, np.floating)):
        raise refused(name, given, allowed)
    try:
        value = float(given)
    except OverflowError:  # of a huge int
        value = math.inf
    if not (math.isfinite(value) and least <= value <= most and value > above):
        raise refused(name, given, allowed)
    return value


def whole(name: str, given: Any, allowed: str, *, least: int) -> int:
    """A whole number, ``30.0`` too."""
    value = number(name, given, allowed, least=least)
    if value % 1:
        raise refused(name, given, allowed)
    return int(value)


def numbers(name: str, given: Any, count: int, allowed: str, *, least: float = -math.inf) -> tuple[float, ...]:
    """As many finite numbers in a list, tuple or array."""
    values = items(given)
    if values is None or len(values) != count:
        raise refused(name, given, allowed)
    try:
        return tuple(number(name, value, least=least) for value in values)
    except ValueError:
        raise refused(name, given, allowed) from None


def interval(name: str, given: Any, allowed: str) -> tuple[float, float]:
    """(start, end) with 0 <= start < end."""
    start, end = numbers(name, given, 2, allowed, least=0.0)
    if not start < end:
        raise refused(name, given, allowed)
    return start, end


def items(given: Any) -> list[Any] | None:
    """What a list, a tuple or an array holds; None for anything else."""
    values = given.tolist() if isinstance(given, np.ndarray) else given
    return list(values) if isinstance(values, (list, tuple)) else None


def flag(name: str, given: Any) -> bool:
    """True or False; not what Python would take for them."""
    if not isinstance(given, (bool, np.bool_)):
        raise refused(name, given, "True or False")
    return bool(given)


def choice(kind: str, given: Any, allowed: Iterable[str]) -> str:
    """One of the names; a near miss is offered the nearest."""
    if not isinstance(given, str) or given not in allowed:
        raise unknown(kind, given, allowed)
    return given
