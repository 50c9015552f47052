"""How filters and estimators are shown: one short line with the settings that differ from their defaults."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any


def changed(made: type, values: Mapping[str, Any]) -> list[str]:
    """Return the values that differ from the defaults of the settings of a class: ["name=value", ...]."""
    settings = [p for p in inspect.signature(made).parameters.values() if p.name in values]
    return [f"{p.name}={values[p.name]!r}" for p in settings if repr(values[p.name]) != repr(p.default)]


class Brief:
    """Base of dataclasses that are shown so. It stands in each class, because ``@dataclass`` makes a ``repr`` otherwise."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__repr__" not in vars(cls):
            cls.__repr__ = _brief  # type: ignore[method-assign]


def _brief(shown: Any) -> str:
    return f"{type(shown).__name__}({', '.join(changed(type(shown), vars(shown)))})"
