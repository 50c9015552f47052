"""Solvers that installed packages offer by entry points of the group ``sins_env.estimators``.

An entry point is a class or function, a mapping, or a module, so it may offer any number of solvers. A class or function is
one solver with the name of the entry point. A mapping has solvers by name. A module offers the names that its function
``names()`` lists, which are its attributes, and the solvers that its package registers with ``solvers.register``.

The entry point of this project is loaded here. Each other package is loaded in a process of its own. If it fails, hangs or
ends its process, only its own names are missing.
"""

from __future__ import annotations

import importlib.metadata
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from types import ModuleType
from typing import Any, NamedTuple

from sins_env.evaluation.estimators.about import About, about
from sins_env.evaluation.estimators.child import Child
from sins_env.evaluation.estimators.guard import EstimatorError, line
from sins_env.evaluation.estimators.wire import MAX_TEXT, Answer

GROUP = "sins_env.estimators"
OWN = "sins-env"  #: name of this distribution, whose solver names no other package can take
LIMIT_S = 30.0  #: longest time in which a package is imported and its solvers are listed
EntryPoint = importlib.metadata.EntryPoint
Offered = Mapping[str, Callable[[], Any]]  #: functions that return a factory, by name of the solver

MOST_OFFERED = 1000  #: most solvers of an entry point
SEPARATOR = "\0"  #: between the parts of a description that passes between processes


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
        found |= _taken(point, _loaded(point))
    return found


def _loaded(point: EntryPoint) -> Any:
    """Return what an entry point of this project names.

    Raises:
        ValueError: it is not there, or hidden by a module of the user's own.
    """
    try:
        return point.load()
    except ImportError as error:
        raise ValueError(f"the solvers of this project cannot be imported: {error}") from error


def recommended() -> str:
    """Return the attribute ``RECOMMENDED`` of this project's entry point, a solver's name.

    Raises:
        ValueError: there is none.
    """
    return str(_recommending().RECOMMENDED)


def recorded() -> dict[str, Any]:
    """Return the attribute ``RECORDED`` of the same entry point: settings of that solver for a recording.

    Raises:
        ValueError: no solver is recommended.
    """
    return dict(_recommending().RECORDED)


def _recommending() -> Any:
    """Return what the entry point of this project that recommends a solver loads."""
    for point in points()[0]:
        if getattr(found := _loaded(point), "RECOMMENDED", ""):
            return found
    raise ValueError(
        "no solver is recommended, for none is installed; allowed: pip install . in the project's directory"
    )


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
        if package_of(point) in sys.modules and isinstance(catalogue := _loaded(point), ModuleType):
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
            yield Offer(name, point, About("", {}) if refused else said, said if refused else "")


@lru_cache
def asked(points: tuple[tuple[str, str], ...]) -> list[Any]:
    """Describe the solvers of a package in another process.

    Returns:
        for each entry point (name, value) a mapping from the name of a solver to its description. A text instead of a
        mapping or a description is the reason why it cannot be loaded.
    """
    found: list[Any] = []
    child = Child(f"{__name__}:Served")
    try:
        for name, value in points:
            found.append(_asked(child, name, value))
            if not child.running:
                found += [f"not looked at: {name}: {found[-1]}"] * (len(points) - len(found))
                break
    finally:
        child.close()
    return found


def _asked(child: Child, name: str, value: str) -> Any:
    try:
        count = child.call("load", LIMIT_S, name, value).value
        if count not in range(MOST_OFFERED + 1):
            return f"it offers {count} solvers; allowed: up to {MOST_OFFERED}"
        return dict(_described(child.call("describe", LIMIT_S, i)) for i in range(count))
    except EstimatorError as error:
        if error.ended:
            return f"importing it ended the process ({error.ended})"
        return f"importing it took longer than {LIMIT_S:g} s" if error.late else str(error)
    except ValueError as error:
        return str(error)


def _described(answer: Answer) -> tuple[str, About | str]:
    """Return the name of a solver, and its description or the reason why it cannot be loaded."""
    text, *settings = answer.second.split(SEPARATOR)
    return answer.first, About(text, dict(zip(settings[::2], settings[1::2], strict=False))) if answer.value else text


class Served:
    """Descriptions of solvers in the other process, as :func:`asked` and :func:`finding.describe` ask for them."""

    def __init__(self, memory: int) -> None:
        self._found: list[tuple[str, Callable[[], Any]]] = []

    def load(self, name: str, value: str) -> Answer:
        """Load an entry point and return the number of solvers that it offers."""
        try:
            self._found = list(load(EntryPoint(name, value, GROUP)).items())
        except (Exception, SystemExit) as error:
            raise ValueError(line(error)) from None
        return Answer(len(self._found))

    def describe(self, i: int) -> Answer:
        """Return name and description of a solver of the entry point that was loaded last."""
        name, get = self._found[i]
        try:
            return told(name, called(get(), name))
        except (Exception, SystemExit) as error:
            return Answer(0, name, line(error))


def told(name: str, factory: Any) -> Answer:
    """Return the description of a solver as an answer; what is too long for one is left out."""
    said = about(factory)
    text, room = said.text[: MAX_TEXT // 2], MAX_TEXT // 2
    for key, default in said.settings.items():
        part = f"{SEPARATOR}{key}{SEPARATOR}{default}"
        if (room := room - len(part.encode("utf-8", "replace"))) < 0:
            break
        text += part
    return Answer(1, name, text)


def untold(answer: Answer) -> About:
    """Return the description in an answer of :func:`told`."""
    _, said = _described(answer)
    return said if isinstance(said, About) else About("", {})


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
