"""What a factory says of itself: its own docstring, and its settings."""

from __future__ import annotations

import inspect
from functools import partial
from typing import Any, NamedTuple

#: Modules whose classes describe Python, not the estimator that inherits from them.
_PYTHON = ("abc", "builtins", "typing")


class About(NamedTuple):
    """The first paragraph of the docstring, and the settings with their defaults as text."""

    text: str
    settings: dict[str, str]


def about(factory: Any) -> About:
    """What a class, function or partial says of itself, not what its type or its product says."""
    settings: dict[str, str] = {}
    for parameter in inspect.signature(factory).parameters.values():
        if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
            default = parameter.default
            settings[parameter.name] = "required" if default is parameter.empty else repr(default)
    return About(inspect.cleandoc(_doc(factory)).split("\n\n")[0], settings)


def _doc(factory: Any) -> str:
    """The docstring of the object; of the nearest base that has one, for a class; of what it calls, for a partial."""
    if isinstance(factory, type):
        found = (vars(base).get("__doc__") for base in factory.__mro__ if base.__module__ not in _PYTHON)
        return next((doc for doc in found if doc and not doc.startswith(f"{factory.__name__}(")), "")
    own = factory.__doc__ if inspect.isroutine(factory) else vars(factory).get("__doc__")
    if not own and isinstance(factory, partial):
        return _doc(factory.func)
    return own or ""
