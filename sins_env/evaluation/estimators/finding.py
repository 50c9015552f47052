"""Finding solvers: by entry point in the group ``sins_env.estimators``, or as ``package.module:Factory``."""

from __future__ import annotations

import importlib
import importlib.metadata
import inspect
import os
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sins_env.checks import unknown
from sins_env.types import Estimator

GROUP = "sins_env.estimators"
Factory = Callable[..., Estimator]
Solver = str | Factory


#: what an estimator must have, and how it is written
MEMBERS = {
    "batched": "batched = False (one run at a time) or True (a leading run axis)",
    "reset": "reset(self, task, rng, num_runs=1)",
    "step": "step(self, obs)",
}
OWN = "sins-env"  #: the distribution whose names nobody else can take
EntryPoint = importlib.metadata.EntryPoint


def names() -> list[str]:
    """The solvers that installed packages offer."""
    return sorted(offers())


def offers() -> dict[str, list[EntryPoint]]:
    """Entry points by name, each value once; the project's own solvers come alone."""
    found: dict[str, list[EntryPoint]] = {}
    packages: dict[int, EntryPoint] = {}
    for point in importlib.metadata.entry_points(group=GROUP):
        same = found.setdefault(point.name, [])
        if point.value not in [other.value for other in same]:
            same.append(point)
        packages[id(point.dist)] = point
    # a package's name is parsed anew whenever it is asked for: once for all its points
    own = {dist for dist, point in packages.items() if _is_own(point)}
    return {name: [p for p in points if id(p.dist) in own][:1] or points for name, points in found.items()}


def _is_own(point: EntryPoint) -> bool:
    return point.dist is not None and re.sub(r"[-_.]+", "-", point.dist.name).lower() == OWN


def package_of(point: EntryPoint) -> str:
    """The top-level package or module of an entry point, which may be misspelt; empty if so."""
    return point.value.partition(":")[0].strip().partition(".")[0]


def provider(solver: Solver) -> str | None:
    """Name and version of the package that offers a solver by name; None for the project's own and for the unnamed."""
    points = offers().get(solver, []) if isinstance(solver, str) else []
    dists = [point.dist for point in points if point.dist is not None and not _is_own(point)]
    return ", ".join(f"{dist.name} {dist.version}" for dist in dists) or None


def is_own(solver: Solver) -> bool:
    """Whether a solver is the project's own, by name."""
    return isinstance(solver, str) and any(_is_own(point) for point in offers().get(solver, []))


def shadowed() -> list[str]:
    """What other packages offer under a name of the project's own: found by its path only."""
    own = {name for name, points in offers().items() if _is_own(points[0])}
    points = importlib.metadata.entry_points(group=GROUP)
    return sorted({f"{p.name} of {_origin(p)}" for p in points if p.name in own and not _is_own(p)})


def _origin(point: EntryPoint) -> str:
    return f"{point.dist.name} ({point.value})" if point.dist else point.value


def solver_name(solver: Solver) -> str:
    """What a solver is called in tables: the name it was asked for, or module:name of a class or function."""
    if isinstance(solver, str):
        return solver
    return f"{getattr(solver, '__module__', '?')}:{getattr(solver, '__qualname__', type(solver).__qualname__)}"


def find(solver: Solver) -> Factory:
    """The factory of a solver; the current directory is searched for modules, too.

    Raises:
        ValueError: no such name, module or attribute (the nearest one is offered), or a module that fails to
        import.
    """
    if not isinstance(solver, str):
        if not callable(solver):
            raise ValueError(f"solver {solver!r}; allowed: a name, 'package.module:Factory', or a class or function")
        return solver
    if ":" in solver:
        return _from_module(solver)
    points = offers()
    if solver not in points:
        hint = "" if points else " (no solvers are installed: pip install . in the project's directory)"
        if path := _module_of(solver):
            raise ValueError(f"solver {solver!r} is a module; allowed: {path}:Factory, with a class or function of it")
        raise ValueError(f"{unknown('solver', solver, points)}, or module:Factory{hint}")
    point, *others = points[solver]
    if others:
        rivals = " and ".join(map(_origin, points[solver]))
        raise ValueError(f"solver {solver!r} is offered by {rivals}; allowed: one of them, as module:Factory")
    try:
        factory = point.load()
    except (Exception, SystemExit) as error:
        raise ValueError(f"solver {solver!r} ({point.value}) cannot be loaded: {_line(error)}") from error
    return _callable(factory, solver)


def _from_module(path: str) -> Factory:
    module_name, _, attribute = path.partition(":")
    if os.getcwd() not in sys.path and "" not in sys.path:
        sys.path.insert(0, os.getcwd())
    try:
        module = importlib.import_module(module_name)
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and f"{module_name}.".startswith(f"{error.name}."):
            where = f"allowed: module:Factory, importable from {os.getcwd()}"
            if found := _module_of(module_name):
                where = f"did you mean {f'{found}:{attribute}'!r}?"
            raise ValueError(f"solver {path!r}: {error}; {where}") from error
        raise ValueError(f"solver {path!r}: importing {module_name} failed with {_line(error)}") from error
    target: Any = module
    for part in attribute.split("."):
        if not hasattr(target, part):
            public = [name for name, value in vars(target).items() if callable(value) and not name.startswith("_")]
            raise unknown(f"factory in {module_name}", attribute, public)
        target = getattr(target, part)
    return _callable(target, path)


def _module_of(name: str) -> str:
    """The module that a file of the current directory is, named with its ending or without; empty if there is none."""
    module = name.removesuffix(".py").removeprefix("./").replace("/", ".")
    file = Path(*module.split(".")).with_suffix(".py")
    return module if not file.is_absolute() and file.is_file() else ""


def _callable(factory: Any, name: str) -> Factory:
    if not callable(factory):
        kind = type(factory).__name__
        raise ValueError(
            f"solver {name!r} is {'an' if kind[0] in 'aeiou' else 'a'} {kind}; allowed: a class or function"
        )
    return factory


def _line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def make(solver: Solver, settings: Mapping[str, Any] | None = None) -> Estimator:
    """An estimator of that solver; ``settings`` are passed as keywords.

    Raises:
        ValueError: as :func:`find`; settings the factory refuses; a product without ``reset``, ``step`` and
        ``batched``.
    """
    name, given = solver_name(solver), dict(settings or {})
    try:
        estimator = find(solver)(**given)
        missing = [part for part in MEMBERS if not hasattr(estimator, part)]
        batched = None if missing else estimator.batched
    except ValueError:
        raise
    except (Exception, SystemExit) as error:
        what = f"settings {given}" if given else "no settings"
        raise ValueError(f"solver {name!r} cannot be made with {what}: {_line(error)}") from error
    if missing:
        needed = "; ".join(MEMBERS[part] for part in missing)
        raise ValueError(
            f"solver {name!r} makes a {type(estimator).__name__} without {', '.join(missing)}; allowed: {needed}"
        )
    if not isinstance(batched, (bool, np.bool_)):
        raise ValueError(f"solver {name!r}: batched is {batched!r}; allowed: True or False")
    return estimator


def describe(solver: Solver) -> tuple[str, dict[str, str]]:
    """First paragraph of the docstring, and the settings with their defaults as text."""
    factory = find(solver)
    own = inspect.getdoc(factory)
    text = own if own and own != inspect.getdoc(type(factory)) else inspect.getdoc(type(make(solver)))
    settings: dict[str, str] = {}
    for parameter in inspect.signature(factory).parameters.values():
        if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
            default = parameter.default
            settings[parameter.name] = "required" if default is parameter.empty else repr(default)
    return (text or "").split("\n\n")[0], settings
