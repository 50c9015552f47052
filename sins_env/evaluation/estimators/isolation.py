"""An estimator in a process of its own: it may hang or end its process, and that is a failed run like any other.

Whoever plays the runs (this process, a worker, a thread, a Dask worker) talks to it through a pipe. Only the estimator
is apart: observations go there, actions come back, and its time is taken there.
"""

from __future__ import annotations

import math
import multiprocessing
import pickle
import signal
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import types
from sins_env.arrays import Array
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.guard import EstimatorError, Guard
from sins_env.evaluation.estimators.processes import CANNOT_START, interrupts_held, prepare

START_S = 300.0  #: a new process imports the solver and makes it in this time, on however busy a machine
GRACE_S = 1.0  #: what an answer may take on its way; the estimator's own clock decides
LOOK_S = 0.5  #: how often a silent process is looked after


def check_timeout(seconds: float | None) -> None:
    """Raises ValueError for what is no time; infinity is a process of its own without a limit."""
    real = seconds is None or (isinstance(seconds, (int, float, np.number)) and not isinstance(seconds, bool))
    if not real or (seconds is not None and not seconds > 0):
        raise ValueError(f"epoch_timeout_s = {seconds!r}; allowed: a positive number of seconds, or None")


class Isolated:
    """A solver in a process of its own, which begins when it is first needed, and anew after it was lost."""

    def __init__(self, solver: finding.Solver, settings: Mapping[str, Any], timeout_s: float) -> None:
        check_timeout(timeout_s)
        self.solver, self.settings, self.timeout_s = solver, dict(settings), timeout_s
        self._process: SpawnProcess | None = None
        self._pipe: Connection | None = None
        self.batched = bool(self.renew())

    def renew(self) -> bool:
        """Make the estimator afresh; whether it is batched.

        Raises:
            ValueError: it refuses its settings, or cannot be sent to another process.
        """
        if self._pipe is None:
            self._start()
        try:
            return bool(self.call("make", START_S, self.solver, self.settings)[0])
        except (EstimatorError, pickle.PicklingError, AttributeError, TypeError) as error:
            name = finding.solver_name(self.solver)
            raise ValueError(f"solver {name!r} cannot be made in a process of its own: {error}") from error

    def guard(self, num_runs: int) -> IsolatedGuard:
        if self._pipe is None:
            self.renew()
        self.call("guard", START_S, num_runs)
        return IsolatedGuard(self, num_runs)

    def call(self, name: str, limit_s: float, *arguments: Any) -> tuple[Any, float]:
        """The answer, and the seconds that it took there.

        Raises:
            EstimatorError: it raised, took longer than the limit, or its process ended.
            ValueError: it refuses its settings.
        """
        assert self._pipe is not None
        try:
            self._pipe.send((name, arguments))
            self._wait(name, limit_s)
            kind, answer, trace, seconds = self._pipe.recv()
        except (EOFError, OSError):
            raise EstimatorError(f"{name} ended its process ({self._end()})") from None
        if kind == "refused":
            raise ValueError(answer)
        if kind == "failed":
            error = EstimatorError(answer)
            error.trace = trace
            raise error
        if seconds > limit_s:
            raise EstimatorError(_too_long(name, limit_s))
        return answer, seconds

    def close(self) -> None:
        """End the process; it is begun again when it is needed."""
        if self._pipe is not None:
            self._pipe.close()  # to one that waits: the end
        if self._process is not None:
            self._process.join(1.0)
            self._process.kill()
            self._process.join()
        self._process = self._pipe = None

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        with interrupts_held(), _children_allowed():
            self._process = context.Process(target=_serve, args=(there,), daemon=True)
            self._process.start()
        there.close()
        try:
            self.call("ready", START_S)
        except EstimatorError as error:
            raise RuntimeError(CANNOT_START) from error

    def _wait(self, name: str, limit_s: float) -> None:
        """Until there is an answer. A process that has ended raises EOFError, even if others hold its pipe open."""
        assert self._pipe is not None
        assert self._process is not None
        deadline = time.monotonic() + limit_s + GRACE_S
        while not self._pipe.poll(min(LOOK_S, max(deadline - time.monotonic(), 0.0))):
            if not self._process.is_alive() and not self._pipe.poll():
                raise EOFError
            if time.monotonic() > deadline:
                self._process.kill()
                self.close()
                raise EstimatorError(_too_long(name, limit_s))

    def _end(self) -> str:
        """How the process ended, in words."""
        code = None
        if self._process is not None:
            self._process.join(GRACE_S)
            code = self._process.exitcode
        self.close()
        if code is None:
            return "its pipe is closed"
        return f"exit code {code}" if code >= 0 else f"signal {signal.Signals(-code).name}"


class IsolatedGuard:
    """A :class:`Guard` whose estimator is in another process."""

    def __init__(self, host: Isolated, num_runs: int) -> None:
        self.host, self.num_runs, self.batched = host, num_runs, host.batched
        self.seconds, self.steps = 0.0, 0

    def _ask(self, name: str, *arguments: Any) -> tuple[Any, float]:
        return self.host.call(name, self.host.timeout_s, *arguments)

    def reset(self, task: types.Task, rngs: Sequence[np.random.Generator]) -> None:
        self._ask("reset", task, rngs)

    def step(self, obs: Any) -> Array:
        action, seconds = self._ask("step", obs)
        self.seconds += seconds
        self.steps += 1
        return np.asarray(action)

    def covariance(self) -> Array | None:
        P: Array | None = self._ask("covariance")[0]
        return P

    def health(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        repairs, fallbacks, frozen = self._ask("health")[0]
        return repairs, fallbacks, frozen


def _too_long(name: str, limit_s: float) -> str:
    return f"{name} took longer than {limit_s:g} s"


@contextmanager
def _children_allowed() -> Iterator[None]:
    """Dask's workers are daemons, which multiprocessing forbids to have children; ours end with their parent."""
    config = vars(multiprocessing.current_process()).get("_config", {})
    daemon = config.pop("daemon", None)
    try:
        yield
    finally:
        if daemon is not None:
            config["daemon"] = daemon


def _serve(pipe: Connection) -> None:
    """The other process: one answer to each question, until the pipe is closed."""
    prepare()
    estimator: Any = None
    guard: Guard | None = None
    reply: tuple[str, Any, str, float]
    while True:
        seconds, answer, name = 0.0, None, "make"
        try:
            name, arguments = pipe.recv()
            if name == "make":
                estimator = finding.make(*arguments)
                answer = bool(estimator.batched)
            elif name == "guard":
                guard = Guard(estimator, *arguments)
            elif name != "ready":
                begin, before = time.perf_counter(), guard.seconds if guard else 0.0
                answer = getattr(guard, name)(*arguments)
                seconds = guard.seconds - before if guard and name == "step" else time.perf_counter() - begin
            reply = ("done", answer, "", seconds)
        except EOFError:
            return
        except EstimatorError as error:
            reply = ("failed", str(error), error.text, math.nan)
        except ValueError as error:
            reply = ("refused", str(error), "", math.nan)
        except BaseException as error:  # Ctrl-C of its own making, too
            raised = EstimatorError(f"{name} raised {type(error).__name__}: {' '.join(str(error).split())}")
            raised.__cause__ = error
            reply = ("failed", str(raised), raised.text, math.nan)
        try:
            pipe.send(reply)
        except OSError:  # nobody is waiting any more
            sys.exit()
