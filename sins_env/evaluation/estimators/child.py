"""An object in a process of its own, whose methods are called through a pipe.

If it hangs or ends its process, the caller gets an :class:`EstimatorError` with one line.
"""

from __future__ import annotations

import math
import multiprocessing
import pickle
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from sins_env.evaluation.estimators.guard import EstimatorError
from sins_env.evaluation.estimators.processes import CANNOT_START, interrupts_held, prepare

START_S = 300.0  #: longest time in which a new process imports its modules, even on a busy machine
GRACE_S = 1.0  #: time that an answer may take beyond the limit to arrive, for the clock of the child decides
LOOK_S = 0.5  #: period of the check that a silent process still runs
#: exceptions of pickle for what cannot be sent to another process
UNSENDABLE = (pickle.PicklingError, AttributeError, TypeError)


class Child:
    """A process with an object that ``make``, a class at module level, makes there.

    The process starts with the first call, and again with the first call after it was lost.
    """

    def __init__(self, make: Callable[[], Any]) -> None:
        self.make = make
        self._process: SpawnProcess | None = None
        self._pipe: Connection | None = None

    @property
    def running(self) -> bool:
        """Whether the process runs, so that the object keeps its state from one call to the next."""
        return self._pipe is not None

    def call(self, name: str, limit_s: float, *arguments: Any) -> Any:
        """Call the object's method ``name`` and return its result.

        Raises:
            EstimatorError: the method raised an exception, took longer than the limit, or ended its process.
            ValueError: the method raised a ValueError.
            PicklingError, AttributeError, TypeError: an argument cannot be sent.
            RuntimeError: the process cannot start.
        """
        if self._pipe is None:
            self._start()
        return self._call(name, limit_s, *arguments)

    def close(self) -> None:
        """End the process, which starts again when it is needed."""
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
            self._process = context.Process(target=_serve, args=(there, self.make), daemon=True)
            self._process.start()
        there.close()
        try:
            self._call("", START_S)
        except EstimatorError as error:
            raise RuntimeError(CANNOT_START) from error

    def _call(self, name: str, limit_s: float, *arguments: Any) -> Any:
        assert self._pipe is not None
        try:
            self._pipe.send((name, arguments))
            self._wait(name, limit_s)
            kind, answer, trace, seconds = self._pipe.recv()
        except (EOFError, OSError):
            ended = self._end()
            error = EstimatorError(f"{name} ended its process ({ended})")
            error.ended = ended
            raise error from None
        if kind == "refused":
            raise ValueError(answer)
        if kind == "failed":
            error = EstimatorError(answer)
            error.trace = trace
            raise error
        if seconds > limit_s:
            raise EstimatorError(_too_long(name, limit_s))
        return answer

    def _wait(self, name: str, limit_s: float) -> None:
        """Wait for an answer; raise EOFError if the process has ended, even if others hold its pipe open."""
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
        """End the process if it still runs, and return how it ended, in words."""
        code = None
        if self._process is not None:
            self._process.join(GRACE_S)
            code = self._process.exitcode
        self.close()
        if code is None:
            return "its pipe is closed"
        return f"exit code {code}" if code >= 0 else f"signal {signal.Signals(-code).name}"


def _too_long(name: str, limit_s: float) -> str:
    return f"{name} took longer than {limit_s:g} s"


@contextmanager
def _children_allowed() -> Iterator[None]:
    """Allow children for the time of the context.

    The workers of Dask are daemons, which multiprocessing forbids to have children. Ours end with their parent anyway.
    """
    config = vars(multiprocessing.current_process()).get("_config", {})
    daemon = config.pop("daemon", None)
    try:
        yield
    finally:
        if daemon is not None:
            config["daemon"] = daemon


def _serve(pipe: Connection, make: Callable[[], Any]) -> None:
    """Serve in the other process: answer each call until the pipe is closed. A call without a name does nothing."""
    prepare()
    target = make()
    reply: tuple[str, Any, str, float]
    while True:
        answer, name, begin = None, "unpickling", math.nan
        try:
            name, arguments = pipe.recv()
            begin = time.perf_counter()
            answer = getattr(target, name)(*arguments) if name else None
            reply = ("done", answer, "", time.perf_counter() - begin)
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
