"""Compilation beforehand: one process compiles what others will need, and says so."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from sins_env.kernels.compiling import KERNELS, Kernel

#: Function called with the number of kernels done, their number, and the one that is next.
Progress = Callable[[int, int, Kernel], None]


def cold() -> list[Kernel]:
    """Return the kernels of the modules imported so far that are yet to be compiled."""
    return [one for one in KERNELS if one.cold]


def ready() -> None:
    """Compile the kernels that are cold, with a line on a terminal; workers that start afterwards find them compiled."""
    waiting = cold()
    if waiting:
        compile_all(waiting, _line if sys.stderr.isatty() else None)


def compile_all(which: list[Kernel], progress: Progress | None = None) -> float:
    """Compile kernels, or load them, one after the other; return the CPU time, s."""
    begin = time.process_time()
    for i, one in enumerate(which):
        if progress:
            progress(i, len(which), one)
        _ = one.ufunc
    return time.process_time() - begin


def import_kernels(packages: Iterable[str]) -> list[Kernel]:
    """Import the modules of packages that have kernels, and return all kernels."""
    for package in packages:
        for module in _modules(package):
            importlib.import_module(module)
    return list(KERNELS)


def _modules(package: str) -> Iterator[str]:
    """Yield the names of the modules of a package that import the decorator."""
    spec = importlib.util.find_spec(package)
    for folder in (spec and spec.submodule_search_locations) or ():
        for path in sorted(Path(folder).rglob("*.py")):
            if "sins_env.kernels import" not in path.read_text(encoding="utf-8"):
                continue
            parts = path.relative_to(folder).with_suffix("").parts
            yield ".".join((package, *(parts[:-1] if parts[-1] == "__init__" else parts)))


def _line(done: int, total: int, one: Kernel) -> None:
    text = f"compiling kernels, once: {done + 1} of {total}"
    print(f"\r{text}", end="\r\033[K" if done + 1 == total else "", file=sys.stderr, flush=True)
