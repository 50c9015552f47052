"""Conversion of command-line words into values, with one clear error for each that does not fit."""

from __future__ import annotations

import argparse
import getpass
import json
import math
import sys
from typing import Any, NoReturn

SEEDS = "allowed: a whole number that is not negative"


class WrongUse(Exception):
    """Wrong use, in one line."""


class Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise WrongUse(f"{message} (see {self.prog} --help)")


def setting(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: NAME=VALUE")
    try:
        return name, json.loads(value)
    except json.JSONDecodeError:
        return name, value


def count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: a whole number, at least 1")
    return int(text)


def number(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: a whole number that is not negative")
    return int(text)


def seed(text: str) -> int:
    """'-' is read from standard input, so that a secret is in no shell history; errors do not repeat it."""
    if text == "-":
        text = (getpass.getpass("suite seed: ") if sys.stdin.isatty() else sys.stdin.readline()).strip()
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{SEEDS}, or - to read it from standard input")
    return int(text)


def positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not (value > 0 and math.isfinite(value)):
        raise argparse.ArgumentTypeError(f"{text!r}; allowed: a positive number")
    return value


def several(parser: argparse.ArgumentParser, *flags: str, **settings: Any) -> None:
    parser.add_argument(*flags, nargs="+", action="extend", default=[], metavar="NAME", **settings)
