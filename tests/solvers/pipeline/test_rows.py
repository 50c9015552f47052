"""A row of a batch has the bits of the run alone: every solver, in alignment and in flight."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import solvers
from sins_env.evaluation import get_task

RUNS, ROW = 3, 2
TASKS = {"sway-white-v0": 8, "flight-hotstart90-v0": 8}  # and the number of epochs


@cache
def recorded(name):
    """Return the public task of three runs, and the observations of its first epochs; actions change nothing of them."""
    task = get_task(name)
    env = task.make(RUNS)
    obs, _ = task.reset(env, range(RUNS))
    told, seen = env.unwrapped.task, []
    action = np.eye(1, 10 if told.navigate else 4).repeat(RUNS, axis=0)
    for _ in range(TASKS[name]):
        seen.append({key: value.copy() for key, value in obs.items()})
        obs = env.step(action)[0]
    return told, seen


def answers(solver, told, rng, runs, seen):
    solver.reset(told, rng, runs)
    return [solver.step(obs) for obs in seen]


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("name", [name for name in solvers.names() if solvers.make(name).batched])
def test_a_row_is_the_run_alone(name, task):
    told, seen = recorded(task)
    try:
        whole = answers(solvers.make(name), told, [np.random.default_rng(i) for i in range(RUNS)], RUNS, seen)
    except ValueError as error:
        if "gives the attitude alone" not in str(error):
            raise
        pytest.skip(str(error))
    start = None if told.start is None else type(told.start)(*(part[ROW] for part in told.start))
    rows = [{key: value[ROW] for key, value in obs.items()} for obs in seen]
    alone = answers(solvers.make(name), replace(told, start=start), np.random.default_rng(ROW), 1, rows)
    for many, one in zip(whole, alone, strict=True):
        np.testing.assert_array_equal(many[ROW], one)
