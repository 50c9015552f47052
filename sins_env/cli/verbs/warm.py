"""The verb ``warm``: compile the kernels beforehand."""

from __future__ import annotations

from argparse import Namespace

from rich.console import Console

from sins_env.cli.output import remark
from sins_env.evaluation.estimators import offers
from sins_env.kernels.compiling import Kernel, cache_folder
from sins_env.kernels.warming import compile_all, import_kernels


def warm(given: Namespace, console: Console) -> int:
    """Compile every kernel of this project that is not in the cache, and say where the cache is and how long it took."""
    packages = {"sins_env", *(offers.package_of(point) for point in offers.points()[0])}
    kernels = import_kernels(sorted(packages))
    waiting = [one for one in kernels if one.cold]

    def show(done: int, total: int, one: Kernel) -> None:
        remark(f"{done + 1} of {total}: {one.__module__}.{one.__qualname__}")

    seconds = compile_all(waiting, show)
    where = f"{len(kernels)} kernels in {cache_folder()}"
    console.print(
        f"{where}, {len(waiting)} of them compiled in {seconds:.1f} s of CPU time", soft_wrap=True, highlight=False
    )
    return 0
