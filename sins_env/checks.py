"""Checks of what users type on a command line, in JSON or in code.

Each check returns the value in plain Python types, or raises one ValueError. The error has the name of the setting, what
was given and what is allowed.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


def unknown(kind: str, given: object, allowed: Iterable[str]) -> ValueError:
    """Return the error for a name that does not exist, such as "unknown task 'sway-whit-v0'; did you mean ...?"."""
    names = sorted(allowed)
    near = difflib.get_close_matches(str(given), names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? Allowed" if near else "allowed"
    return ValueError(f"unknown {kind} {given!r}; {hint}: {', '.join(names)}")


def build(cls: type[T], settings: Mapping[str, Any], kind: str) -> T:
    """Make a dataclass, ``cls(**settings)``; a misspelt field is one clear error.

    Raises:
        ValueError: a setting that ``cls`` does not have, or a value it refuses.
    """
    allowed = [f.name for f in fields(cls) if f.init]  # type: ignore[arg-type]
    for name in settings:
        if name not in allowed:
            raise unknown(f"setting of {kind}", name, allowed)
    return cls(**settings)


def refused(name: str, given: object, allowed: str) -> ValueError:
    """Return the error for a value, such as 'epoch = -1.0; allowed: a positive number of seconds'."""
    return ValueError(f"{name} = {given!r}; allowed: {allowed}")


def keep(owner: object, name: str, check: Callable[..., Any], *args: Any, **limits: Any) -> None:
    """Check one field of a frozen dataclass, and replace it by what ``check`` returns.

    Call it in ``__post_init__``: ``keep(self, "gate", number, above=0.0, most=1.0)``.

    Raises:
        ValueError: whatever ``check`` refuses.
    """
    object.__setattr__(owner, name, check(name, getattr(owner, name), *args, **limits))


def number(
    name: str,
    given: Any,
    allowed: str | None = None,
    *,
    least: float = -math.inf,
    above: float = -math.inf,
    most: float = math.inf,
    below: float = math.inf,
    infinite: bool = False,
) -> float:
    """Check a number within limits, finite unless ``infinite``; neither a bool nor a string that looks like a number.

    Raises:
        ValueError: anything else; ``allowed`` replaces the text that the limits make.
    """
    value = math.nan
    if isinstance(given, (int, float, np.integer, np.floating)) and not isinstance(given, bool):
        try:
            value = float(given)
        except OverflowError:  # a huge int
            value = math.inf
    if value == math.inf and infinite:
        return value
    if not (math.isfinite(value) and least <= value <= most and above < value < below):
        raise refused(name, given, allowed or _within(least, above, most, below, infinite))
    return value


def _within(least: float, above: float, most: float, below: float, infinite: bool) -> str:
    """Write limits in words, such as 'a number > 0 and <= 1'."""
    signs = {">=": least, ">": above, "<=": most, "<": below}
    bounds = " and ".join(f"{sign} {limit:g}" for sign, limit in signs.items() if math.isfinite(limit))
    noun = "a number" if infinite or min(most, below) < math.inf else "a finite number"
    return f"{noun} {bounds}".rstrip() + (", or inf" if infinite else "")


def whole(name: str, given: Any, allowed: str | None = None, *, least: int) -> int:
    """Check a whole number; ``30.0`` is one, too.

    Raises:
        ValueError: a number with a fraction, one below ``least``, or no number.
    """
    allowed = allowed or f"a whole number >= {least}"
    value = number(name, given, allowed, least=least)
    if value % 1:
        raise refused(name, given, allowed)
    return int(value)


def numbers(
    name: str, given: Any, count: int | None, allowed: str, *, least: float = -math.inf, above: float = -math.inf
) -> tuple[float, ...]:
    """Check a list, tuple or array of ``count`` finite numbers; None takes any number of them but zero.

    Raises:
        ValueError: another count, a number out of range, or anything else.
    """
    values = items(given)
    if not values or len(values) != (count or len(values)):
        raise refused(name, given, allowed)
    try:
        return tuple(number(name, value, least=least, above=above) for value in values)
    except ValueError:
        raise refused(name, given, allowed) from None


def interval(name: str, given: Any, allowed: str) -> tuple[float, float]:
    """Check a pair (start, end) with 0 <= start < end.

    Raises:
        ValueError: anything else.
    """
    start, end = numbers(name, given, 2, allowed, least=0.0)
    if not start < end:
        raise refused(name, given, allowed)
    return start, end


def items(given: Any) -> list[Any] | None:
    """Return the items of a list, a tuple or an array; None for anything else."""
    values = given.tolist() if isinstance(given, np.ndarray) else given
    return list(values) if isinstance(values, (list, tuple)) else None


def flag(name: str, given: Any) -> bool:
    """Check True or False; 0, 1 and None are neither.

    Raises:
        ValueError: anything else.
    """
    if not isinstance(given, (bool, np.bool_)):
        raise refused(name, given, "True or False")
    return bool(given)


def choice(kind: str, given: Any, allowed: Iterable[str]) -> str:
    """Check one of the allowed names.

    Raises:
        ValueError: another name; the error offers the nearest one.
    """
    if not isinstance(given, str) or given not in allowed:
        raise unknown(kind, given, allowed)
    return given
