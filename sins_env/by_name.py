"""Classes that are found by their names in the files of a folder, so that no list of them is kept by hand."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any, TypeVar

from sins_env.checks import unknown

T = TypeVar("T")

_found: dict[tuple[str, type], dict[str, Any]] = {}


def classes(folder: str, base: type[T]) -> dict[str, type[T]]:
    """Return the subclasses of ``base`` in the files of a package, each by its attribute ``name``.

    Raises:
        ImportError: two of one name.
    """
    key = folder, base
    if key not in _found:
        package, named = importlib.import_module(folder), dict[str, Any]()
        for file in pkgutil.iter_modules(package.__path__, f"{folder}."):
            for cls in vars(importlib.import_module(file.name)).values():
                if not isinstance(cls, type) or not issubclass(cls, base) or cls.__module__ != file.name:
                    continue
                name: str | None = getattr(cls, "name", None)
                if name in named:
                    raise ImportError(f"{file.name}: a second {name!r}; allowed: a name of its own")
                if name is not None:
                    named[name] = cls
        _found[key] = named
    return _found[key]


def find(kind: str, name: str, folder: str, base: type[T]) -> type[T]:
    """Return the subclass of that name; ``kind`` says in the error what it is.

    Raises:
        ValueError: an unknown name; the error offers the nearest one.
    """
    known = classes(folder, base)
    if name not in known:
        raise unknown(kind, name, known)
    return known[name]
