"""A key of a scenario: its name, what it means, what is allowed, and which setting its value becomes."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any

from sins_env import checks

Check = Callable[
    [str, Any], Any
]  #: takes the name of a key and its value, and returns the value or raises a ValueError

#: Endings of names, and the units that they mean.
UNITS = {
    "_deg_sqrt_h": "deg/sqrt(h)", "_deg_h": "deg/h", "_arcsec": "arcsec", "_deg": "deg", "_mps": "m/s", "_hz": "Hz",
    "_per_min": "1/min", "_m": "m", "_s": "s",
}  # fmt: skip
TASK = "task."  #: beginning of the target of a key that becomes a field of the task, and no setting of the environment


@dataclass(frozen=True)
class Key:
    """A key of a scenario.

    ``to`` is the keyword argument of the environment that the value becomes, with dots into a dict, or ``task.FIELD``.
    """

    path: str  #: the name with those of the objects around it, such as "start.coarse_s"
    what: str  #: description in one sentence
    to: str
    check: Check
    words: Mapping[Any, Any] = field(default_factory=lambda: MappingProxyType({}))  #: values that stand for others
    is_file: bool = False  #: whether it is the path of a file, which may be relative to the folder of the scenario

    @property
    def unit(self) -> str:
        """Unit of the value, which is at the end of the name; empty for none."""
        return next((unit for ending, unit in UNITS.items() if self.path.endswith(ending)), "")

    @property
    def allowed(self) -> str:
        """What is allowed, in the words of the check's own error."""
        try:
            self.check("", _NOTHING)
        except ValueError as error:
            text = str(error).partition("llowed: ")[2]
            words = [str(word).lower() if isinstance(word, bool) else str(word) for word in self.words]
            return ", ".join([*words, text]) if words and self.words.keys() - {True, False} else text
        return "anything"

    def value(self, given: Any) -> Any:
        """Return the value of the setting, in types that JSON has.

        Raises:
            ValueError: what is not allowed; the error begins with the name of the key.
        """
        try:
            if isinstance(given, (str, bool)) and given in self.words:
                return self.words[given]
            checked = self.check(self.path, given)
        except (ValueError, FileNotFoundError) as error:
            raise ValueError(self._named(str(error))) from None
        return checked if isinstance(checked, (str, bool, int, float)) else given

    def _named(self, text: str) -> str:
        """Return the text of an error with the name of the key where it has that of a setting, a specification or none."""
        names = {self.to, self.path.rpartition(".")[2]}
        text = re.sub(rf"^(?:{'|'.join(map(re.escape, names))})(?=[. ])", self.path, text).replace("or None", "or null")
        text = re.sub(r"\b(?:Imu|Gps)Spec\.", f"{self.path}.", text)
        text = re.sub(r"\b([A-Z]\w*)Spec\.", lambda found: f"{self.path}.{found[1].lower()}.", text)
        return text if self.path in text else f"{self.path}: {text}"


class _Nothing:
    def __repr__(self) -> str:
        return "nothing"


_NOTHING = _Nothing()  # a value that no check allows


def text(name: str, given: Any) -> str:
    """Check a text of one line, of at most 300 characters."""
    if not isinstance(given, str) or not given.strip() or len(given) > 300 or not given.isprintable():
        raise checks.refused(name, given, "a text of one line, of at most 300 characters")
    return given


def one_of(*names: str) -> Check:
    """Return the check of one of some words."""

    def check(name: str, given: Any) -> str:
        if not isinstance(given, str) or given not in names:
            raise checks.unknown(name, given, names)
        return given

    return check


def nameless(check: Callable[..., Any], *more: Any) -> Check:
    """Return the check of a setting or a specification that is checked by its own code, which knows its name."""
    return lambda name, given: check(given, *more)


def number(**limits: Any) -> Check:
    """Return the check of a number within limits."""
    return partial(checks.number, **limits)


def whole(least: int, most: float = checks.MOST_WHOLE) -> Check:
    """Return the check of a whole number within limits."""
    return partial(checks.whole, least=least, most=most)
