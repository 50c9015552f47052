"""What installed packages offer: their entry points of the group ``sins_env.estimators``.

An entry point is a class or function, which is one solver under the entry point's name; a mapping of names to such; or a
module. A module offers the names that its function ``names()`` lists, each an attribute of it, and those that its package
registers with ``solvers.register``. So one entry point may offer any number of solvers.

The project's own entry point is loaded here. Those of other packages are loaded in processes of their own, one a package:
a package that fails, hangs or ends its process costs its own names and nothing else.
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
OWN = "sins-env"  #: the distribution whose names nobody else can take
LIMIT_S = 30.0  #: in which a package must be imported and listed
EntryPoint = importlib.metadata.EntryPoint
Offered = Mapping[str, Callable[[], Any]]  #: by name, what returns the factory

#: The other process: it gets the path and the entry points on standard input and answers with a line for each.
_CHILD = """
import json, sys
given = json.load(sys.stdin)
sys.path[:] = given["path"]
from sins_env.evaluation.estimators import offers
offers.answer(given["points"])
"""


class Offer(NamedTuple):
    """A solver of another package by name; or, with an ``error``, an entry point that offers none."""

    name: str
    point: EntryPoint
    about: About
    error: str = ""


def origin(point: EntryPoint) -> str:
    """The package of an entry point and what it names, in words."""
    return f"{point.dist.name} ({point.value})" if point.dist else point.value


def distribution(point: EntryPoint) -> str:
    """Name and version of the package of an entry point; empty where there is none."""
    return f"{point.dist.name} {point.dist.version}" if point.dist else ""


def points() -> tuple[list[EntryPoint], list[EntryPoint]]:
    """The entry points of the project's own, and those of other packages, each value of a name once."""
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
    """The top-level package or module of an entry point, which may be misspelt; empty if so."""
    return point.value.partition(":")[0].strip().partition(".")[0]


def own() -> dict[str, Callable[[], Any]]:
    """The project's own solvers."""
    found: dict[str, Callable[[], Any]] = {}
    for point in points()[0]:
        found |= _taken(point, point.load())
    return found


def load(point: EntryPoint) -> Offered:
    """What an entry point offers, which is imported for it.

    Raises:
        Exception, SystemExit: whatever the import raises.
        ValueError: a module that offers nothing.
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
    """What a package or module that has been imported has registered with the project's own solvers."""
    found: dict[str, Callable[[], Any]] = {}
    for point in points()[0]:
        if package_of(point) in sys.modules and isinstance(catalogue := point.load(), ModuleType):
            found |= {name: partial(getattr, catalogue, name) for name in catalogue.names(package)}
    return found


def foreign() -> list[Offer]:
    """What other packages offer, by name; nothing of them is imported here."""
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
    """For each entry point of a package, what its solvers say of themselves by name; a text is why one cannot be loaded."""
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
    """In the other process: a line of JSON for each entry point, as :func:`asked` returns them."""
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
    """An exception in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def called(factory: Any, name: str) -> Any:
    """The factory itself.

    Raises:
        ValueError: it is no class or function.
    """
    if not callable(factory):
        kind = type(factory).__name__
        an = "an" if kind[0] in "aeiou" else "a"
        raise ValueError(f"solver {name!r} is {an} {kind}; allowed: a class or function")
    return factory
