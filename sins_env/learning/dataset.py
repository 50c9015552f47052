"""Data sets for supervised learning: observations and truth of simulated runs that no suite can hold.

docs/learning.md has the arrays with their shapes and units, and how to read them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sins_env import checks
from sins_env.evaluation.play.queue import Report
from sins_env.evaluation.tasks.catalogue import Given, get_task
from sins_env.evaluation.tasks.task import run_numbers
from sins_env.learning import minari_form, npz_form
from sins_env.learning.drawing import Drawing
from sins_env.learning.seeds import SPLITS, check_seed, check_splits, split_of
from sins_env.reading.files import size
from sins_env.writing import notebook

MOST_RUNS = 1_000_000  #: most runs of a data set, and the first number that no run has
MINARI = "minari:"  #: what stands before the id of a Minari dataset


@dataclass(frozen=True)
class Written:
    """What was written: where it is, its size in bytes, the number of epochs of a run, and of runs by split."""

    out: str
    bytes: int
    epochs: int
    splits: dict[str, int]

    def __str__(self) -> str:
        parts = ", ".join(f"{count} {name}" for name, count in self.splits.items())
        return f"{self.out}: {size(self.bytes)}, {sum(self.splits.values())} runs ({parts}) of {self.epochs} epochs"


def dataset(
    task: Given,
    runs: int | Iterable[int],
    out: str | os.PathLike[str],
    *,
    seed: int = 0,
    samples: int | None = None,
    splits: Sequence[int] = (8, 1, 1),
    chunk: int | None = None,
    progress: Report | None = None,
) -> Written:
    """Write observations, truth, told starts and splits of simulated runs to a file, in bounded memory.

    The arrays are those of docs/learning.md, such as ``dtheta`` (N, K, samples, 3) rad and ``truth_q_nb`` (N, K, 4), for N runs
    of K epochs. The file appears whole or not at all. The same arguments give the same bits, whatever ``chunk`` is.

    Args:
        task: a simulated task: its name, the file or dict of a scenario, or the task itself.
        runs: number of runs, or their numbers from 0 on. More runs leave the bits and splits of the first ones as they are.
        out: a file that ends in ``.npz``, or ``minari:ID`` for a local dataset of Minari (extra ``minari``).
        seed: seed of the data set, 0 to 1e15. No run of any suite has the seed of any run here (:mod:`.seeds`).
        samples: increments of an epoch, each the sum of neighbours; None keeps all of the task (30 on a swaying base).
        splits: parts of train, validation and test. Each block of their sum has exactly these numbers of runs.
        chunk: runs per batch; by default as many as fit into 64 MB.
        progress: function called with the simulated seconds done and with their total. Without one a notebook shows them.

    Raises:
        ValueError: an unknown task, one that plays a recording, or a value that is not allowed.
        OSError: a file of the scenario that is not there, a file that cannot be written, or no room for it.
        ImportError: Minari is not installed.
    """
    found = get_task(task)
    drawing = Drawing(found, check_seed(seed), samples)
    wanted, parts = _numbers(runs), check_splits(splits)
    rows = None if chunk is None else checks.whole("chunk", chunk, least=1)
    labels = split_of(found, wanted, drawing.seed, parts)
    told = progress or notebook.line(f"data set of {found.name}")
    total = len(wanted) * drawing.public.num_epochs

    def tell(done: float) -> None:
        if told:
            told(done * drawing.public.epoch_s, total * drawing.public.epoch_s)

    where = os.fspath(out)
    batches = drawing.batches(wanted, rows, tell)
    if where.startswith(MINARI):
        count = minari_form.write(where.removeprefix(MINARI), drawing, batches, labels, parts)
    elif where.lower().endswith(npz_form.ENDING):
        count = npz_form.write(Path(where), drawing, wanted, batches, labels, parts)
    else:
        raise checks.refused(
            "out", where, f"a file that ends in {npz_form.ENDING}, or {MINARI}ID such as {MINARI}sins/sway-v0"
        )
    return Written(where, count, drawing.public.num_epochs, {name: int((labels == name).sum()) for name in SPLITS})


def _numbers(runs: int | Iterable[int]) -> list[int]:
    """Return the numbers of the runs.

    Raises:
        ValueError: anything but whole numbers, or too large ones.
    """
    allowed = f"1 to {MOST_RUNS} runs, or numbers of runs below {MOST_RUNS}; another seed gives others"
    if not isinstance(runs, Iterable):
        return run_numbers(checks.whole("runs", runs, allowed, least=1, most=MOST_RUNS))
    numbers = run_numbers(runs)
    if numbers[-1] >= MOST_RUNS:
        raise checks.refused("runs", numbers[-1], allowed)
    return numbers
