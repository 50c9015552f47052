"""Files that appear whole or not at all: they are written under a temporary name beside their own, and renamed."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.figure import Figure


@contextmanager
def replacing(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Yield temporary names beside ``paths`` to write to. In the end all take their places, or none of them does.

    A device or a pipe, such as /dev/stdout, is written to directly. A link stays, and the file that it points to is replaced.
    A process that is killed leaves its temporary file, ``.NAME.PROCESS.part``, which the next one that writes NAME removes.

    Raises:
        OSError: files that cannot be written; the error is one line with the reason.
    """
    finals = [path.resolve() if path.is_symlink() else path for path in paths]
    for path in finals:
        if path.is_dir():  # said before the work, not after it
            raise IsADirectoryError(f"{path} cannot be written: it is a directory")
    plain = [not path.exists() or path.is_file() for path in finals]
    temporary = [
        path.with_name(f".{path.name}.{os.getpid()}.part") if whole else path
        for path, whole in zip(finals, plain, strict=True)
    ]
    renamed = [pair for pair, whole in zip(zip(temporary, finals, strict=True), plain, strict=True) if whole]
    for _, path in renamed:
        _clear(path)
    try:
        yield temporary
        for new, path in renamed:
            os.replace(new, path)
    except OSError as error:
        what = ", ".join(str(path) for path in paths)
        raise OSError(f"{what} cannot be written: {error.strerror or error}") from error
    finally:
        for new, _ in renamed:
            with suppress(OSError):
                new.unlink()


def _clear(path: Path) -> None:
    """Remove the temporary files beside ``path`` whose processes have ended."""
    for old in path.parent.glob(f".{glob.escape(path.name)}.*.part*"):  # that of SQLite has logs beside it
        if not _runs(old.suffixes[-2][1:]):
            with suppress(OSError):
                old.unlink()


def _runs(number: str) -> bool:
    """Return whether a process with this number runs, or may run."""
    if os.name != "posix" or not number.isdecimal():
        return True
    try:
        os.kill(int(number), 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def write_text(path: str | Path, text: str) -> None:
    """Write a text in UTF-8 to a file, whole or not at all.

    Raises:
        OSError: a file that cannot be written.
    """
    with replacing([Path(path)]) as (new,):
        new.write_text(text, encoding="utf-8")


def saved(figure: Figure, path: str | Path | None) -> Figure:
    """Return a figure; with a path it is written, in the format of the path's ending, whole or not at all.

    Raises:
        OSError, ValueError: a file that cannot be written, or an ending of no format.
    """
    if path is not None:
        with replacing([Path(path)]) as (new,):
            figure.savefig(new, dpi=150, format=Path(path).suffix.lstrip(".").lower())
    return figure
