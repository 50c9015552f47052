"""Output that the verbs share: the error of a failed run, remarks on standard error, and figures as files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from sins_env.writing.files import saved
from sins_env.writing.visible import LAYOUT, visible


class RunFailed(Exception):
    """Error of a command that was used rightly but whose run failed, in one line."""


MOST_SAID = 4096  #: most characters of a message on standard error


def remark(text: str) -> None:
    """Print a remark on standard error as one line; what does not print is shown as an escape."""
    print(visible(text, keep="\xa0"), file=sys.stderr)


def say(message: str) -> None:
    """Print a message of the command as one line on standard error; a very long one is cut."""
    line = visible(" ".join(message.split()), keep=LAYOUT)
    print(f"sins-env: {line if len(line) <= MOST_SAID else line[:MOST_SAID] + ' ...'}", file=sys.stderr)


def check_plot(path: str | None, option: str = "--plot") -> None:
    """Check before the work begins that a figure can be written to ``path``.

    Raises:
        ValueError: a format that Matplotlib does not write, or a directory that does not exist.
    """
    if path is None:
        return
    from matplotlib.backend_bases import FigureCanvasBase  # slow to import

    allowed = FigureCanvasBase.get_supported_filetypes()
    ending = Path(path).suffix.lstrip(".").lower()
    if ending not in allowed:
        endings = ", ".join(f".{name}" for name in sorted(allowed))
        raise ValueError(f"{option} {path}; allowed: a file that ends in {endings}")
    if not Path(path).resolve().parent.is_dir():
        raise ValueError(f"{option} {path}: the directory does not exist")


def save_figure(figure: Any, path: str | Path) -> None:
    """Write a figure in the format of the path's ending, and print a remark."""
    saved(figure, path)
    remark(f"figure: {path}")
