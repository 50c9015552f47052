"""Hosts of an estimator: the process of the caller, or a process of its own.

In a process of its own, an estimator that hangs or ends the process costs a failed run and no more. The caller, which may be
this process, a worker, a thread or a Dask worker, talks to it through a pipe. Observations go there, actions come back, and
its time is taken there.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np

from sins_env import types
from sins_env.arrays import Array, Obs
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.child import START_S, UNSENDABLE, Child
from sins_env.evaluation.estimators.guard import Clock, EstimatorError, Guard, Guarded, Health
from sins_env.kernels.warming import ready


def check_timeout(seconds: float | None) -> None:
    """Check a time limit; infinity means a process of its own without a limit.

    Raises:
        ValueError: not a positive number.
    """
    real = seconds is None or (isinstance(seconds, (int, float, np.number)) and not isinstance(seconds, bool))
    if not real or (seconds is not None and not seconds > 0):
        raise ValueError(f"epoch_timeout_s = {seconds!r}; allowed: a positive number of seconds, or None")


def limit(solver: finding.Solver, timeout_s: float | None = None) -> float | None:
    """Return the time limit of a call for ``epoch_timeout_s``: None for a solver that plays in the caller's process.

    This is the one place that decides where a solver plays. A solver with a time limit has a process of its own. A solver
    of another package has one, too, without a limit, because it may do anything to its process. An unknown name has none.
    """
    named = isinstance(solver, str) and ":" not in solver
    foreign = not named or finding.is_foreign(str(solver))
    return math.inf if timeout_s is None and foreign else timeout_s


class Host(Protocol):
    """A solver ready to play, in whichever process it is."""

    solver: finding.Solver
    settings: dict[str, Any]
    batched: bool

    def renew(self) -> None:
        """Make a new estimator, because the state of the old one is unknown after an error.

        Raises:
            ValueError: settings that it refuses, or a solver that cannot be sent to another process.
        """
        ...

    def guard(self, num_runs: int, clock: Clock = time.perf_counter) -> Guarded:
        """Return the estimator for so many runs, timed by the clock."""
        ...

    def close(self) -> None:
        """End its process, if it has one of its own."""
        ...


class Here:
    """A solver in this process."""

    def __init__(self, solver: finding.Solver, settings: Mapping[str, Any] | None = None) -> None:
        self.solver, self.settings = solver, dict(settings or {})
        self.renew()

    def renew(self) -> None:
        self.estimator = finding.make(self.solver, self.settings)
        self.batched = bool(self.estimator.batched)

    def guard(self, num_runs: int, clock: Clock = time.perf_counter) -> Guard:
        return Guard(self.estimator, num_runs, clock=clock)

    def close(self) -> None:
        pass


class Isolated:
    """A solver in a process of its own, which starts again after it was lost."""

    def __init__(self, solver: finding.Solver, settings: Mapping[str, Any] | None, timeout_s: float) -> None:
        check_timeout(timeout_s)
        self.solver, self.settings, self.timeout_s = solver, dict(settings or {}), timeout_s
        self.child = Child(_Estimator)
        self.renew()

    def renew(self) -> None:
        try:
            self.batched = bool(self.child.call("make", START_S, self.solver, self.settings))
        except (EstimatorError, *UNSENDABLE) as error:
            self.close()
            name = finding.solver_name(self.solver)
            raise ValueError(f"solver {name!r} cannot be made in a process of its own: {error}") from error

    def guard(self, num_runs: int, clock: Clock = time.perf_counter) -> IsolatedGuard:
        if not self.child.running:
            self.renew()
        self.child.call("guard", START_S, num_runs, clock)
        return IsolatedGuard(self.child, self.timeout_s, num_runs, clock)

    def close(self) -> None:
        self.child.close()


@contextmanager
def hosted(solver: finding.Solver, settings: Mapping[str, Any] | None, timeout_s: float | None) -> Iterator[Host]:
    """Yield the solver in this process or, with a time limit, in one of its own, which ends with the context.

    Kernels are compiled before, because time spent on it is not the solver's.

    Raises:
        ValueError: no such solver, settings that it refuses, or a limit that is not positive.
    """
    host: Host = Here(solver, settings) if timeout_s is None else Isolated(solver, settings, timeout_s)
    ready()
    try:
        yield host
    finally:
        host.close()


class IsolatedGuard:
    """A :class:`Guard` whose estimator is in another process."""

    def __init__(self, child: Child, timeout_s: float, num_runs: int, clock: Clock) -> None:
        self.child, self.timeout_s, self.num_runs, self.clock = child, timeout_s, num_runs, clock
        self.seconds, self.steps = 0.0, 0

    def _ask(self, name: str, *arguments: Any) -> Any:
        return self.child.call(name, self.timeout_s, *arguments)

    def reset(self, task: types.Task, rngs: Sequence[np.random.Generator]) -> None:
        self._ask("reset", task, rngs)

    def step(self, obs: Obs) -> Array:
        action, seconds = self._ask("step", obs)
        self.seconds += seconds
        self.steps += 1
        return np.asarray(action)

    def covariance(self) -> Array | None:
        P: Array | None = self._ask("covariance")
        return P

    def health(self) -> Health:
        found: Health = self._ask("health")
        return found


class _Estimator:
    """Other end of :class:`Isolated`: the estimator and its guard, in the process of their own."""

    def make(self, solver: finding.Solver, settings: Mapping[str, Any]) -> bool:
        self._estimator = finding.make(solver, settings)
        return bool(self._estimator.batched)

    def guard(self, num_runs: int, clock: Clock) -> None:
        self._guard = Guard(self._estimator, num_runs, clock=clock)

    def reset(self, task: types.Task, rngs: Sequence[np.random.Generator]) -> None:
        self._guard.reset(task, rngs)

    def step(self, obs: Obs) -> tuple[Array, float]:
        """Return the action, and the time of the step by the guard's clock."""
        before = self._guard.seconds
        return self._guard.step(obs), self._guard.seconds - before

    def covariance(self) -> Array | None:
        return self._guard.covariance()

    def health(self) -> Health:
        return self._guard.health()
