"""Hosts of an estimator: the process of the caller, or a process of its own.

A solver of this project plays in the process of the caller. So does a class or function that the caller has imported and
hands over. A solver that is named as another package's, or as ``module:Factory``, is a stranger's: it has a process of its
own, with a time limit for each call. That process gets observations and the public Task, and nothing else. Whatever the
solver does there costs its own runs only. docs/contest.md tells what this promises.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, Protocol

import numpy as np

from sins_env import types
from sins_env.arrays import Array, Obs
from sins_env.evaluation.estimators import finding, wire
from sins_env.evaluation.estimators.child import UNSENDABLE, Child
from sins_env.evaluation.estimators.guard import (
    Clock,
    EstimatorError,
    Guard,
    Guarded,
    Health,
    Refusal,
    Unavailable,
    checked_health,
    line,
)
from sins_env.evaluation.estimators.wire import Answer, Layout
from sins_env.kernels.warming import ready
from sins_env.states import answered

PATIENCE = 3  #: runs in succession that take too long, after which the others of a job are not played


class Limits(NamedTuple):
    """Longest times of a call, s."""

    call_s: float = 10.0
    first_s: float = 60.0  #: first call of each method in a batch, which may compile
    make_s: float = 60.0  #: imports and constructor together


def check_timeout(seconds: float | None) -> None:
    """Check a time limit; infinity means a process of its own without a limit.

    Raises:
        ValueError: not a positive number.
    """
    real = seconds is None or (isinstance(seconds, (int, float, np.number)) and not isinstance(seconds, bool))
    if not real or (seconds is not None and not seconds > 0):
        raise ValueError(f"epoch_timeout_s = {seconds!r}; allowed: a positive number of seconds, or None")


def limits(solver: finding.Solver, timeout_s: float | None = None) -> Limits | None:
    """Return the time limits of a solver's calls for ``epoch_timeout_s``; None for one that plays in the caller's process.

    This is the one place that decides where a solver plays. A given limit holds for any solver and for every call, and
    infinity is no limit. Without it a solver of another package has the usual limits, and others play with the caller.

    Raises:
        ValueError: a limit that is not positive.
    """
    check_timeout(timeout_s)
    if timeout_s is not None:
        return Limits(timeout_s, timeout_s, max(timeout_s, Limits().make_s))
    return Limits() if finding.is_foreign(solver) else None


def child_of(solver: finding.Solver, target: str) -> Child:
    """Return a process for a solver with an object of the class ``target``, ``module:name``; a script may define the solver."""
    return Child(target, getattr(solver, "__module__", "") == "__main__")


class Host(Protocol):
    """A solver ready to play, in whichever process it is."""

    solver: finding.Solver
    settings: dict[str, Any]
    batched: bool

    def renew(self) -> None:
        """Make a new estimator, because the state of the old one is unknown after an error.

        Raises:
            ValueError: settings that it refuses, or a solver that cannot be sent to another process.
            Unavailable: the estimator in its own process cannot be made.
        """
        ...

    def guard(self, num_runs: int, clock: Clock = time.perf_counter) -> Guarded:
        """Return the estimator for so many runs, timed by the clock.

        Raises:
            Unavailable: the estimator in its own process cannot be made, or has been given up.
        """
        ...

    def smoother(self, num_runs: int) -> Guard:
        """Return the estimator's smoother for so many runs, which answers as it does and has ``smoothed()`` afterwards.

        Raises:
            Refusal: it has none, or plays in a process of its own.
        """
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

    def smoother(self, num_runs: int) -> Guard:
        made = getattr(self.estimator, "smoother", None)
        if made is None:
            raise _not_smoothed(self.solver, "has no smoother")
        try:
            return Guard(made(), num_runs)
        except ValueError as error:
            raise _not_smoothed(self.solver, f"cannot be smoothed: {line(error)}") from error

    def close(self) -> None:
        pass


class Isolated:
    """A solver in a process of its own, which starts again after it was lost."""

    def __init__(self, solver: finding.Solver, settings: Mapping[str, Any] | None, limits: Limits) -> None:
        self.solver, self.settings, self.limits = solver, dict(settings or {}), limits
        self.child = child_of(solver, f"{__name__}:Served")
        self.late = 0  #: number of runs in succession that took too long
        self.renew()

    def renew(self) -> None:
        name = finding.solver_name(self.solver)
        try:
            self.batched = bool(self.child.call("make", self.limits.make_s, self.solver, self.settings).value)
        except (ValueError, *UNSENDABLE) as error:
            self.close()
            said = str(error) if isinstance(error, ValueError) else f"solver {name!r} cannot be sent: {error}"
            raise Refusal(said) from error
        except EstimatorError as error:
            self.close()
            found = Unavailable(f"solver {name!r} cannot be made: {error}")
            found.trace = error.text
            raise found from error

    def guard(self, num_runs: int, clock: Clock = time.perf_counter) -> IsolatedGuard:
        if self.late >= PATIENCE:
            raise Unavailable(f"not played: the {PATIENCE} runs before it took too long")
        if not self.child.running:
            self.renew()
        self.child.call("guard", self.limits.call_s, num_runs, clock)
        return IsolatedGuard(self, num_runs, clock)

    def smoother(self, num_runs: int) -> Guard:
        raise _not_smoothed(self.solver, "plays in a process of its own, in which nothing is smoothed")

    def close(self) -> None:
        self.child.close()


def _not_smoothed(solver: finding.Solver, why: str) -> Refusal:
    allowed = "a filter with one Gaussian that predicts by a moment rule, such as inekf, ekf or ckf"
    return Refusal(f"solver {finding.solver_name(solver)!r} {why}; allowed: {allowed}")


@contextmanager
def hosted(
    solver: finding.Solver, settings: Mapping[str, Any] | None, timeout_s: float | None = None
) -> Iterator[Host]:
    """Yield the solver in this process or in one of its own, as :func:`limits` decides, which ends with the context.

    Kernels are compiled before, because time spent on it is not the solver's.

    Raises:
        ValueError: no such solver, settings that it refuses, or a limit that is not positive.
        Unavailable: it cannot be made in a process of its own, where it ends the process, say.
    """
    found = limits(solver, timeout_s)
    host: Host = Here(solver, settings) if found is None else Isolated(solver, settings, found)
    ready()
    try:
        yield host
    finally:
        host.close()


def prove(solver: finding.Solver, settings: Mapping[str, Any] | None, timeout_s: float | None = None) -> None:
    """Make a solver once, so that wrong use is refused before anything runs.

    A stranger that cannot be made for another reason, because it ends its process, say, is left to its runs, which fail.

    Raises:
        ValueError: no such solver, settings that it refuses, or a limit that is not positive.
    """
    try:
        with hosted(solver, settings, timeout_s):
            pass
    except Refusal:
        raise
    except Unavailable:
        return


class IsolatedGuard:
    """A :class:`Guard` whose estimator is in another process.

    Its time is that from a request to its answer by the clock of this process, because the solver may change its own. With
    ``time.process_time`` it is the CPU time of both processes together, that of the solver's by the kernel's clock.
    """

    def __init__(self, host: Isolated, num_runs: int, clock: Clock) -> None:
        self.host, self.num_runs, self.clock = host, num_runs, clock
        self.child = host.child
        self.seconds, self.told_s, self.steps = 0.0, 0.0, 0
        #: Time of all steps but the estimator's own, which its process tells: true of own solvers only.
        self.way_s = 0.0
        self.navigate = False
        self._now = self._of_both if clock is time.process_time else clock
        self._called: set[str] = set()
        self._obs: list[tuple[str, Any]] = []
        self._answers: dict[str, Any] = {}

    def _ask(self, name: str, *arguments: Any) -> Answer:
        limit_s = self.host.limits.call_s
        if name not in self._called:
            self._called.add(name)
            limit_s = self.host.limits.first_s
        try:
            return self.child.call(name, limit_s, *arguments)
        except ValueError as error:  # Guard has none
            raise EstimatorError(f"{name} failed: {error}") from error
        except EstimatorError as error:
            if self.num_runs == 1:
                self.host.late = self.host.late + 1 if error.late else 0
            raise

    def _of_both(self) -> float:
        return self.clock() + self.child.cpu_s()

    def reset(self, task: types.Task, rngs: Sequence[np.random.Generator]) -> None:
        self.navigate = task.navigate
        self._ask("reset", task, rngs)

    def _share(self, obs: Obs) -> None:
        layout = layout_of(obs, self.num_runs, self.navigate)
        found = self.child.share(layout)
        self._ask("share", layout)
        self._obs = [(name, found[name]) for name in obs]
        self._answers = {name: found[name] for name in found if name not in obs}

    def step(self, obs: Obs) -> Array:
        if not self._answers:
            self._share(obs)
        for name, array in self._obs:
            array[...] = obs[name]
        begin = self._now()
        told = self._ask("step")
        seconds = self._now() - begin
        self.seconds += seconds
        self.told_s += told.value * 1e-9
        self.steps += 1
        return np.array(self._answers["action"])

    def covariance(self) -> Array | None:
        return np.array(self._answers["covariance"]) if self._ask("covariance").value else None

    def diagnostics(self) -> dict[str, Array]:
        """Return nothing: only answers whose shapes are known beforehand come from another process."""
        return {}

    def health(self) -> Health:
        self._ask("health")
        health = checked_health(*np.array(self._answers["health"]))
        self.host.late = 0
        return health


def layout_of(obs: Obs, num_runs: int, navigate: bool) -> Layout:
    """Return the arrays that both ends share: an observation, and the answers to it."""
    n = answered(navigate).size
    return (
        *((name, value.dtype.str, value.shape) for name, value in obs.items()),
        ("action", "<f8", (num_runs, 10 if navigate else 4)),
        ("covariance", "<f8", (num_runs, n, n)),
        ("health", "<i8", (3, num_runs)),
    )


class Served:
    """Other end of :class:`Isolated`: the estimator and its guard, in the process of their own."""

    def __init__(self, memories: int) -> None:
        self._memories = memories

    def make(self, solver: finding.Solver, settings: Mapping[str, Any]) -> Answer:
        self._estimator = finding.make(solver, settings)
        return Answer(bool(self._estimator.batched))

    def guard(self, num_runs: int, clock: Clock) -> None:
        self._guard = Guard(self._estimator, num_runs, clock=clock)

    def reset(self, task: types.Task, rngs: Sequence[np.random.Generator]) -> None:
        self._guard.reset(task, rngs)

    def share(self, layout: Layout) -> None:
        arrays = wire.received(self._memories, layout)
        self._answers = {name: arrays.pop(name) for name in ("action", "covariance", "health")}
        self._obs = arrays

    def step(self) -> Answer:
        """Take a step, and return its time in ns."""
        before = self._guard.seconds
        self._answers["action"][...] = self._guard.step({name: array.copy() for name, array in self._obs.items()})
        return Answer(round((self._guard.seconds - before) * 1e9))

    def covariance(self) -> Answer:
        P = self._guard.covariance()
        if P is not None:
            self._answers["covariance"][...] = P
        return Answer(P is not None)

    def health(self) -> None:
        self._answers["health"][...] = self._guard.health()
