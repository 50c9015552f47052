"""The key of stored runs: task, suite, solver, settings and code version."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Key:
    """Key of the runs of one solver, with its settings and code, on one suite of a task."""

    task: str
    suite: str  #: hash of the suite seed
    solver: str
    settings: str  #: settings of the solver as canonical JSON
    code: str  #: version of the code

    @classmethod
    def of(cls, task: str, suite: str, solver: str, settings: Mapping[str, Any], code: str) -> Key:
        """Make a key from settings as a mapping.

        Raises:
            ValueError: a setting that JSON does not have.
        """
        return cls(task, suite, solver, canonical(settings), code)

    def among(self, tasks: Sequence[str], solvers: Sequence[str]) -> bool:
        """Return whether its task and solver are among these; an empty sequence allows any."""
        return (not tasks or self.task in tasks) and (not solvers or self.solver in solvers)

    @property
    def settings_hash(self) -> str:
        """First 12 hex digits of the SHA-256 of the settings."""
        return settings_hash(self.settings)

    @property
    def values(self) -> tuple[str, ...]:
        """Values of the columns KEY in their order, without the run."""
        return self.task, self.suite, self.solver, self.settings_hash, self.code


def settings_hash(settings: str) -> str:
    """Return the first 12 hex digits of the SHA-256 of settings as JSON."""
    return hashlib.sha256(settings.encode()).hexdigest()[:12]


def canonical(settings: Mapping[str, Any]) -> str:
    """Return settings as JSON with sorted keys.

    Raises:
        ValueError: a value that JSON does not have.
    """
    try:
        return json.dumps(dict(settings), sort_keys=True)
    except TypeError as error:
        given = dict(settings)
        raise ValueError(f"settings {given!r}; allowed in a results file: numbers, text, lists") from error
