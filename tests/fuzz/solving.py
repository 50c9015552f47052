"""Settings of solvers, and answers of solvers of others through the guard."""

import dataclasses
import math
from functools import cache, partial
from typing import Any

import gymnasium
import numpy as np
from hypothesis import strategies as st

import solvers
from fuzz.kind import kind
from fuzz.outcome import Failed, attempt
from fuzz.values import Code, junk, numbers, play
from sins_env.evaluation.estimators.guard import EstimatorError, Guard
from sins_env.evaluation.play import playing
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask

NAMES = solvers.names()


def given_to(name: str) -> Any:
    known = [p.name for p in solvers.settings(name)] + ["xx"]
    some = st.dictionaries(st.sampled_from(known), junk | numbers, min_size=1, max_size=2)
    return st.tuples(st.just(name), some)


@cache
def observed() -> tuple[Any, list[Any]]:
    """Return a public task with its first observations."""
    env: Any = gymnasium.make("SINS/AlignSway-v0", duration=3.0).unwrapped
    observations = [env.reset(seed=0)[0], *(env.step([1.0, 0, 0, 0])[0] for _ in range(2))]
    return env.task, observations  # the task of the reset, which has the told start


def steps(name: str, given: dict[str, Any]) -> None:
    task, observations = observed()
    estimator = solvers.make(name, **given)
    estimator.reset(task, np.random.default_rng(0), 1)
    for obs in observations:
        estimator.step(obs)


@cache
def warm(name: str) -> None:
    """Compile or load what a solver needs, which is not the time of any setting."""
    steps(name, {})


def all_warm() -> None:
    for name in NAMES:
        warm(name)


@kind("solver settings", st.sampled_from(NAMES).flatmap(given_to), share=6, slice=30, prepare=all_warm)
def solver_settings(example: Any) -> str:
    name, given = play(example)
    warm(name)
    return attempt(lambda: steps(name, given))


def lasting(name: str, seconds: float, **changes: Any) -> EvaluationTask:
    """Return a task of the catalogue, cut short."""
    task = get_task(name)
    hold = min(task.hold_s, seconds / 4)
    return dataclasses.replace(task, kwargs={**task.kwargs, "duration": seconds}, hold_s=hold, **changes)


TASKS = {"align": lasting("sway-white-v0", 1.5), "navigate": lasting("flight-lu-gauss-v0", 1.5, score_from_s=0)}
ERRORS = [
    Code(text)
    for text in (
        "RuntimeError('x')", "KeyError('k')", "StopIteration()", "GeneratorExit()", "MemoryError()",
        "RecursionError()", "SystemExit(3)", "AssertionError()", "UnicodeDecodeError('a', b'', 0, 1, 'x')",
        "ExceptionGroup('g', [ValueError()])", "ZeroDivisionError('')",
        "type('E', (Exception,), {'__str__': lambda _: 1 / 0})()", "ValueError('x' * 10**6)",
        "OSError(2, 'gone', 'x')", "np.linalg.LinAlgError('s')", "RuntimeError('\\x1b[31m\\n\\udc80')",
    )
]  # fmt: skip
answer = (
    junk
    | st.lists(st.floats(), min_size=4, max_size=4)
    | st.lists(st.floats(), min_size=10, max_size=10)
    | st.lists(st.lists(st.floats(), min_size=4, max_size=4), min_size=2, max_size=2)
)
matrices = junk | st.tuples(st.sampled_from([1e-300, 1e300, -1.0, 0.0, math.nan, 1e-6, math.inf]), st.booleans())
answers = st.tuples(
    st.sampled_from(sorted(TASKS)),
    st.sampled_from([True, True, True, False, 1, None, "x"]),
    st.dictionaries(st.integers(0, 16), answer | st.sampled_from(ERRORS), max_size=3),
    st.none() | matrices,
    st.none() | st.tuples(junk, junk, junk) | junk,
)


class Answering:
    """An estimator that answers as an example says, and otherwise well."""

    def __init__(self, example: Any, navigate: bool) -> None:
        _, self.batched, self.said, self.matrix, self.told = play(example)
        self.navigate = navigate
        if self.matrix is None:
            self.covariance = property()
        if self.told is None:
            self.health = property()

    def __getattribute__(self, name: str) -> Any:
        value = object.__getattribute__(self, name)
        if isinstance(value, property):
            raise AttributeError(name)
        return value

    def _answer(self, usual: Any) -> Any:
        value = self.said.get(self.k, usual)
        if isinstance(value, BaseException):
            raise value
        return value

    def reset(self, task: Any, rng: Any, num_runs: int = 1) -> None:
        self.k, self.runs = 0, num_runs
        self._answer(None)

    def step(self, obs: Any) -> Any:
        self.k += 1
        shape = (self.runs, 10 if self.navigate else 4) if self.batched else (10 if self.navigate else 4,)
        good = np.zeros(shape)
        good[..., 0] = 1.0
        return self._answer(good)

    def covariance(self) -> Any:
        if not isinstance(self.matrix, tuple):
            return self.matrix
        size, whole = self.matrix
        n = 9 if self.navigate else 3
        return np.broadcast_to(
            np.where(np.eye(n, dtype=bool), size, 0.0), (self.runs, n, n) if whole and self.batched else (n, n)
        )

    def health(self) -> Any:
        if not isinstance(self.told, tuple):
            return self.told
        return type("H", (), dict(zip(("repairs", "fallbacks", "failed_at"), self.told, strict=True)))()


class Host:
    """A host of one such estimator in this process."""

    solver, settings = "answering", {}

    def __init__(self, make: Any) -> None:
        self.make = make
        self.renew()

    def renew(self) -> None:
        self.estimator = self.make()
        self.batched = bool(self.estimator.batched)

    def guard(self, num_runs: int, clock: Any = None) -> Guard:
        return Guard(self.estimator, num_runs)

    def close(self) -> None:
        pass


@kind("answers of solvers", answers, share=5, slice=40)
def answers_of_solvers(example: Any) -> str:
    task = TASKS[example[0]]
    host = Host(partial(Answering, example, example[0] == "navigate"))

    def go() -> None:
        for runs in ((0, 1), (0,)) if host.batched else ((0,),):
            host.renew()
            try:
                records = playing.play(Job(task, "answering", runs), host)
            except EstimatorError as error:
                if len(runs) == 1:
                    raise
                if len(str(error)) > 3000 or "\n" in str(error):
                    raise Failed("EstimatorError of several lines or too long", str(error)[:300]) from error
                continue
            for name in ("t_conv", "steady_rms", "final"):
                if np.isnan(getattr(records, name)).any():
                    raise Failed(f"{name} is NaN")
            if any(len(text) > 3000 or "\n" in text for text in records.reason):
                raise Failed("a reason of several lines or too long", max(records.reason, key=len)[:300])

    return attempt(go)
