"""Program that starts the processes of solvers, and keeps watch over each.

The starter is a fresh interpreter that knows nothing of an evaluation: no seed, no truth, no open file. It has imported what
every solver needs, so that a process forked from it starts in milliseconds. For each solver it forks a keeper, and that the
solver's process. The keeper passes on what the solver prints, tells how it ended, and ends everything that it has started.
"""

from __future__ import annotations

import os
import random
import resource
import select
import signal
import socket
import sys
import time
from contextlib import suppress
from typing import NoReturn

import numpy as np

from sins_env.evaluation.estimators import offers, serving
from sins_env.evaluation.estimators.memory import keep_freed_memory
from sins_env.evaluation.estimators.processes import control, keep_secrets
from sins_env.evaluation.estimators.wire import END, ENDED, STARTED, STOPPED
from sins_env.kernels.compiling import KERNELS
from sins_env.kernels.warming import compile_all
from sins_env.writing.visible import visible

MOST_OUTPUT = 16_384  #: most bytes of a solver's output that are passed on
CUT = b"\n(the solver's further output is left out)\n"
MOST_PROCESSES = 1024  #: most processes and threads that a solver starts, unless its user is root, whom nothing limits
END_S = 5.0  #: longest time in which everything that a solver has started is ended
_DEATH_SIGNAL, _SUBREAPER, _NO_NEW_PRIVILEGES = 1, 36, 38  # linux/prctl.h
_PIECE = 4096  # what a pipe that is ready takes at once


def main() -> NoReturn:
    """Fork a keeper for each message on standard input, a socket, which brings its files; end with that socket."""
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as score:  # as the next line, for all that it forks
        score.write("1000")  # the first to end if the machine has no memory left
    keep_secrets()  # no solver looks into, or writes to, what the next one is forked from
    messages = socket.socket(fileno=os.dup(0))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    control(_SUBREAPER, 1)
    offers.own()  # import what most solvers use
    compile_all([one for one in KERNELS if not one.cold])  # loads those that are compiled, once for all solvers
    keep_freed_memory()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # keepers need no burial
    os.dup2(1, 0)  # the null device, which not every user may open
    try:
        messages.sendall(STARTED)
    except OSError:  # the evaluation has ended meanwhile
        os._exit(0)
    os.dup2(1, 2)
    while True:
        message, files, _, _ = socket.recv_fds(messages, 1, 5)
        if not message:
            _end_children(None)
            os._exit(0)
        if message == STOPPED:
            _end_stopped()
        elif os.fork() == 0:
            messages.detach()
            _keep(*files)
        for file in files:
            os.close(file)


def _keep(told: int, requests: int, answers: int, memories: int, errors: int) -> NoReturn:
    """Keep a solver's process until it ends or the evaluation closes ``told``."""
    woken, wakes = os.pipe()
    output, prints = os.pipe()
    os.set_blocking(wakes, False)
    signal.set_wakeup_fd(wakes, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    control(_SUBREAPER, 1)
    keeper = os.getpid()
    pid = os.fork()
    if pid == 0:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        _become_solver(keeper, requests, answers, memories, prints)
    for file in (requests, answers, memories, prints):
        os.close(file)
    with suppress(OSError):
        os.write(told, END.pack(STARTED, pid))
    printed = 0
    while True:
        ready = select.select([told, output, woken], [], [])[0]
        if output in ready:
            printed = _pass_on(os.read(output, 65536), errors, printed)
        if told in ready:  # the evaluation wants no more, or has ended
            break
        if woken in ready:
            os.read(woken, 4096)
            status = _buried(pid)
            if status is not None:
                with suppress(OSError):
                    os.write(told, END.pack(ENDED, status))
                break
    with suppress(OSError):
        while select.select([output], [], [], 0)[0] and printed < MOST_OUTPUT and (last := os.read(output, 65536)):
            printed = _pass_on(last, errors, printed)
        os.killpg(pid, signal.SIGKILL)
    _end_children(pid)
    os._exit(0)


def _buried(pid: int) -> int | None:
    """Bury the dead; return the exit code of ``pid``, or minus the signal that ended it, if it is among them."""
    found = None
    with suppress(ChildProcessError):
        while (dead := os.waitpid(-1, os.WNOHANG))[0]:
            if dead[0] == pid:
                found = os.waitstatus_to_exitcode(dead[1])
    return found


def _pass_on(text: bytes, errors: int, printed: int) -> int:
    """Write output of a solver to standard error, up to MOST_OUTPUT, with control characters made visible."""
    if printed >= MOST_OUTPUT:
        return printed
    kept = text[: MOST_OUTPUT - printed].decode("utf-8", "replace")
    left = visible(kept, keep="\n\t").encode("utf-8", "replace") + (CUT if printed + len(text) >= MOST_OUTPUT else b"")
    while left and select.select([], [errors], [], 0)[1]:  # a reader that waits does not hold up the keeper
        with suppress(OSError):
            os.write(errors, left[:_PIECE])
        left = left[_PIECE:]
    return printed + len(text)


def _children() -> list[int]:
    with open(f"/proc/self/task/{os.getpid()}/children") as file:
        return [int(child) for child in file.read().split()]


def _descendants() -> set[int]:
    """Return all processes below this one."""
    found: set[int] = set()
    left = [os.getpid()]
    while left:
        process = left.pop()
        with suppress(OSError):  # it has just ended
            for task in os.listdir(f"/proc/{process}/task"):
                with open(f"/proc/{process}/task/{task}/children") as file:
                    left += (new := {int(child) for child in file.read().split()} - found)
                    found |= new
    return found


def _signal(processes: set[int], number: signal.Signals) -> None:
    for process in processes:
        with suppress(OSError):
            os.kill(process, number)


def _end_stopped() -> None:
    """End the keepers that are stopped, which only a solver does; what they keep ends with them."""
    for child in _children():
        with suppress(OSError), open(f"/proc/{child}/stat") as file:
            if file.read().rpartition(")")[2].split()[0] in "Tt":
                os.kill(child, signal.SIGKILL)


def _end_children(pid: int | None) -> None:
    """End all children of this process, and theirs, who become children of this process when their parent ends."""
    deadline = time.monotonic() + END_S
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    while time.monotonic() < deadline:
        found: set[int] = set()
        while (new := _descendants() - found) and time.monotonic() < deadline:
            found |= new
            _signal(new, signal.SIGSTOP)  # who is stopped starts no more
        _signal(found or ({pid} if pid else found), signal.SIGKILL)
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        time.sleep(0.001)


def _processes() -> int:
    """Return the number of processes and threads of this user, all of which the kernel's limit counts."""
    user, found = os.getuid(), 0
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            with suppress(OSError):  # it has just ended
                found += os.stat(f"{entry.path}/task").st_nlink - 2 if entry.stat().st_uid == user else 0
    return found


def _limit(what: int, most: int) -> None:
    """Lower a limit of this process for good."""
    hard = resource.getrlimit(what)[1]
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(what, (most, most))


def _become_solver(keeper: int, requests: int, answers: int, memories: int, prints: int) -> NoReturn:
    """Make this process one that a stranger may have: nothing open, its own session, limits; then serve."""
    control(_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != keeper:
        os._exit(1)
    control(_NO_NEW_PRIVILEGES, 1)
    os.setsid()
    for file in (1, 2):
        os.dup2(prints, file)
    for file in map(int, os.listdir("/proc/self/fd")):
        if file not in (0, 1, 2, requests, answers, memories):
            with suppress(OSError):
                os.close(file)
    sys.stdout = os.fdopen(1, "w", 1, "utf-8", "backslashreplace", closefd=False)
    sys.stderr = os.fdopen(2, "w", 1, "utf-8", "backslashreplace", closefd=False)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _limit(resource.RLIMIT_NPROC, _processes() + MOST_PROCESSES)
    random.seed()
    np.random.seed()  # noqa: NPY002
    try:
        serving.serve(requests, answers, memories)
    except OSError:  # the solver has closed a pipe
        os._exit(1)
    os._exit(0)


if __name__ == "__main__":
    main()
