"""The public interface: the modules whose ``__all__`` is promised to users, in the order of the API reference.

The reference is made of this table, and a test holds that every name has a docstring. A name that several modules export is
described in the first of them; the others refer to it.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
import re
from collections.abc import Iterator
from typing import Any, NamedTuple


class Page(NamedTuple):
    """A page of the API reference."""

    title: str
    intro: str  #: reStructuredText
    modules: tuple[str, ...]


PAGES = {
    "types": Page(
        "The contract of an estimator",
        "What passes between an environment, an estimator and a score. An estimator needs to import or inherit nothing: "
        ":doc:`/docs/tasks_and_scores` has the contract in words.",
        ("sins_env.types",),
    ),
    "specs": Page(
        "Assumed sensors and priors",
        "Datasheets of inertial sensors, of fixes and of aiding sensors, and what is known of the start.",
        ("sins_env.specs", "sins_env.prior"),
    ),
    "environments": Page(
        "Environments",
        "The Gymnasium environments. Their keyword arguments are the fields of their settings, which stand below them.",
        ("sins_env.envs", "sins_env.envs.environments"),
    ),
    "tasks": Page(
        "Tasks and scenarios",
        "A task is an environment with its settings and with what counts as aligned. A scenario is a task in one file: "
        ":doc:`/docs/scenarios`.",
        ("sins_env.tasks",),
    ),
    "evaluation": Page(
        "Evaluation",
        "Monte Carlo runs of a solver on a task, scores with intervals, comparisons, and the check of an estimator.",
        ("sins_env.evaluation",),
    ),
    "learning": Page(
        "Learning",
        "Wrappers of the environments, an environment in which an agent tunes a filter, and seeds of runs to learn from: "
        ":doc:`/docs/learning`. Data sets are made by :func:`sins_env.dataset`.",
        ("sins_env.wrappers", "sins_env.learning.tune_noise", "sins_env.learning.seeds", "sins_env.learning.tuning"),
    ),
    "recordings": Page(
        "Recordings",
        "Files of measured data, read into one form and written from it: :doc:`/docs/recordings`.",
        ("sins_env.recordings",),
    ),
    "solvers": Page(
        "Solvers",
        "Complete estimators by name, the bare filters behind them, and how one of your own joins the zoo.",
        ("solvers", "solvers.filters", "solvers.types", "solvers.smoothing"),
    ),
    "frames": Page(
        "Attitude and earth",
        "Quaternions, rotation matrices and Euler angles, and the earth: :doc:`/docs/mathematics/frames`.",
        ("sins_env.attitude", "sins_env.earth"),
    ),
    "package": Page(
        "The package at its top",
        "What ``import sins_env`` offers. Most names have their home in one of the modules of the other pages.",
        ("sins_env",),
    ),
}


class Name(NamedTuple):
    """A public name."""

    module: str
    name: str
    thing: Any
    home: str  #: where it is described, ``module.name``; another module if one that comes before has it, too

    @property
    def is_home(self) -> bool:
        """Whether it is described here."""
        return self.home == f"{self.module}.{self.name}"

    @property
    def words(self) -> str:
        """What the code says of it: a docstring, or for a constant the ``#:`` comment beside its definition."""
        if inspect.ismodule(self.thing) or inspect.isroutine(self.thing) or hasattr(self.thing, "py_func"):
            return inspect.getdoc(self.thing) or ""
        if inspect.isclass(self.thing):
            return inspect.cleandoc(vars(self.thing).get("__doc__") or "")
        return comment(self.module, self.name)


def names() -> Iterator[Name]:
    """Yield every public name, module after module."""
    homes: dict[int, str] = {}
    for page in PAGES.values():
        for module in page.modules:
            there = importlib.import_module(module)
            for name in there.__all__:
                thing, here = getattr(there, name), f"{module}.{name}"
                same = here if isinstance(thing, int | float | str) else homes.setdefault(id(thing), here)
                yield Name(module, name, thing, same)


def comment(module: str, name: str) -> str:
    """Return the ``#:`` comment of a constant, above its definition or behind it; imports are followed to it."""
    source = inspect.getsource(importlib.import_module(module))
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and any((one.asname or one.name) == name for one in node.names):
            return comment(str(node.module), next(one.name for one in node.names if (one.asname or one.name) == name))
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if name in [target.id for target in targets if isinstance(target, ast.Name)]:
            above = itertools.takewhile(lambda line: line.startswith("#:"), reversed(lines[: node.lineno - 1]))
            behind = [
                found for line in lines[node.lineno - 1 : node.end_lineno] for found in re.findall(r"  (#:.*)", line)
            ]
            return " ".join(part.removeprefix("#:").strip() for part in [*reversed(list(above)), *behind])
    return ""
