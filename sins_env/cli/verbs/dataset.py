"""The verb ``dataset``: runs to learn from, in a file."""

from __future__ import annotations

from argparse import Namespace

from rich.console import Console

from sins_env.evaluation.play.progress import Bar
from sins_env.learning import dataset as learning


def dataset(given: Namespace, console: Console) -> int:
    """Write a data set, and print what was written.

    Raises:
        ValueError, OSError: as :func:`sins_env.dataset`, or Minari is not installed.
    """
    with Bar(f"data set of {given.task}") as bar:
        try:
            done = learning.dataset(
                given.task,
                given.runs,
                given.out,
                seed=given.seed,
                samples=given.samples,
                splits=given.splits,
                progress=bar.update,
            )
        except ImportError as error:
            raise ValueError(str(error)) from error
    print(done)
    return 0
