"""The key of a stored row: task, solver, settings, seed and code version."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Key:
    """Which solver on which suite, with which code."""

    task: str
    suite: str
    solver: str
    settings: str  #: canonical JSON
    code: str

    @classmethod
    def of(cls, task: str, suite: str, solver: str, settings: Mapping[str, Any], code: str) -> Key:
        return cls(task, suite, solver, canonical(settings), code)

    def among(self, tasks: Sequence[str], solvers: Sequence[str]) -> bool:
        """Whether it is of one of these tasks and solvers; none named: of any."""
        return (not tasks or self.task in tasks) and (not solvers or self.solver in solvers)

    @property
    def settings_hash(self) -> str:
        return hashlib.sha256(self.settings.encode()).hexdigest()[:12]

    @property
    def values(self) -> tuple[str, ...]:
        """In the order of KEY, without the run."""
        return self.task, self.suite, self.solver, self.settings_hash, self.code


def canonical(settings: Mapping[str, Any]) -> str:
    """Settings as JSON with sorted keys.

    Raises:
        ValueError: a value that JSON does not have.
    """
    try:
        return json.dumps(dict(settings), sort_keys=True)
    except TypeError as error:
        given = dict(settings)
        raise ValueError(f"settings {given!r}; allowed in a results file: numbers, text, lists") from error
