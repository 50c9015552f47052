"""Solvers that installed packages offer by entry points of the group ``sins_env.estimators``.

An entry point is a class or function, a mapping, or a module, so it may offer any number of solvers. A class or function is
one solver with the name of the entry point. A mapping has solvers by name. A module offers the names that its function
``names()`` lists, which are its attributes, and the solvers that its package registers with ``solvers.register``.

The entry point of this project is loaded here. Each other package is loaded in a process of its own. If it fails, hangs or
ends its process, only its own names are missing.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from types import ModuleType
from typing import Any, NamedTuple

from sins_env.evaluation.estimators.about import About, about

GROUP = "sins_env.estimators"
OWN = "sins-env"  #: name of this distribution, whose solver names no other package can take
LIMIT_S = 30.0  #: longest time in which a package is imported and its solvers are listed
EntryPoint = importlib.metadata.EntryPoint
Offered = Mapping[str, Callable[[], Any]]  #: functions that return a factory, by name of the solver

#: Program of the other process. It reads the path and the entry points from standard input, and prints a line for each.
_CHILD = """
import json, sys
given = json.load(sys.stdin)
sys.path[:] = given["path"]
from sins_env.evaluation.estimators import offers
offers.answer(given["points"])
"""


class Offer(NamedTuple):
    """Solver of another package, or with an ``error`` an entry point that cannot be loaded."""

    name: str
    point: EntryPoint
    about: About
    error: str = ""


def origin(point: EntryPoint) -> str:
    """Return the package of an entry point and its value, in words."""
    return f"{point.dist.name} ({point.value})" if point.dist else point.value


def distribution(point: EntryPoint) -> str:
    """Return name and version of the package of an entry point; empty if there is none."""
    return f"{point.dist.name} {point.dist.version}" if point.dist else ""


def points() -> tuple[list[EntryPoint], list[EntryPoint]]:
    """Return the entry points of this project, and those of other packages, with each value of a name once."""
    own: dict[tuple[str, str], EntryPoint] = {}
    others: dict[tuple[str, str], EntryPoint] = {}
    whose: dict[int, bool] = {}  # a package's name is parsed anew whenever it is asked for: once for all its points
    for point in importlib.metadata.entry_points(group=GROUP):
        key = id(point.dist)
        if key not in whose:
            whose[key] = point.dist is not None and re.sub(r"[-_.]+", "-", point.dist.name).lower() == OWN
        (own if whose[key] else others).setdefault((point.name, point.value), point)
    return list(own.values()), list(others.values())


def package_of(point: EntryPoint) -> str:
    """Return the top-level package or module of an entry point; empty if it is misspelt."""
    return point.value.partition(":")[0].strip().partition(".")[0]


def own() -> dict[str, Callable[[], Any]]:
    """Return the solvers of this project, by name."""
    found: dict[str, Callable[[], Any]] = {}
    for point in points()[0]:
        found |= _taken(point, point.load())
    return found


def load(point: EntryPoint) -> Offered:
    """Import an entry point and return the solvers that it offers, by name.

    Raises:
        Exception, SystemExit: any exception of the import.
        ValueError: a module that offers no solver.
    """
    found = {**_taken(point, point.load()), **registered(package_of(point))}
    if not found:
        allowed = "a class or function, a mapping of them, or a module with names() or with classes that it registers"
        raise ValueError(f"it is a module that offers no solver; allowed: {allowed}")
    return found


def _taken(point: EntryPoint, loaded: Any) -> dict[str, Callable[[], Any]]:
    if isinstance(loaded, Mapping):
        return {name: partial(loaded.__getitem__, name) for name in loaded}
    if isinstance(loaded, ModuleType):
        names: Iterable[str] = loaded.names() if hasattr(loaded, "names") else ()
        return {name: partial(getattr, loaded, name) for name in names}
    return {point.name: lambda: loaded}


def registered(package: str) -> dict[str, Callable[[], Any]]:
    """Return the solvers that an imported package or module has registered with ``solvers.register``, by name."""
    found: dict[str, Callable[[], Any]] = {}
    for point in points()[0]:
        if package_of(point) in sys.modules and isinstance(catalogue := point.load(), ModuleType):
            found |= {name: partial(getattr, catalogue, name) for name in catalogue.names(package)}
    return found


def foreign() -> list[Offer]:
    """Return the solvers that other packages offer; the packages are not imported here."""
    packages: dict[str, list[EntryPoint]] = {}
    for point in points()[1]:
        packages.setdefault(point.dist.name if point.dist else "", []).append(point)
    if not packages:
        return []
    with ThreadPoolExecutor(len(packages)) as pool:
        answers = pool.map(lambda part: asked(tuple((point.name, point.value) for point in part)), packages.values())
        parts = zip(packages.values(), answers, strict=True)
        return [offer for points, answer in parts for offer in _offers(points, answer)]


def _offers(points: Sequence[EntryPoint], answer: Sequence[Any]) -> Iterable[Offer]:
    for point, found in zip(points, answer, strict=True):
        for name, said in found.items() if isinstance(found, dict) else [(point.name, found)]:
            refused = isinstance(said, str)
            yield Offer(name, point, About("", {}) if refused else About(*said), said if refused else "")


@lru_cache
def asked(points: tuple[tuple[str, str], ...]) -> list[Any]:
    """Describe the solvers of a package in another process.

    Returns:
        for each entry point (name, value) a mapping from the name of a solver to its description. A text instead of a
        mapping or a description is the reason why it cannot be loaded.
    """
    given = json.dumps({"path": sys.path, "points": points}).encode()
    try:
        done = subprocess.run(
            [sys.executable, "-c", _CHILD],
            input=given, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=LIMIT_S,
        )  # fmt: skip
        said, end = done.stdout, f"importing it ended the process (exit code {done.returncode})"
    except subprocess.TimeoutExpired as error:
        said, end = error.stdout or b"", f"importing it took longer than {LIMIT_S:g} s"
    answers = [json.loads(line) for line in said.splitlines(keepends=True) if line.endswith(b"\n")]
    if len(answers) < len(points):
        after = f"not looked at: {points[len(answers)][0]}: {end}"
        answers += [end, *[after] * (len(points) - len(answers) - 1)]
    return answers


def answer(points: Sequence[Sequence[str]]) -> None:
    """Print, in the other process, a line of JSON for each entry point, as :func:`asked` returns them."""
    out = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what the packages print is nobody's concern
    for name, value in points:
        print(json.dumps(_answer(EntryPoint(name, value, GROUP))), file=out, flush=True)


def _answer(point: EntryPoint) -> Any:
    try:
        return {name: _said(name, get) for name, get in load(point).items()}
    except (Exception, SystemExit) as error:
        return line(error)


def _said(name: str, get: Callable[[], Any]) -> About | str:
    try:
        return about(called(get(), name))
    except (Exception, SystemExit) as error:
        return line(error)


def line(error: BaseException) -> str:
    """Return an exception in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def called(factory: Any, name: str) -> Any:
    """Return the factory, after checking that it can be called.

    Raises:
        ValueError: not a class or function.
    """
    if not callable(factory):
        kind = type(factory).__name__
        an = "an" if kind[0] in "aeiou" else "a"
        raise ValueError(f"solver {name!r} is {an} {kind}; allowed: a class or function")
    return factory
