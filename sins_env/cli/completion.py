"""Completion of a command in the shell, by argcomplete: verbs and options from the grammar, names from what is installed.

A solver of another package is offered by the name of its entry point, for the package itself is not imported.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from typing import Any

import argcomplete

from sins_env.cli.arguments import Parser
from sins_env.cli.grammar import parser


def _of(module: str) -> Any:
    """Import a module of this package when its names are asked for: no other completion waits for it."""
    return importlib.import_module(f"sins_env.{module}")


def _tasks() -> Iterable[str]:
    return _of("evaluation.tasks.catalogue").TASKS


def _solvers() -> Iterable[str]:
    offers = _of("evaluation.estimators.offers")
    return [*offers.own(), *(point.name for point in offers.points()[1])]


def _kinds() -> Iterable[str]:
    return _of("cli.describe.listing").KINDS


def _described() -> Iterable[str]:
    kinds = _of("cli.describe.listing").KINDS
    names = (name for kind, one in kinds.items() if kind not in ("solvers", "tables") for name in one.names())
    return ["scenario", *_solvers(), *names]


def _tables() -> Iterable[str]:
    return _of("evaluation.reproduction").TABLES


#: Names that an argument may have, by what the grammar calls it; what is not here is a file or a number.
NAMES: dict[str, Callable[[], Iterable[str]]] = {
    "task": _tasks,
    "solver": _solvers,
    "reference": _solvers,
    "kind": _kinds,
    "name": _described,
    "table": _tables,
}
OR_FILES = ("task", "name")  #: those of them that may be files, too: scenarios and recordings


def answering() -> Parser:
    """Return the parser of all verbs, whose arguments know their names."""
    top = parser()
    files = argcomplete.FilesCompleter()
    for action in (action for sub in top.verbs.values() for action in sub._actions if action.dest in NAMES):

        def names(prefix: str, _dest: str = action.dest, **_: Any) -> list[str]:
            return [*NAMES[_dest](), *(files(prefix) if _dest in OR_FILES else ())]

        action.completer = names  # type: ignore[attr-defined]
    return top


def complete() -> None:
    """Answer the shell that asks for completions, and end the process."""
    argcomplete.autocomplete(answering(), always_complete_options=False)
