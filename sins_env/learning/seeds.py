"""Seeds of runs to learn from, which no suite can have, and the split to which each run belongs.

A suite gives an environment a seed below 2**64, whatever the seed of the suite is (:func:`.run_seed`). The seeds here have
128 bits, the highest of which is set. NumPy fills the four words of its pool from a seed one-to-one up to 128 bits. The
streams of such a run therefore begin in another pool than those of any run of a suite, be it public, hidden or yet to come.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sins_env import checks
from sins_env.evaluation.tasks.task import EvaluationTask, seed_name

__all__ = ["SPLITS", "split_of", "training_seed"]

SPLITS = ("train", "validation", "test")  #: names of the splits of a data set
DOMAIN = zlib.crc32(b"sins_env.learning")  #: first number of every spawn key here
HIGHEST = 1 << 127  #: the bit that no seed of a suite has
MOST_PARTS = 1000  #: most runs of a block, in which the splits have their exact shares


def check_seed(given: int) -> int:
    """Check the seed of a data set, a whole number from 0 to 1e15.

    Raises:
        ValueError: anything else.
    """
    return checks.whole("seed", given, "a whole number from 0 to 1e15", least=0)


def check_splits(given: Sequence[int]) -> tuple[int, ...]:
    """Check the parts of train, validation and test: whole numbers, such as (8, 1, 1).

    Raises:
        ValueError: anything else.
    """
    allowed = f"three whole numbers, train, validation and test, with a sum from 1 to {MOST_PARTS}, such as 8 1 1"
    parts = checks.numbers("splits", given, len(SPLITS), allowed, least=0.0, most=MOST_PARTS)
    if any(part % 1 for part in parts) or not 1 <= sum(parts) <= MOST_PARTS:
        raise checks.refused("splits", given, allowed)
    return tuple(int(part) for part in parts)


def _sequence(task: EvaluationTask, seed: int, *key: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(DOMAIN, zlib.crc32(seed_name(task).encode()), *key))


def training_seed(task: EvaluationTask, run: int, seed: int = 0) -> int:
    """Return the seed of the environment in a run to learn from: 2**127 or more, and below 2**128.

    It depends on the seed of the data set, the task's name and the run alone.
    """
    return apart(_sequence(task, seed, run).generate_state(2, np.uint64))


def apart(words: NDArray[np.unsignedinteger]) -> int:
    """Return the seed made of two random words, with the bit that no seed of a suite has."""
    return HIGHEST | int(words[0]) << 64 | int(words[1])


def split_of(task: EvaluationTask, runs: Sequence[int], seed: int, parts: Sequence[int]) -> NDArray[np.str_]:
    """Return the split of each run: "train", "validation" or "test".

    Every block of ``sum(parts)`` runs has these numbers of them, in an order that is drawn. The split of a run stays the
    same when more runs are made.
    """
    labels, orders = np.repeat(SPLITS, parts), dict[int, NDArray[np.str_]]()
    for block in {run // len(labels) for run in runs}:
        orders[block] = np.random.default_rng(_sequence(task, seed, 0, block)).permutation(labels)
    return np.array([orders[run // len(labels)][run % len(labels)] for run in runs])
