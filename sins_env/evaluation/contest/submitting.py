"""Submission: the rows of one solver in a results file are checked, and become a bundle for the holder of a board.

The holder checks the same things: the file itself, and that its tasks and their worlds are those of this project. The rows were
made with the code that is here, no run is left out, and random rows give the same scores once more. The board is computed from the
rows anew, for nothing else in the file says what they are worth.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from sins_env.checks import unknown
from sins_env.evaluation.bound import oracle
from sins_env.evaluation.contest import bundle
from sins_env.evaluation.contest.bundle import BOARD, RESULTS, SOURCES, Submission
from sins_env.evaluation.estimators import finding, version
from sins_env.evaluation.play.executors import Runner
from sins_env.evaluation.play.queue import Report
from sins_env.evaluation.show.plain_tables import as_json, as_markdown
from sins_env.evaluation.speed.cost import YARDSTICK
from sins_env.evaluation.store import merging
from sins_env.evaluation.store.key import Key, canonical
from sins_env.evaluation.store.store import PACKAGES, Store
from sins_env.evaluation.store.verify import Verified, verify
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import suite_hash
from sins_env.reading.documents import parse_json


class Differs(ValueError):
    """Error for rows that are not what the present code makes; ``found`` has a line for each."""

    def __init__(self, found: Sequence[str]) -> None:
        super().__init__("; ".join(found))
        self.found = tuple(found)


class Submitted(NamedTuple):
    """A bundle that was written."""

    submission: Submission
    size: int  #: bytes


def submit(
    path: Path,
    solver: str,
    out: Path,
    *,
    tasks: Sequence[str] = (),
    settings: Mapping[str, Any] | None = None,
    rows: int = 20,
    draw: int | None = None,
    where: Runner | None = None,
    progress: Report | None = None,
) -> Submitted:
    """Check the rows of a solver in a results file, and write a bundle with them and those of the yardstick beside them.

    Args:
        path: results file.
        solver: the solver, which is run again; so it may be imported.
        out: bundle to write.
        tasks: these tasks only; empty takes all that the solver has rows of.
        settings: settings of the solver, needed if the file has several.
        rows: number of random rows to run again.
        draw: seed of the choice of rows.
        where: worker processes, or None for this process.
        progress: function called with the number of rows that are done and with their total.

    Raises:
        ValueError: a name that the file does not have, rows that nobody could make again, or a run that is left out.
        Differs: rows that the present code does not make.
    """
    if finding.is_foreign(solver) and ":" not in solver:
        raise ValueError(
            f"{solver} is a name of an installed package; allowed: the same as module:Factory, which others can run"
        )
    with Store(path, read_only=True) as store:
        keys = _chosen(store, path, solver, tasks, settings)
        found = verify(store, keys, rows, draw=draw, trusted={solver}, where=where, progress=progress)
        for reason, count in found.left_out.items():
            raise ValueError(f"{path}: {count} runs cannot be made again: {reason}")
        if found.differences:
            raise Differs(found.differences)
        beside = [
            one
            for one in store.keys([key.task for key in keys], [YARDSTICK, oracle.SOLVER], oracles=True)
            if one.suite in {key.suite for key in keys} and one not in keys and one.settings == canonical({})
        ]
    return _packed(path, out, keys, beside, found)


def _chosen(
    store: Store, path: Path, solver: str, tasks: Sequence[str], settings: Mapping[str, Any] | None
) -> list[Key]:
    """Return the keys of the rows to hand in: one of each task, of its public suite, and without a gap."""
    held = store.keys(solvers=[solver])
    if not held:
        raise unknown(f"solver in {path}", solver, {key.solver for key in list(store.keys())})
    for name in tasks:
        if name not in {key.task for key in held}:
            raise unknown(f"task of {solver} in {path}", name, {key.task for key in held})
    wanted = None if settings is None else canonical(settings)
    held = [key for key in held if key.among(tasks, ()) and wanted in (None, key.settings)]
    there = sorted({key.settings for key in held})
    if len(there) != 1:
        told = f"the settings {', '.join(there)}" if there else f"no rows with the settings {wanted}"
        raise ValueError(f"{path} has {told} of {solver}; allowed: one of those that it has, by --set NAME=VALUE")
    public = [key for key in held if key.suite == suite_hash(get_task(key.task))]
    if not public:
        raise ValueError(
            f"{path} has no rows of {solver} on a public suite; allowed: rows that were made without --seed"
        )
    for key in public:
        runs = store.runs_of(key)
        if gaps := sorted(set(range(max(runs) + 1)) - runs):
            raise ValueError(
                f"{path}: run {gaps[0]} of {solver} on {key.task} is missing; allowed: all runs from 0 on "
                "(sins-env eval --resume makes it)"
            )
    return public


def _packed(path: Path, out: Path, keys: Sequence[Key], beside: Sequence[Key], found: Verified) -> Submitted:
    solver = keys[0].solver
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        merging.merge([path], folder / RESULTS, only=(*keys, *beside))
        with Store(folder / RESULTS, read_only=True) as store:
            results = [store.results(key) for key in list(store.keys())]
            board = parse_json(as_json(results))
            (folder / BOARD).write_text(as_markdown(results), encoding="utf-8")
            runs = {key.task: len(store.runs_of(key)) for key in keys}
        members = {name: folder / name for name in (RESULTS, BOARD)} | dict(_sources(solver))
        submission = Submission(
            format=bundle.FORMAT,
            made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S"),
            solver=solver,
            settings=json.loads(keys[0].settings),
            code=keys[0].code,
            project=version.code_version(YARDSTICK),
            versions=version.packages(PACKAGES),
            runs=runs,
            digests={name: digest(get_task(name)) for name in runs},
            checked=found.runs,
            board=board,
            files={name: bundle.sha256(file.read_bytes()) for name, file in members.items()},
        )
        bundle.pack(out, submission, members)
    return Submitted(submission, out.stat().st_size)


def _sources(solver: str) -> Iterable[tuple[str, Path]]:
    """Yield the Python files of a stranger's solver by their names in a bundle; a solver of this project has none."""
    if finding.is_own(solver):
        return
    package = finding.module_of(solver).partition(".")[0]
    files = version.sources(package)
    folder = files[0].parent if len(files) == 1 and files[0].stem == package else None
    for file in files:
        root = folder or next(up.parent for up in file.parents if up.name == package)
        yield f"{SOURCES}/{file.relative_to(root).as_posix()}", file
