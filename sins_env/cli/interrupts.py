"""Ctrl-C while packages are imported. A KeyboardInterrupt there may become another error, or show a page of traceback."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

INTERRUPTED = 130  #: exit code after Ctrl-C


@contextmanager
def quiet() -> Iterator[None]:
    """End the process with one line if Ctrl-C comes in the context, in which nothing may have begun that must be ended.

    Another handler of Ctrl-C than Python's own stays, and so does that of a thread.
    """
    own = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not own or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, _leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(*_: Any) -> None:
    os.write(2, b"sins-env: interrupted\n")
    os._exit(INTERRUPTED)
