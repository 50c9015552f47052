"""The loop that serves calls in the process of a solver: an object is made there, and its methods are called by name."""

from __future__ import annotations

import importlib
import os
import pickle
import resource
import sys
import time
from collections.abc import Callable, Mapping
from multiprocessing import spawn
from typing import Any

from sins_env.evaluation.estimators.guard import EstimatorError, error_of
from sins_env.evaluation.estimators.processes import THREADS
from sins_env.evaluation.estimators.wire import BEAT, DONE, FAILED, REFUSED, REQUEST, Answer, packed

BEAT_S = 0.2  #: least time between two beats
_MOST_AT_ONCE = 4096
_NOTHING = Answer()

_beat: Callable[[], None] = lambda: None  # noqa: E731


def beat() -> None:
    """Tell the evaluation, from within a long call, that one call of the solver has ended; elsewhere it does nothing."""
    _beat()


def serve(requests: int, answers: int, memories: int) -> None:
    """Answer calls, which come and go through two pipes, until the evaluation closes the first.

    A call is the name of a method and its arguments; it returns an :class:`Answer` or None. The first names the class of the
    object, and what to take over from the evaluation. The object is made with the descriptor of the socket through which
    shared memory comes.
    """
    global _beat
    process, target, last = os.getpid(), None, 0.0
    number = 0

    def tell_beat() -> None:
        nonlocal last
        if time.monotonic() > last + BEAT_S:
            last = time.monotonic()
            _write(answers, packed(number, BEAT, _NOTHING))

    _beat = tell_beat
    name = ""
    arguments: tuple[Any, ...] = ()
    while request := os.read(requests, _MOST_AT_ONCE):  # most come as one piece
        number, size = REQUEST.unpack_from(request)
        while missing := REQUEST.size + size - len(request):
            if not (more := os.read(requests, missing)):  # the evaluation has ended
                return
            request += more
        kind, answer = DONE, _NOTHING
        try:
            if size:  # otherwise the last call comes once more
                name = "unpickling"
                name, arguments = pickle.loads(memoryview(request)[REQUEST.size :])
            if target is None:
                target = _begin(memories, *arguments)
            else:
                answer = getattr(target, name)(*arguments) or _NOTHING
        except EstimatorError as error:
            kind, answer = FAILED, Answer(error.raised, str(error), error.text)
        except ValueError as error:
            kind, answer = REFUSED, Answer(0, str(error))
        except BaseException as error:  # Ctrl-C of its own making, too
            raised = error_of(name, error)
            kind, answer = FAILED, Answer(raised.raised, str(raised), raised.text)
        if os.getpid() != process:  # the solver has forked, and here is the other one
            os._exit(0)
        _write(answers, packed(number, kind, answer))


def _write(file: int, message: bytes) -> None:
    while message:
        message = message[os.write(file, message) :]


def _begin(memories: int, target: str, around: Mapping[str, Any]) -> Any:
    """Take over search path, folder, environment and limits, and return the object whose methods are called."""
    os.environ.clear()
    os.environ.update(around["environ"], **THREADS)
    sys.path[:] = around["path"]
    os.chdir(around["folder"])
    importlib.invalidate_caches()
    if around["bytes"]:
        resource.setrlimit(resource.RLIMIT_AS, (around["bytes"], around["bytes"]))
    if around["main"]:
        spawn.prepare(around["main"])
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)(memories)
