"""Output that the verbs share: the error of a failed run, remarks on standard error, and figures as files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any


class RunFailed(Exception):
    """Error of a command that was used rightly but whose run failed, in one line."""


def remark(text: str) -> None:
    """Print a remark on standard error."""
    print(text, file=sys.stderr)


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
    figure.savefig(path, dpi=150)
    remark(f"figure: {path}")
