"""Conversion of command-line words to values, with one clear error for a word that does not fit."""

from __future__ import annotations

import argparse
import difflib
import getpass
import json
import math
import sys
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NoReturn

from sins_env.reading.documents import MOST_DIGITS, parse_json

SEEDS = "allowed: a whole number that is not negative"


MOST_WORD, MOST_WORDS = 100, 10  #: most characters of a word, and words, that an error repeats


def cut(word: str) -> str:
    """Return a word for an error; what is longer than ``MOST_WORD`` characters is cut."""
    return word if len(word) <= MOST_WORD else f"{word[:MOST_WORD]}..."


class WrongUse(Exception):
    """Error of a command that is used wrongly, in one line."""


class Parser(argparse.ArgumentParser):
    """Parser whose errors are :class:`WrongUse` and point to the help of the verb that was typed."""

    verbs: Mapping[str, argparse.ArgumentParser] = MappingProxyType({})

    def error(self, message: str) -> NoReturn:
        """Raise :class:`WrongUse` instead of ending the process."""
        raise WrongUse(f"{' '.join(map(cut, message.split(' ')))} (see {self.prog} --help)")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Refuse unknown options in the parser of the verb; argparse would leave them to the parser of all verbs."""
        known, unknown = super().parse_known_args(args, namespace)
        if unknown:
            options = [name for action in self._actions for name in action.option_strings]
            near = difflib.get_close_matches(cut(unknown[0].partition("=")[0]), options, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            words = [cut(word) for word in unknown[:MOST_WORDS]] + ["..."] * (len(unknown) > MOST_WORDS)
            self.error(f"unrecognized arguments: {' '.join(words)}{hint}")
        return known, unknown


def setting(text: str) -> tuple[str, Any]:
    """Return the name and the value of NAME=VALUE; a value that is not JSON is text."""
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{cut(text)!r}; allowed: NAME=VALUE")
    try:
        return name, parse_json(value)
    except json.JSONDecodeError:
        return name, value
    except ValueError as error:  # JSON beyond the limits
        raise argparse.ArgumentTypeError(f"{cut(text)!r}: {error}") from None


def settings(text: str) -> tuple[str, list[Any]]:
    """Return the name and the values of NAME=VALUE,VALUE,...; values that are no JSON are words."""
    name, equals, values = text.partition("=")
    if not (name and equals and values):
        raise argparse.ArgumentTypeError(f"{cut(text)!r}; allowed: NAME=VALUE,VALUE, such as gps.rate_hz=1,5,10")
    try:
        return name, list(parse_json(f"[{values}]"))
    except json.JSONDecodeError:
        return name, [setting(f"{name}={value}")[1] for value in values.split(",")]
    except ValueError as error:  # JSON beyond the limits
        raise argparse.ArgumentTypeError(f"{cut(text)!r}: {error}") from None


def count(text: str) -> int:
    """Return a whole number of at least 1."""
    return _whole(text, 1, "a whole number, at least 1")


def number(text: str) -> int:
    """Return a whole number that is not negative."""
    return _whole(text, 0, "a whole number that is not negative")


def _whole(text: str, least: int, allowed: str) -> int:
    if not text.isdecimal() or len(text) > MOST_DIGITS or int(text) < least:
        raise argparse.ArgumentTypeError(f"{cut(text)!r}; allowed: {allowed}")
    return int(text)


def seed(text: str) -> int:
    """Return a seed; '-' reads it from standard input, which keeps a secret out of the shell history.

    No other process of the user can read the memory of this one from then on. Errors do not repeat the text.
    """
    from sins_env.evaluation.estimators.processes import keep_secrets  # a start without a seed does not need it

    keep_secrets()
    if text == "-":
        text = (getpass.getpass("suite seed: ") if sys.stdin.isatty() else sys.stdin.readline()).strip()
    if not text.isdecimal() or len(text) > MOST_DIGITS:
        raise argparse.ArgumentTypeError(
            f"{SEEDS}, of at most {MOST_DIGITS} digits, or - to read it from standard input"
        )
    return int(text)


def executor(text: str) -> str:
    """Return the name of an executor, or the address of a Dask scheduler."""
    from sins_env.evaluation.play.executors import check_executor  # a start without one does not need it

    try:
        check_executor(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def positive(text: str) -> float:
    """Return a positive, finite number."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not (value > 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"{cut(text)!r}; allowed: a positive number")
    return value


def moment(text: str) -> float | str:
    """Return a number of seconds, or the text of a moment: +SECONDS, or a date."""
    try:
        value = float(text)
    except ValueError:
        return text
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{cut(text)!r}; allowed: seconds, +SECONDS or a date")
    return text if text.startswith("+") else value


def several(parser: argparse.ArgumentParser, *flags: str, **settings: Any) -> None:
    """Add an option that takes one or more names and may be repeated."""
    parser.add_argument(*flags, nargs="+", action="extend", default=[], metavar="NAME", **settings)
