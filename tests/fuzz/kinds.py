"""All kinds: importing this module registers them. ``kinds.go("flights", example)`` plays one again."""

from typing import Any

from fuzz import commands, files, scenarios, solving, worlds
from fuzz.kind import KINDS

__all__ = ["KINDS", "commands", "files", "go", "scenarios", "solving", "worlds"]


def go(name: str, example: Any) -> str:
    """Play one example of a kind.

    Raises:
        Failed: it is a failure.
    """
    return KINDS[name].go(example)
