"""Finding of solvers by a name that an installed package offers, or as ``package.module:Factory``."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sins_env.checks import unknown
from sins_env.evaluation.estimators import offers
from sins_env.evaluation.estimators.about import About, about
from sins_env.evaluation.estimators.child import Child
from sins_env.evaluation.estimators.guard import EstimatorError, line
from sins_env.evaluation.estimators.offers import EntryPoint, Offer, called, origin
from sins_env.evaluation.estimators.wire import Answer
from sins_env.types import Estimator

Factory = Callable[..., Estimator]
Solver = str | Factory

#: Members that an estimator must have, each with its declaration.
MEMBERS = {
    "batched": "batched = False (one run at a time) or True (a leading run axis)",
    "reset": "reset(self, task, rng, num_runs=1)",
    "step": "step(self, obs)",
}
FILTER = ("init", "step", "estimate")  #: members of a bare filter of :mod:`solvers.filters`


def names() -> list[str]:
    """Return the names of all solvers: those of this project, and those that other installed packages offer."""
    return sorted({*offers.own(), *_foreign()})


def _foreign() -> dict[str, list[Offer]]:
    """Return what other packages offer, by name, without the names of this project."""
    own = offers.own()
    found: dict[str, list[Offer]] = {}
    for offer in offers.foreign():
        if offer.name not in own:
            found.setdefault(offer.name, []).append(offer)
    return {name: [one for one in same if one.point.name == name] or same for name, same in found.items()}


def recommended() -> str:
    """Return the name of the solver that this project recommends, which its entry point tells.

    Raises:
        ValueError: the solvers of this project are not installed.
    """
    return offers.recommended()


def recorded() -> dict[str, Any]:
    """Return the settings with which the recommended solver takes a recording.

    Raises:
        ValueError: the solvers of this project are not installed.
    """
    return offers.recorded()


def is_own(solver: Solver) -> bool:
    """Return whether a solver is given by the name of one of this project."""
    return isinstance(solver, str) and solver in offers.own()


def is_foreign(solver: Solver) -> bool:
    """Return whether a solver is a stranger's: named as ``module:Factory``, or by a name that another package offers.

    A class or function is none: the caller has imported it.
    """
    if not isinstance(solver, str) or is_own(solver):
        return False
    return ":" in solver or any(point.name == solver for point in offers.points()[1]) or solver in _foreign()


class Listed(NamedTuple):
    """Solver in the list of names."""

    name: str
    package: str  #: name and version of its package; empty for one of this project
    about: About
    error: str  #: reason why it cannot be loaded; empty if it can


def listing() -> list[Listed]:
    """Return all solvers that have a name, with their descriptions, sorted by name.

    Other packages are imported in processes of their own only.
    """
    rows = [Listed(name, "", about(get()), "") for name, get in offers.own().items()]
    for name, same in _foreign().items():
        packages = ", ".join(filter(None, (offers.distribution(offer.point) for offer in same)))
        try:
            rows.append(Listed(name, packages, _told(same), ""))
        except ValueError as error:
            rows.append(Listed(name, packages, About("", {}), str(error)))
    return sorted(rows)


def shadowed() -> list[str]:
    """Return the solvers of other packages that have a name of this project, and so are found by path only."""
    own = offers.own()
    return sorted({f"{offer.name} of {origin(offer.point)}" for offer in offers.foreign() if offer.name in own})


def solver_name(solver: Solver) -> str:
    """Return the name of a solver in tables: the given name, or module:name of a class or function."""
    if isinstance(solver, str):
        return solver
    return f"{getattr(solver, '__module__', '?')}:{getattr(solver, '__qualname__', type(solver).__qualname__)}"


def find(solver: Solver) -> Factory:
    """Return the factory of a solver; modules may lie in the current directory, too.

    A module of another package is imported only for a solver of that package.

    Raises:
        ValueError: no such name, module or attribute (the error offers the nearest one), or a module that fails to
            import.
    """
    if not isinstance(solver, str):
        if not callable(solver):
            raise ValueError(f"solver {solver!r}; allowed: a name, 'package.module:Factory', or a class or function")
        return solver
    if ":" in solver:
        return _from_module(solver)
    if own := offers.own().get(solver):
        return called(own(), solver)
    return _from_package(solver)


def _from_package(name: str) -> Factory:
    """Import another package and return its solver of that name."""
    for point in _offering(name):
        try:
            found = offers.load(point)
        except (Exception, SystemExit) as error:
            raise _unloadable(name, point, line(error)) from error
        if name in found:
            return called(found[name](), name)
    raise _no_such(name)


def _offering(name: str) -> Iterator[EntryPoint]:
    """Yield the entry points that may offer a solver: that of its name, then the one that lists it.

    The second needs a process that imports the package.
    """
    if named := [point for point in offers.points()[1] if point.name == name]:
        yield _only(named, name)
    if listed := _foreign().get(name):
        yield _only([offer.point for offer in listed], name)


def _no_such(name: str) -> ValueError:
    if path := _module_of(name):
        return ValueError(f"solver {name!r} is a module; allowed: {path}:Factory, with a class or function of it")
    known = names()
    hint = "" if known else " (no solvers are installed: pip install . in the project's directory)"
    return ValueError(f"{unknown('solver', name, known)}, or module:Factory{hint}")


def _only(points: Sequence[EntryPoint], name: str) -> EntryPoint:
    if len(points) > 1:
        rivals = " and ".join(map(origin, points))
        raise ValueError(f"solver {name!r} is offered by {rivals}; allowed: one of them, as module:Factory")
    return points[0]


def _unloadable(name: str, point: EntryPoint, why: str) -> ValueError:
    return ValueError(f"solver {name!r} ({point.value}) cannot be loaded: {why}")


def module_of(solver: Solver) -> str:
    """Return the module of a solver that is not of this project, without importing it.

    Raises:
        ValueError: no such name or module.
    """
    if not isinstance(solver, str):
        return str(getattr(solver, "__module__", ""))
    if ":" not in solver:
        for point in _offering(solver):
            return point.value.partition(":")[0].strip()
        raise _no_such(solver)
    module = solver.partition(":")[0]
    package = module.partition(".")[0]
    if package not in sys.modules and spec_of(package) is None:
        raise _no_module(solver, f"No module named {package!r}")
    return module


def spec_of(package: str) -> ModuleSpec | None:
    """Return where a top-level package or module is, which may be the current directory; None if it is nowhere.

    It is not imported, and the search path stays as it is: a stranger's folder may have a module of any name.

    Raises:
        ValueError: the script that runs.
    """
    if package in sys.modules or package in sys.builtin_module_names:
        return importlib.util.find_spec(package)
    here = [] if "" in sys.path else [os.getcwd()]
    return PathFinder.find_spec(package, [*here, *sys.path])


def _search_here() -> None:
    """Add the current directory to the search path of modules."""
    if os.getcwd() not in sys.path and "" not in sys.path:
        sys.path.insert(0, os.getcwd())


def _no_module(path: str, why: object) -> ValueError:
    module, _, attribute = path.partition(":")
    where = f"allowed: module:Factory, importable from {os.getcwd()}"
    found = _module_of(module)
    if found and found == module:
        package = found.partition(".")[0]
        there = getattr(sys.modules.get(package), "__file__", "elsewhere")
        here = f"{found.replace('.', '/')}.py"
        where = f"{here} is hidden by the package {package!r} ({there}): give its folder another name"
    elif found:
        where = f"did you mean {f'{found}:{attribute}'!r}?"
    return ValueError(f"solver {path!r}: {why}; {where}")


def _from_module(path: str) -> Factory:
    """Return a class or function of a module, or the solver that the module registers under that name."""
    module_name, _, attribute = path.partition(":")
    _search_here()
    try:
        module = importlib.import_module(module_name)
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and f"{module_name}.".startswith(f"{error.name}."):
            raise _no_module(path, error) from error
        raise ValueError(f"solver {path!r}: importing {module_name} failed with {line(error)}") from error
    if mine := offers.registered(module_name).get(attribute):
        return called(mine(), path)
    target: Any = module
    for part in attribute.split("."):
        if not hasattr(target, part):
            public = [name for name, value in vars(target).items() if callable(value) and not name.startswith("_")]
            public += offers.registered(module_name)
            raise unknown(f"factory in {module_name}", attribute, public)
        target = getattr(target, part)
    return called(target, path)


def _module_of(name: str) -> str:
    """Return the module name of a file in the current directory, given with or without ``.py``; empty if there is none."""
    module = name.removesuffix(".py").removeprefix("./").replace("/", ".")
    file = Path(*module.split(".")).with_suffix(".py")
    return module if not file.is_absolute() and file.is_file() else ""


def make(solver: Solver, settings: Mapping[str, Any] | None = None) -> Estimator:
    """Make an estimator of that solver; ``settings`` are passed as keywords.

    Raises:
        ValueError: a solver that :func:`find` refuses, settings that the factory refuses, or a product without ``reset``,
            ``step`` and ``batched``.
    """
    name, given = solver_name(solver), dict(settings or {})
    what = f"settings {given}" if given else "no settings"
    factory = None
    try:
        factory = find(solver)
        estimator = factory(**given)
        missing = [part for part in MEMBERS if not hasattr(estimator, part)]
        batched = None if missing else estimator.batched
    except ValueError as error:
        if factory is None or not isinstance(solver, str) or ":" not in solver:
            raise
        raise ValueError(f"solver {name!r} refuses {what}: {line(error)}") from error  # which may say nothing of where
    except (Exception, SystemExit) as error:
        raise ValueError(f"solver {name!r} cannot be made with {what}: {line(error)}") from error
    if "reset" in missing and all(hasattr(estimator, part) for part in FILTER):
        made = f"{type(estimator).__name__}({', '.join(f'{key}={value!r}' for key, value in given.items())})"
        raise ValueError(f"solver {name!r} is a bare filter; wrap it: Pipeline({made}), with Pipeline of solvers")
    if missing:
        needed = "; ".join(MEMBERS[part] for part in missing)
        raise ValueError(
            f"solver {name!r} makes a {type(estimator).__name__} without {', '.join(missing)}; allowed: {needed}"
        )
    if not isinstance(batched, (bool, np.bool_)):
        raise ValueError(f"solver {name!r}: batched is {batched!r}; allowed: True or False")
    return estimator


def describe(solver: Solver) -> About:
    """Return the first paragraph of a solver's docstring, and its settings with their defaults as text.

    A stranger's solver is described in a process of its own, and not imported here.

    Raises:
        ValueError: a solver that :func:`find` refuses, or a stranger's module that ends its process.
    """
    if not isinstance(solver, str) or is_own(solver):
        return about(find(solver))
    if ":" not in solver:
        return _told(found) if (found := _foreign().get(solver)) else about(find(solver))
    child = Child(f"{__name__}:Served")
    try:
        return offers.untold(child.call("describe", offers.LIMIT_S, solver))
    except EstimatorError as error:
        raise ValueError(f"solver {solver!r} cannot be described: {error}") from error
    finally:
        child.close()


class Served:
    """Description of a solver in the other process, as :func:`describe` asks for it."""

    def __init__(self, memory: int) -> None:
        pass

    def describe(self, path: str) -> Answer:
        """Return the description of ``module:Factory``."""
        return offers.told(path, find(path))


def _told(offered: Sequence[Offer]) -> About:
    """Return the description, from the other process, of the one solver that is offered under a name."""
    first = offered[0]
    point = _only([offer.point for offer in offered], first.name)
    if first.error:
        raise _unloadable(first.name, point, first.error)
    return first.about
