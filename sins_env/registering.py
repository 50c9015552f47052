"""Registration of the environments with Gymnasium: at once if Gymnasium is imported already, else at its import.

Neither the mathematics nor a look at recordings needs Gymnasium or the worlds, so that ``import sins_env`` imports
neither. Gymnasium since version 1.0 reads no entry points of plug-ins; therefore its import is watched.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import sys
from types import ModuleType
from typing import Any

WATCHED = "gymnasium"


class _Watch:
    """Finder of Gymnasium that asks the other finders of ``sys.meta_path``, and registers after the import."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        if fullname != WATCHED:
            return None
        others = (finder.find_spec(fullname, path, target) for finder in sys.meta_path if finder is not self)
        spec = next(filter(None, others), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                _register()

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


def _register() -> None:
    importlib.import_module("sins_env.envs")  # which registers; not above, because it imports Gymnasium


def install() -> None:
    """Register now or at the import of Gymnasium; a second call changes nothing."""
    if WATCHED in sys.modules:
        _register()
    elif not any(isinstance(finder, _Watch) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Watch())
