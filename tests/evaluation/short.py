"""Tasks cut short for the tests: ``SHORT`` is 20 s of sway, told start, hold 5 s."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import pytest

from sins_env.evaluation.speed import cost
from sins_env.evaluation.tasks import catalogue
from sins_env.evaluation.tasks.catalogue import get_task

HOLD_S = 5.0  #: s, how long an error must hold
_WHITE = get_task("sway-white-v0")
SHORT = dataclasses.replace(
    _WHITE, name="short-v0", what="short", kwargs={**_WHITE.kwargs, "duration": 20.0}, hold_s=HOLD_S
)


def cut_short(patch: pytest.MonkeyPatch, settings: Mapping[str, Mapping[str, Any]], blocks: int) -> None:
    """Give tasks of the suite these settings, time few steps, and print 100 columns wide; in this process alone."""
    patch.setenv("COLUMNS", "100")
    patch.setattr(cost, "BLOCKS", blocks)
    for name, kwargs in settings.items():
        task = get_task(name)
        patch.setitem(catalogue.TASKS, name, dataclasses.replace(task, kwargs={**task.kwargs, **kwargs}, hold_s=HOLD_S))
