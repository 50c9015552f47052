"""What happens when two other packages are imported, before or after this one.

Gymnasium gets the environments. Neither the mathematics nor a look at recordings needs it or the worlds, so that ``import
sins_env`` imports neither, and Gymnasium since version 1.0 reads no entry points of plug-ins. Therefore its import is watched.

A folder or file ``solvers`` of the user's own may hide the package of that name, which is installed together with this one.
What is not found in it says so. A mere folder, without ``__init__.py``, hides nothing.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import sys
from types import ModuleType
from typing import Any

HIDDEN = "solvers"  #: package of this distribution that a project may have one of its own of


def _register(gymnasium: ModuleType) -> None:
    importlib.import_module("sins_env.envs")  # which registers; not above, because it imports Gymnasium


def _explain(module: ModuleType) -> None:
    """Let a module that hides ours say so when it is asked for what it does not have; ours has a ``__getattr__``."""

    def missing(name: str) -> Any:
        raise AttributeError(_said(module, f"has no attribute {name!r}"), name=name, obj=module)

    vars(module).setdefault("__getattr__", missing)


def _hides() -> ModuleType | None:
    """Return the imported module that hides ours; None if there is none."""
    module = sys.modules.get(HIDDEN)
    return module if getattr(getattr(module, "__getattr__", None), "__module__", None) == __name__ else None


def _said(module: ModuleType, lacks: str) -> str:
    place = module.__file__ or ", ".join(module.__path__)
    return (
        f"module {HIDDEN!r} {lacks}: it is {place}, which hides the package {HIDDEN!r} of sins-env. "
        "Give that file or folder another name"
    )


WATCHED = {"gymnasium": _register, HIDDEN: _explain}  #: modules, each with what is done with it after its import


class _Watch:
    """Finder of the watched modules that asks the other finders of ``sys.meta_path``, and acts after the import."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        if fullname in WATCHED:
            return self._watched(fullname, path, target)
        package, _, name = fullname.partition(".")
        if package == HIDDEN and (module := _hides()) is not None:
            found = importlib.machinery.PathFinder.find_spec(fullname, path, target)
            if found is None:
                raise ImportError(_said(module, f"has no {name!r}"))
            return found
        return None

    def _watched(self, fullname: str, path: Any, target: Any) -> importlib.machinery.ModuleSpec | None:
        others = (finder.find_spec(fullname, path, target) for finder in sys.meta_path if finder is not self)
        spec = next((one for one in others if one is not None and one.loader is not None), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_act(module: ModuleType) -> None:
                execute(module)
                WATCHED[fullname](module)

            spec.loader.exec_module = execute_and_act  # type: ignore[method-assign]
        return spec


def install() -> None:
    """Act now on what is imported, and on the rest at its import; a second call changes nothing."""
    for name in WATCHED.keys() & sys.modules.keys():
        WATCHED[name](sys.modules[name])
    if not any(isinstance(finder, _Watch) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Watch())
