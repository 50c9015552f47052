"""Judging: a bundle is checked, and what it claims stands beside what the same solver does on a hidden suite.

Nothing of a bundle is imported. Its rows are read as those of any results file, and the board in it must follow from them. The two
suites have different runs, so the interval of the ratio of their scores is that of two independent samples.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table
from rich.text import Text

from sins_env.checks import unknown
from sins_env.evaluation.contest import bundle
from sins_env.evaluation.contest.bundle import BOARD, RESULTS, SUBMISSION, Submission
from sins_env.evaluation.estimators import version
from sins_env.evaluation.score import exact, losses
from sins_env.evaluation.score.losses import Root
from sins_env.evaluation.score.resampling import NO_INTERVAL, TAILS, Estimate
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.numbers import number_text
from sins_env.evaluation.show.plain_tables import as_json, as_markdown
from sins_env.evaluation.show.rich_tables import titled
from sins_env.evaluation.speed.cost import YARDSTICK
from sins_env.evaluation.store.key import canonical
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import TASKS
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import suite_hash
from sins_env.reading.documents import parse_json
from sins_env.units import DEG
from sins_env.writing.visible import visible

CLOSE = 1e-6  #: relative difference of a number of the board from what the rows give


class Side(NamedTuple):
    """What a solver has done on one suite of a task."""

    runs: int
    failed: Estimate  #: share of failed runs
    score: Root  #: root of the mean loss, in rad, m or m/s

    @classmethod
    def of(cls, one: Results) -> Side:
        """Score the runs of a solver."""
        lost = one.entry.failed
        (score,) = losses.scores(losses.capped(one.entry.error, one.measure.cap)[:, None])
        return cls(len(lost), exact.share(int(lost.sum()), len(lost)), score)


class Pair(NamedTuple):
    """A task on which a solver has played the public and the hidden suite."""

    task: str
    unit: tuple[float, str]  #: size of the unit of its scores in SI, and its name
    public: Side
    hidden: Side

    @property
    def ratio(self) -> Estimate:
        """Hidden score over the public one, with its 95 % interval."""
        return ratio_apart(self.hidden.score, self.public.score)

    @property
    def verdict(self) -> str:
        """What the ratio says, in words."""
        _, (low, high) = self.ratio
        if math.isnan(low):
            return "too few runs to say"
        return (
            "worse on the hidden suite" if low > 1.0 else "better on the hidden suite" if high < 1.0 else "they agree"
        )


def ratio_apart(one: Root, other: Root) -> Estimate:
    """Return the ratio of two scores from different runs with its 95 % interval, NaN if either has none.

    The resampled deviations of both are independent; the second ones are taken in reverse, for both have the same draws.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(np.divide(one.value, other.value))
    if not (len(one.t) and len(other.t)):
        return ratio, NO_INTERVAL
    away = 0.5 * (one.t * one.error - other.t[::-1] * other.error)
    low, high = np.percentile(away, 100.0 * TAILS)
    return ratio, (ratio * math.exp(-high), ratio * math.exp(-low))


@contextmanager
def opened(path: Path) -> Iterator[tuple[Submission, Path]]:
    """Yield what a bundle says and a temporary folder with its members.

    Raises:
        ValueError: no bundle, or members that are not what it says.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        yield bundle.unpack(path, folder), folder


def check(said: Submission, folder: Path) -> None:
    """Check that the board and the numbers of runs in a bundle follow from its rows, which are those of public suites.

    The table in the folder is made anew from the rows.

    Raises:
        ValueError: what does not follow.
    """
    with Store(folder / RESULTS, read_only=True) as store:
        wanted = canonical(said.settings)
        keys = [key for key in list(store.keys()) if (key.solver, key.settings) == (said.solver, wanted)]
        if {key.task: len(store.runs_of(key)) for key in keys} != said.runs:
            raise ValueError(f"{SUBMISSION} has other tasks and numbers of runs than {RESULTS}")
        for key in keys:
            if key.task not in TASKS:
                raise ValueError(f"{visible(key.task)} is no task of this version")
            if key.suite != suite_hash(TASKS[key.task]) or store.runs_of(key) != set(range(said.runs[key.task])):
                raise ValueError(f"{visible(key.task)}: allowed: the first runs of the public suite, none left out")
            if key.code != said.code:
                raise ValueError(f"{SUBMISSION} has another code than {RESULTS}")
        results = [store.results(key) for key in list(store.keys())]
    if not _close(parse_json(as_json(results)), said.board):
        raise ValueError("its board does not follow from its rows")
    (folder / BOARD).write_text(as_markdown(results), encoding="utf-8")


def _close(one: Any, other: Any) -> bool:
    """Return whether two JSON values are the same but for the rounding of numbers."""
    if isinstance(one, dict) and isinstance(other, dict):
        return all(_close(one[name], other[name]) for name in one.keys() & other.keys())  # versions may have more
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_close, one, other))
    if isinstance(one, float) and isinstance(other, (int, float)):
        return math.isclose(one, other, rel_tol=CLOSE)
    return bool(one == other)


def remarks(said: Submission) -> Iterator[str]:
    """Yield what the holder should know: another version of this project, or another world of a task."""
    if (here := version.code_version(YARDSTICK)) != said.project:
        yield f"made with code {visible(said.project)} of this project, this is {here}: the public figures are those of its commit"
    for name, found in said.digests.items():
        if name in TASKS and digest(TASKS[name]) != found:
            yield f"{visible(name)}: its world is another one here (digest {visible(found)})"


def beside(said: Submission, folder: Path, hidden: Store) -> list[Pair]:
    """Return the tasks that the solver of a bundle has played on a hidden suite too.

    Raises:
        ValueError: a file without rows of the solver on another suite.
    """
    wanted = canonical(said.settings)
    out = []
    with Store(folder / RESULTS, read_only=True) as store:
        public = {key.task: key for key in store.keys(solvers=[said.solver]) if key.settings == wanted}
        for key in hidden.keys(list(public), [said.solver]):
            if key.settings == wanted and key.suite != public[key.task].suite:
                claimed, found = store.results(public[key.task]), hidden.results(key)
                out.append(Pair(visible(key.task), _unit(claimed), Side.of(claimed), Side.of(found)))
    if not out:
        names = {key.solver for key in list(hidden.keys())}
        if said.solver not in names:
            raise unknown(f"solver in {hidden.path}", said.solver, names)
        raise ValueError(
            f"{hidden.path}: {visible(said.solver)} has no rows of another suite; allowed: rows made with --seed"
        )
    return out


def _unit(one: Results) -> tuple[float, str]:
    name = one.task.rank_by
    return (1.0, "m") if name.startswith("position") else (1.0, "m/s") if name.startswith("velocity") else (DEG, "deg")


def table(pairs: Sequence[Pair]) -> Table:
    """Return the table with both suites beside each other."""
    out = titled("public suite, as handed in, and hidden suite")
    for name in ("task", "suite", "runs", "failed", "score", "hidden / public", ""):
        out.add_column(name, justify="left" if name in ("task", "suite", "") else "right")
    for pair in pairs:
        size, unit = pair.unit
        for name, side in (("public", pair.public), ("hidden", pair.hidden)):
            share, (least, most) = side.failed
            failed = f"{round(share * side.runs)} [{100 * least:.1f}–{100 * most:.1f} %]"
            low, high = (end / size for end in side.score.interval())
            score = f"{_told((side.score.value / size, (low, high)))} {unit}"
            last = ("", "") if name == "public" else (_told(pair.ratio), pair.verdict)
            cells = (pair.task if name == "public" else "", name, str(side.runs), failed, score, *last)
            out.add_row(*map(Text, cells))
    return out


def _told(estimate: Estimate) -> str:
    value, (low, high) = estimate
    shown = number_text(value)
    return shown if math.isnan(low) else f"{shown} [{number_text(low)}–{number_text(high)}]"
