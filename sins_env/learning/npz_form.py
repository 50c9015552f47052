"""A data set as NPZ: an archive of NumPy arrays, written in bounded memory.

An archive holds one array after the other, and each batch adds to all of them. The batches therefore go to one nameless
file for each array, which the system removes whatever happens. In the end they are copied into the archive.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, NamedTuple
from zipfile import ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from sins_env.learning.drawing import Batch, Drawing
from sins_env.learning.facts import KINDS, STATES, about
from sins_env.learning.seeds import training_seed
from sins_env.reading.files import size
from sins_env.writing.files import replacing

ENDING = ".npz"


class Column(NamedTuple):
    """An array of the file that grows by batches of runs."""

    shape: tuple[int, ...]  #: shape for one run
    dtype: np.dtype[Any]

    def bytes(self, runs: int) -> int:
        """Return the bytes of so many runs."""
        return runs * int(np.prod(self.shape)) * self.dtype.itemsize


def columns(drawing: Drawing) -> dict[str, Column]:
    """Return the arrays that grow, by name."""
    K, real = drawing.public.num_epochs, np.dtype(float)
    found = {name: Column((K, *shape), dtype) for name, (shape, dtype) in drawing.fields.items()}
    for name, (count, _) in STATES.items():
        found[f"truth_{name}"] = Column((K, count), real)
    for kind in KINDS[1:]:
        found |= {f"{kind}_{name}": Column((count,), real) for name, (count, _) in STATES.items()}
    return found | {"start_known": Column((), np.dtype(bool))}


def values(batch: Batch) -> dict[str, NDArray[Any]]:
    """Return what a batch adds to each array, (runs, ...) by name."""
    states = zip(KINDS, (batch.truth, batch.began, batch.start), strict=True)
    named = {f"{kind}_{name}": part for kind, state in states for name, part in state._asdict().items()}
    return {**batch.measured, **named, "start_known": batch.known}


def write(
    path: Path,
    drawing: Drawing,
    runs: Sequence[int],
    batches: Iterable[Batch],
    labels: NDArray[np.str_],
    parts: Sequence[int],
) -> int:
    """Write the file, whole or not at all, and return its size in bytes.

    Raises:
        OSError: no such folder, no room, or a file that cannot be written.
    """
    there = columns(drawing)
    _check_room(path, [column.bytes(len(runs)) for column in there.values()])
    small = {
        "about": np.array(json.dumps(about(drawing, parts))),
        "run": np.array(runs, dtype=np.int64),
        "split": labels,
        "seed": np.array([f"{training_seed(drawing.task, run, drawing.seed):032x}" for run in runs]),
        "t": np.arange(1, drawing.public.num_epochs + 1) * drawing.public.epoch_s,
    }
    with replacing([path]) as (new,), ExitStack() as stack:
        spools = {name: stack.enter_context(tempfile.TemporaryFile(dir=path.parent)) for name in there}
        for batch in batches:
            for name, value in values(batch).items():
                spools[name].write(np.ascontiguousarray(value, there[name].dtype).data)
        with ZipFile(new, "w", ZIP_STORED) as archive:
            for name, array in small.items():
                with _member(archive, name) as file:
                    npy.write_array(file, array, allow_pickle=False)
            for name, column in there.items():
                with _member(archive, name) as file:
                    _copy(spools[name], file, column, len(runs))
        return new.stat().st_size


def _member(archive: ZipFile, name: str) -> IO[bytes]:
    """Open an array of the archive; without a date, so that the same data set is the same file."""
    return archive.open(ZipInfo(f"{name}.npy"), "w", force_zip64=True)


def _copy(spool: IO[bytes], file: IO[bytes], column: Column, runs: int) -> None:
    """Copy an array from its nameless file, which is then given back."""
    header = {"descr": npy.dtype_to_descr(column.dtype), "fortran_order": False, "shape": (runs, *column.shape)}
    npy.write_array_header_1_0(file, header)
    spool.seek(0)
    shutil.copyfileobj(spool, file, 1 << 20)
    spool.close()


def _check_room(path: Path, sizes: Sequence[int]) -> None:
    """Check that the folder is there and has room for the file, and for the largest array a second time.

    Raises:
        OSError: it is not there, or has no room.
    """
    if not path.resolve().parent.is_dir():
        raise FileNotFoundError(f"{path}: the directory does not exist")
    needed, free = sum(sizes) + max(sizes), shutil.disk_usage(path.resolve().parent).free
    if needed > free:
        raise OSError(
            f"{path}: {size(needed)} are needed while it is written, {size(free)} are free; allowed: fewer runs, or fewer samples"
        )
