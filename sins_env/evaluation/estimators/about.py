"""Description of a solver by its factory: docstring and settings."""

from __future__ import annotations

import inspect
from functools import partial
from typing import Any, NamedTuple

#: Modules of Python's own base classes, whose docstrings do not describe an estimator that inherits from them.
_PYTHON = ("abc", "builtins", "typing")


class About(NamedTuple):
    """Description of a solver."""

    text: str  #: first paragraph of the docstring
    settings: dict[str, str]  #: default of each setting as text, by name


def about(factory: Any) -> About:
    """Return the description in a class, function or partial itself, not that of its type or its product."""
    settings: dict[str, str] = {}
    for parameter in inspect.signature(factory).parameters.values():
        if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
            default = parameter.default
            settings[parameter.name] = "required" if default is parameter.empty else repr(default)
    return About(inspect.cleandoc(_doc(factory)).split("\n\n")[0], settings)


def _doc(factory: Any) -> str:
    """Return the docstring of a factory.

    A class without one has that of its nearest base. A partial without one has that of the function it calls.
    """
    if isinstance(factory, type):
        found = (vars(base).get("__doc__") for base in factory.__mro__ if base.__module__ not in _PYTHON)
        return next((doc for doc in found if doc and not doc.startswith(f"{factory.__name__}(")), "")
    own = factory.__doc__ if inspect.isroutine(factory) else vars(factory).get("__doc__")
    if not own and isinstance(factory, partial):
        return _doc(factory.func)
    return own or ""
