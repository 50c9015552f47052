"""Checks of what users type on a command line, in JSON or in code.

Each check returns the value in plain Python types, or raises one ValueError. The error has the name of the setting, what
was given and what is allowed. ``find`` is the check of a name that a class in a folder of files has.
"""

from __future__ import annotations

import difflib
import importlib
import math
import pkgutil
import reprlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from itertools import islice
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")

MOST_NAME, MOST_NAMES = 60, 100  #: most characters of a name, and names, that an error lists
MOST_NUMBERS = 10_000  #: most numbers of a list
MOST_WHOLE = 1e15  #: largest whole number, which fits into 64 bits and into a float
LARGEST = 1e100  #: largest finite number that any setting may be; its square and its cube are finite
MOST_SHOWN = 200  #: most characters of an error that repeat what was given


def unknown(kind: str, given: object, allowed: Iterable[str], near: str | None = None) -> ValueError:
    """Return the error for a name that does not exist, such as "unknown task 'sway-whit-v0'; did you mean ...?".

    The nearest name is found among those that are listed, unless the caller knows a better one.
    """
    names = sorted(allowed)
    close = [near] if near else difflib.get_close_matches(shown(given).strip("'"), names, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]!r}? Allowed" if close else "allowed"
    return ValueError(f"unknown {kind} {shown(given)}; {hint}: {_listed(names)}")


def _listed(names: list[str]) -> str:
    """Join names; those of strangers may be long and many."""
    short = [name if len(name) <= MOST_NAME else f"{name[: MOST_NAME - 3]}..." for name in names[:MOST_NAMES]]
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(short) + more


def shown(given: object) -> str:
    """Write what was given in at most 200 characters of one line, whatever it is."""
    try:
        text = _SHORT.repr(given)
    except Exception:  # the repr of others may do anything, and Python refuses to write huge whole numbers
        text = f"a {type(given).__name__} that cannot be written"
    text = " ".join(text.split())
    return text if len(text) <= MOST_SHOWN else f"{text[: MOST_SHOWN - 4]} ..."


class _Short(reprlib.Repr):
    """The repr of large values, without writing all of them first."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 4
        self.maxstring = self.maxother = self.maxlong = MOST_SHOWN
        self.maxlist = self.maxtuple = self.maxdict = self.maxset = self.maxfrozenset = self.maxarray = 20

    def repr_int(self, x: int, level: int) -> str:
        return f"a whole number of about {int(x.bit_length() * 0.30103)} digits" if x.bit_length() > 600 else repr(x)

    def repr_dict(self, x: dict[Any, Any], level: int) -> str:
        """Write a dict in its own order, as ``repr`` does; the base class sorts it."""
        if level <= 0 and x:
            return "{...}"
        parts = [f"{self.repr1(k, level - 1)}: {self.repr1(v, level - 1)}" for k, v in islice(x.items(), self.maxdict)]
        return f"{{{', '.join(parts)}{', ...' if len(x) > self.maxdict else ''}}}"


_SHORT = _Short()


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
    return ValueError(f"{name} = {shown(given)}; allowed: {allowed}")


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

    A number beyond ``LARGEST`` is refused whatever the limits are.

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
    if abs(value) > LARGEST:
        raise refused(
            name, given, f"{allowed or _within(least, above, most, below, infinite)}, at most {LARGEST:g} in size"
        )
    return value


def _within(least: float, above: float, most: float, below: float, infinite: bool) -> str:
    """Write limits in words, such as 'a number > 0 and <= 1'."""
    signs = {">=": least, ">": above, "<=": most, "<": below}
    bounds = " and ".join(f"{sign} {limit:g}" for sign, limit in signs.items() if math.isfinite(limit))
    noun = "a number" if infinite or min(most, below) < math.inf else "a finite number"
    return f"{noun} {bounds}".rstrip() + (", or inf" if infinite else "")


def whole(name: str, given: Any, allowed: str | None = None, *, least: int, most: float = MOST_WHOLE) -> int:
    """Check a whole number; ``30.0`` is one, too.

    Raises:
        ValueError: a number with a fraction, one below ``least`` or above ``most``, or no number.
    """
    allowed = allowed or f"a whole number >= {least}{f' and <= {most:g}' if most < MOST_WHOLE else ''}"
    value = number(name, given, allowed, least=least, most=most)
    if value % 1:
        raise refused(name, given, allowed)
    return int(value)


def numbers(
    name: str,
    given: Any,
    count: int | None,
    allowed: str,
    *,
    least: float = -math.inf,
    above: float = -math.inf,
    most: float = math.inf,
) -> tuple[float, ...]:
    """Check a list, tuple or array of ``count`` finite numbers; None takes any number of them from 1 to ``MOST_NUMBERS``.

    Raises:
        ValueError: another count, a number out of range, or anything else.
    """
    values = items(given)
    if not values or len(values) != (count or min(len(values), MOST_NUMBERS)):
        raise refused(name, given, allowed)
    try:
        return tuple(number(name, value, least=least, above=above, most=most) for value in values)
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


#: Classes by name, of each folder and base that was asked for.
_found: dict[tuple[str, type], dict[str, Any]] = {}


def classes(folder: str, base: type[T]) -> dict[str, type[T]]:
    """Return the subclasses of ``base`` in the files of a package, each by its attribute ``name``.

    Raises:
        ImportError: two of one name.
    """
    key = folder, base
    if key not in _found:
        package, named = importlib.import_module(folder), dict[str, Any]()
        for file in pkgutil.iter_modules(package.__path__, f"{folder}."):
            for cls in vars(importlib.import_module(file.name)).values():
                if not isinstance(cls, type) or not issubclass(cls, base) or cls.__module__ != file.name:
                    continue
                name: str | None = getattr(cls, "name", None)
                if name in named:
                    raise ImportError(f"{file.name}: a second {name!r}; allowed: a name of its own")
                if name is not None:
                    named[name] = cls
        _found[key] = named
    return _found[key]


def find(kind: str, name: str, folder: str, base: type[T]) -> type[T]:
    """Return the subclass of that name; ``kind`` says in the error what it is.

    Raises:
        ValueError: an unknown name; the error offers the nearest one.
    """
    known = classes(folder, base)
    if name not in known:
        raise unknown(kind, name, known)
    return known[name]
