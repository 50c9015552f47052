"""Setup that all spawned processes share: Ctrl-C goes to the parent, BLAS has one thread, and they end with the parent."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sins_env.evaluation.estimators.memory import keep_freed_memory

CANNOT_START = (
    "worker processes cannot start; a script must call evaluate() under if __name__ == '__main__': (or pass workers=1)"
)

#: Settings of the number of threads of BLAS, which is one, for the environment of a new process.
THREADS = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "BLIS_NUM_THREADS"), "1")


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold back Ctrl-C until the context ends; processes that start meanwhile never see it, for they inherit the mask."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_DUMPABLE = 4  # linux/prctl.h


def control(option: int, value: int) -> None:
    """Set an option of this process by ``prctl``, which Linux has."""
    libc = ctypes.CDLL(None)
    if hasattr(libc, "prctl"):
        libc.prctl(option, value, 0, 0, 0)


def keep_secrets() -> None:
    """Keep other processes of the same user from the memory of this one, which holds the seed of a hidden suite, say.

    Linux does this; a process of root can read it in any case.
    """
    control(_DUMPABLE, 0)


def prepare() -> None:
    """Set up a new process: it ignores Ctrl-C, uses one BLAS thread, and ends when its parent does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1)
    keep_freed_memory()
    threading.Thread(target=_die_with_parent, daemon=True).start()


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
