"""An object in a process of its own, whose methods are called through two pipes.

If it hangs, ends its process or answers what is no answer, the caller gets an :class:`EstimatorError` with one line. Nothing
that comes from there is unpickled or evaluated.
"""

from __future__ import annotations

import atexit
import math
import os
import pickle
import select
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from io import FileIO
from multiprocessing import spawn
from typing import Any

from numpy.typing import NDArray

from sins_env.evaluation.estimators import wire
from sins_env.evaluation.estimators.guard import EstimatorError, Unavailable
from sins_env.evaluation.estimators.processes import CANNOT_START, THREADS, interrupts_held
from sins_env.evaluation.estimators.wire import Answer, Layout

START_S = 300.0  #: longest time in which the first interpreter imports its modules, even on a busy machine
LOOK_S = 0.1  #: period of the check that a silent process still runs and has time left
FORK_S = 30.0  #: longest time in which a keeper forks a process, even on a busy machine
GRACE_S = 1.0  #: time in which the keeper of a process tells how it ended, or an interpreter may be stopped
END_S = 10.0  #: time in which the keeper ends a process, and whatever that has started
#: exceptions of pickle for what cannot be sent to another process
UNSENDABLE = (pickle.PicklingError, AttributeError, TypeError)
#: Setting: a command that runs the interpreter of solvers, such as "runuser -u guest --".
PREFIX = "SINS_ENV_SOLVER_PREFIX"
MEMORY = "SINS_ENV_SOLVER_MEMORY_GB"  #: setting: most address space of a solver's process; "inf" is no limit
#: Program of the interpreter of solvers, whose standard input is the socket. First it keeps its memory from other solvers.
_KEEPER = """
import ctypes
getattr(ctypes.CDLL(None), "prctl", print)(4, 0, 0, 0, 0)
try:
    from sins_env.evaluation.estimators.keeper import main
    main()
except Exception as error:
    import os
    os.write(0, f"{type(error).__name__}: {error}"[:1000].encode("utf-8", "replace"))
    raise SystemExit(1)
"""
_NO_SUCH_SYSTEM = "a solver of another package has a process of its own, which needs Linux"


class _Starter:
    """The interpreter that forks the processes of solvers for this process; see :mod:`keeper`."""

    def __init__(self) -> None:
        self.owner, self.prefix = os.getpid(), os.environ.get(PREFIX, "")
        self._socket, there = socket.socketpair()
        command = [
            *shlex.split(self.prefix),
            sys.executable,
            "-c",
            f"import sys; sys.path[:] = {sys.path!r}{_KEEPER}",
        ]
        with interrupts_held(), there:
            self.process = subprocess.Popen(
                command,
                stdin=there.fileno(),
                stdout=subprocess.DEVNULL,
                env={**os.environ, **THREADS},
                start_new_session=True,
            )
        atexit.register(self.close)
        told = self._beginning()
        if told != wire.STARTED:
            why = " ".join(told.decode("utf-8", "replace").split())
            prefix = f"{PREFIX}={self.prefix!r} does not run {sys.executable}" if self.prefix else CANNOT_START
            raise RuntimeError(f"the process that starts solvers cannot start: {why}" if why else prefix)

    def _beginning(self) -> bytes:
        """Return what the interpreter tells of its start: one byte, or the line that tells why it cannot."""
        told, deadline = b"", time.monotonic() + START_S
        self._socket.settimeout(GRACE_S)
        while told != wire.STARTED and time.monotonic() < deadline:
            try:
                if not (more := self._socket.recv(wire.MAX_TEXT)):
                    break
                told += more
            except TimeoutError:
                self._wake()
        self._socket.settimeout(START_S)
        return told

    @property
    def usable(self) -> bool:
        """Whether it is of this process and its settings, and still runs."""
        mine = self.owner == os.getpid() and self.prefix == os.environ.get(PREFIX, "")
        return mine and self.process.poll() is None

    def start(self, *files: int) -> None:
        """Start a process with these open files: what the keeper tells, requests, answers, shared memory, standard error."""
        self._wake()
        socket.send_fds(self._socket, [wire.STARTED], files)

    def end_stopped(self) -> None:
        """End keepers that do not run because a solver has stopped them."""
        self._wake()
        self._socket.sendall(wire.STOPPED)

    def _wake(self) -> None:
        """Have the interpreter go on if a solver has stopped it."""
        with suppress(OSError):  # another user's: a start that takes too long ends it
            self.process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        """End the interpreter, and with it all that it has started."""
        self._wake()
        self._socket.close()
        atexit.unregister(self.close)
        if self.owner == os.getpid():
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(END_S)
                return
            with suppress(OSError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()


_starter: _Starter | None = None
_starting = threading.Lock()


def _start(*files: int) -> None:
    """Start a process with these open files, by the starter of this process, which starts itself if it does not run."""
    global _starter
    with _starting:
        for _ in range(2):  # it may end between the look and the message
            if _starter is None or not _starter.usable:
                if _starter is not None:
                    _starter.close()
                _starter = _Starter()
            with suppress(OSError):
                return _starter.start(*files)
    raise RuntimeError(CANNOT_START)


def _drop() -> None:
    """End the starter of this process; the next start brings another."""
    global _starter
    with _starting:
        if _starter is not None:
            _starter.close()
        _starter = None


class Child:
    """A process with an object of the class ``target``, given as ``module:name``, that is made there.

    The process starts with the first call, and again with the first call after it was lost.

    Args:
        target: class of the object, which is made with the descriptor of the socket that shared memory comes through.
        script: whether the process needs the script of this one, for a solver that it defines.
    """

    def __init__(self, target: str, script: bool = False) -> None:
        self.target, self.script = target, script
        self._requests: FileIO | None = None
        self._answers: FileIO | None = None
        self._told: socket.socket | None = None  # what its keeper tells
        self._memories: socket.socket | None = None  # the way of shared memory to the process
        self._pid = 0
        self._number = 0
        self._last = ""  # name of the last call if that had no arguments

    @property
    def running(self) -> bool:
        """Whether the process runs, so that the object keeps its state from one call to the next."""
        return self._answers is not None

    def cpu_s(self) -> float:
        """Return the CPU time of the process by the kernel's clock, s.

        Raises:
            EstimatorError: the process has ended.
        """
        try:
            # the clock of another process, as clock_getcpuclockid has it
            return time.clock_gettime((~self._pid << 3) | 2)
        except OSError as error:
            raise EstimatorError("its process has ended") from error

    def share(self, layout: Layout) -> dict[str, NDArray[Any]]:
        """Return arrays in new memory, which is on its way to the process; there :func:`wire.received` takes it."""
        if not self.running:
            self._begin()
        assert self._memories is not None
        memory = wire.new_memory(layout)
        try:
            with suppress(OSError):  # the process has ended, or takes none: the next call tells it
                socket.send_fds(self._memories, [b"m"], [memory])
            return wire.shared(memory, layout)
        finally:
            os.close(memory)

    def call(self, name: str, limit_s: float, *arguments: Any, beats: int = 0) -> Answer:
        """Call the object's method ``name`` and return its answer.

        The limit begins anew with each of at most so many ``beats``, which tell that the call goes on.

        Raises:
            EstimatorError: the method raised an exception, took longer than the limit, or ended its process.
            ValueError: the method raised a ValueError.
            PicklingError, AttributeError, TypeError: an argument cannot be sent.
            RuntimeError: the process cannot start.
        """
        if self._answers is None:
            self._begin()
        again = name == self._last and not arguments
        request = b"" if again else pickle.dumps((name, arguments))
        self._last = "" if arguments else name
        self._number = (self._number + 1) % (1 << 32)
        deadline = time.monotonic() + limit_s
        try:
            self._send(wire.REQUEST.pack(self._number, len(request)) + request, deadline)
            kind, answer = self._answer(deadline)
            while kind == wire.BEAT:
                if not beats:
                    raise _Garbage
                beats -= 1
                deadline = time.monotonic() + limit_s
                kind, answer = self._answer(deadline)
            if time.monotonic() > deadline:
                raise TimeoutError
        except TimeoutError:
            self.close()
            error = EstimatorError(f"{name} took longer than {limit_s:g} s")
            error.late = True
            raise error from None
        except (EOFError, OSError):
            ended = self._end()
            error = EstimatorError(f"{name} ended its process ({ended})")
            error.ended = ended
            raise error from None
        except _Garbage:
            self.close()
            raise EstimatorError(f"{name}: its process answered what is no answer") from None
        except BaseException:  # Ctrl-C: an answer may be on its way, which is not that of the next call
            self.close()
            raise
        if kind == wire.REFUSED:
            raise ValueError(answer.first)
        if kind == wire.FAILED:
            error = EstimatorError(answer.first)
            error.trace, error.raised = answer.second, bool(answer.value)
            raise error
        return answer

    def close(self) -> None:
        """End the process and whatever it has started; it starts again when it is needed."""
        if self._told is not None:
            with suppress(OSError):
                self._told.shutdown(socket.SHUT_WR)
                self._until_kept_no_more()
            self._told.close()
        for way in (self._requests, self._answers, self._memories):
            if way is not None:
                way.close()
        self._requests = self._answers = self._told = self._memories = None

    def _until_kept_no_more(self) -> None:
        """Wait until the keeper has ended. If that takes long, the solver may have stopped it, and it is ended."""
        assert self._told is not None
        for limit_s in (GRACE_S, END_S):
            self._told.settimeout(limit_s)
            try:
                while self._told.recv(64):
                    pass
                return
            except TimeoutError:
                if _starter is not None and _starter.usable:
                    _starter.end_stopped()

    def _begin(self) -> None:
        if not hasattr(os, "memfd_create"):
            raise ValueError(_NO_SUCH_SYSTEM)
        try:
            try:
                self._fork()
            except TimeoutError:  # a solver may have stopped the starter for good
                self.close()
                _drop()
                self._fork()
        except (OSError, EOFError) as error:
            self.close()
            raise Unavailable(f"its process cannot start: {error}") from error
        except BaseException:
            self.close()
            raise
        try:
            self._last = ""
            self.call("begin", START_S, self.target, _around(self.script))
        except (EstimatorError, OSError, EOFError) as error:
            self.close()
            raise Unavailable(f"its process cannot start: {error}") from error

    def _fork(self) -> None:
        """Have the starter fork the process.

        Raises:
            TimeoutError: it does not.
            RuntimeError: the starter cannot start.
        """
        requests, self._requests = _pipe()
        self._answers, answers = _pipe()
        self._told, told = socket.socketpair()
        self._memories, memories = socket.socketpair()
        self._memories.setblocking(False)
        for way in (self._requests, self._answers):
            os.set_blocking(way.fileno(), False)
        self._ready = select.poll()
        self._ready.register(self._answers, select.POLLIN)
        with requests, answers, told, memories:
            errors = os.dup(2)
            try:
                _start(told.fileno(), requests.fileno(), answers.fileno(), memories.fileno(), errors)
            finally:
                os.close(errors)
        self._told.settimeout(FORK_S)
        _, self._pid = wire.END.unpack(wire.exactly(self._told, wire.END.size))

    def _answer(self, deadline: float) -> tuple[int, Answer]:
        """Receive an answer.

        Raises:
            TimeoutError: none came in time.
            EOFError, OSError: the process has ended, even if others hold its pipe open.
            _Garbage: what came is no answer to this call.
        """
        number, kind, value, first, second = wire.ANSWER.unpack(self._received(wire.ANSWER.size, deadline))
        if number != self._number or kind > wire.BEAT or max(first, second) > wire.MAX_TEXT:
            raise _Garbage
        if not first + second:
            return kind, Answer(value)
        texts = [self._received(length, deadline).decode("utf-8", "replace") for length in (first, second)]
        return kind, Answer(value, " ".join(texts[0].split()), texts[1])

    def _send(self, message: bytes, deadline: float) -> None:
        assert self._requests is not None
        while (sent := self._requests.write(message)) != len(message):
            message = message[sent or 0 :]
            if not sent:
                select.select([], [self._requests], [], LOOK_S)
            self._check(deadline)

    def _received(self, size: int, deadline: float) -> bytes:
        assert self._answers is not None
        found = b""
        while len(found) < size:
            if self._ready.poll(LOOK_S * 1e3):
                more = self._answers.read(size - len(found))
                if more == b"":
                    raise EOFError
                found += more or b""
            if len(found) < size:
                self._check(deadline)
        return found

    def _check(self, deadline: float) -> None:
        """Check, whenever a message has not passed as a whole, that the process still runs and has time left.

        Raises:
            TimeoutError: it has not.
            EOFError: it does not.
        """
        if time.monotonic() > deadline:
            raise TimeoutError
        assert self._told is not None
        if select.select([self._told], [], [], 0)[0]:
            raise EOFError

    def _end(self) -> str:
        """End the process if it still runs, and return how it ended, in words."""
        code = None
        if self._told is not None:
            with suppress(OSError, EOFError):
                self._told.settimeout(GRACE_S)
                _, code = wire.END.unpack(wire.exactly(self._told, wire.END.size))
        self.close()
        if code is None:
            return "its pipe is closed"
        if code >= 0:
            return f"exit code {code}"
        known = -code in {one.value for one in signal.Signals}
        return f"signal {signal.Signals(-code).name if known else -code}"


class _Garbage(Exception):
    """Answer that is none."""


def _pipe() -> tuple[FileIO, FileIO]:
    """Return the ends of a new pipe, the one to read from and the one to write to."""
    ends = os.pipe()
    return FileIO(ends[0], "r"), FileIO(ends[1], "w")


def _around(script: bool) -> Mapping[str, Any]:
    """Return what a solver's process takes over from this one, with neither its arguments nor its keys."""
    main = spawn.get_preparation_data("solver") if script else {}
    return {
        "path": [os.getcwd() if part == "" else part for part in sys.path],
        "folder": os.getcwd(),
        "environ": dict(os.environ),
        "main": {name: value for name, value in main.items() if name.startswith("init_main_")},
        "bytes": _most_memory(),
    }


def _most_memory() -> int:
    """Return the most address space of a solver's process in bytes: that of the setting, or half of the machine's memory.

    Raises:
        ValueError: a setting that is not a positive number.
    """
    given = os.environ.get(MEMORY, "")
    if not given:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
    try:
        most = float(given)
    except ValueError:
        most = math.nan
    if not most > 0:
        raise ValueError(f"{MEMORY}={given!r}; allowed: a positive number of gigabytes, or inf for no limit")
    return 0 if most == math.inf else int(most * 1e9)
