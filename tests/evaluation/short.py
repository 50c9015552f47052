"""A task cut short for the tests: ``SHORT`` is 20 s of sway, told start, hold 5 s."""

import dataclasses

from sins_env.evaluation.tasks.catalogue import get_task

_WHITE = get_task("sway-white-v0")
SHORT = dataclasses.replace(
    _WHITE, name="short-v0", what="short", kwargs={**_WHITE.kwargs, "duration": 20.0}, hold_s=5.0
)
