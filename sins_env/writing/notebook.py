"""Progress in a notebook: one line of text in the output of the cell, which is replaced."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from datetime import timedelta
from typing import Any

EVERY_S = 0.25  #: least time from one text to the next, s


def in_notebook() -> bool:
    """Return whether this process is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell"


def line(label: str) -> Callable[..., None] | None:
    """Return a function that shows work done, its total and a note behind a label; None outside a notebook."""
    return _Line(label).update if in_notebook() else None


class _Line:
    def __init__(self, label: str) -> None:
        from IPython.display import display  # there in every notebook, and perhaps nowhere else

        self._label, self._began, self._shown_at = label, time.monotonic(), -math.inf
        self._handle: Any = display({"text/plain": label}, raw=True, display_id=True)

    def update(self, done: float | None = None, total: float | None = None, note: str = "") -> None:
        now = time.monotonic()
        if not done or not total or (now - self._shown_at < EVERY_S and done < total):
            return
        self._shown_at = now
        left = timedelta(seconds=int((now - self._began) * (total - done) / done))
        text = "  ".join(filter(None, (self._label, f"{100 * done / total:.0f}%", f"{left} left", note)))
        self._handle.update({"text/plain": text}, raw=True)
