"""What the verbs share: a failed run, remarks on standard error, tables, and figures as files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any


class RunFailed(Exception):
    """What was asked for ran and failed, in one line."""


def remark(text: str) -> None:
    print(text, file=sys.stderr)


def check_plot(path: str | None, option: str = "--plot") -> None:
    """Refuse a figure that could not be written before the work is done.

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
    """Write a figure (the ending of the file's name is its format) and say so."""
    figure.savefig(path, dpi=150)
    remark(f"figure: {path}")
