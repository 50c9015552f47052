"""Tasks cut short for the tests; ``SHORT`` is 20 s of sway, told start, hold 5 s."""

import dataclasses

from sins_env.evaluation.tasks.catalogue import get_task


def lasting(name, seconds, /, **changes):
    """A task of the catalogue, cut short after its coarse phase, held for a quarter of that at most."""
    task = get_task(name)
    hold = min(task.hold_s, seconds / 4)
    return dataclasses.replace(task, kwargs={**task.kwargs, "duration": seconds}, hold_s=hold, **changes)


SHORT = lasting("sway-white-v0", 20.0, name="short-v0", what="short")
