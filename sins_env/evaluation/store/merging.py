"""Merging of results files: the runs of several machines become one new file, in which each run is once.

Files come in as those of strangers do, inspected and read only. Runs of one key that several files have must be the same, as
``verify`` would find them. If any differ, or were scored by other yardsticks, nothing is written. The new file appears whole.
"""

from __future__ import annotations

import heapq
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.store.database import StoreError
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.rows import binding, bound_of, changed, criteria_change, criteria_of, history_of
from sins_env.evaluation.store.schema import KEY, RUN_COLUMNS, SCORES, SPAN_COLUMNS, SPANS, TOLD, columns_of
from sins_env.evaluation.store.store import Store, shortened
from sins_env.evaluation.store.verify import BOUND_TOLERANCE, compare_runs, tolerance
from sins_env.writing.files import replacing

HISTORY_TOLERANCE = 1e-5  #: tolerance of a history, whose samples are float32, relative to its largest
MOST_NAMED = 10  #: most further runs that a conflict names
REPORT_ROWS = 500  #: number of rows from one report of progress to the next
_FILLED = ("criteria", "definition", "digest", "bound")  #: columns of a task that an older file may lack
_READ = [*RUN_COLUMNS, "history", *SPAN_COLUMNS]
_SESSION = _READ.index("session")
_SAME = [_READ.index(name) for name in columns_of(one for one in (*TOLD, *SCORES, *SPANS) if one.compared)]
_SAME.append(_READ.index("history"))
_SELECT = f"""SELECT {", ".join(map(shortened, _READ))}
    FROM runs LEFT JOIN histories USING (id) LEFT JOIN spans USING (id)"""
_KEY_FIELDS = ("task", "suite", "solver", "settings", "code")

#: Function called with the number of rows that are done and with their total.
Report = Callable[[float, float], None]


class Merged(NamedTuple):
    """Result of a merge."""

    runs: int  #: number of runs in the new file
    repeated: int  #: number of rows left out, because another file had the same run
    remarks: tuple[str, ...]  #: what tables of the new file will not compare: other code, other versions of a task


class Conflicts(ValueError):
    """Error for files that do not fit each other; ``found`` has a line for each conflict."""

    def __init__(self, found: Sequence[str]) -> None:
        super().__init__("; ".join(found))
        self.found = tuple(found)


def merge(
    paths: Sequence[str | Path],
    out: str | Path,
    progress: Report | None = None,
    *,
    only: Collection[Key] | None = None,
) -> Merged:
    """Write the runs of results files to a new one: all, or those of the keys ``only``.

    The run that was made first stays. Sessions keep their order, so that the latest code is the latest one there, too.
    A cost is that of the first file that has it.

    Raises:
        ValueError: the new file exists already.
        StoreError: a file that cannot be read, or is not a results file; or the new one cannot be written.
        Conflicts: runs of one key with other values, or a task with other criteria, definition, world or bound.
    """
    out = Path(out)
    if out.exists():
        raise ValueError(
            f"{out} exists, and a merge changes no file: --db another file, and {out} among the files if its runs belong there"
        )
    with ExitStack() as stack:
        sources = [stack.enter_context(Store(path, read_only=True)) for path in dict.fromkeys(map(Path, paths))]
        for source in sources:
            stack.enter_context(source.snapshot())
        tasks = _tasks(sources)
        if only is not None:
            tasks = {name: row for name, row in tasks.items() if name in {key.task for key in only}}
        with replacing([out]) as (new,):
            try:
                with Store(new) as store, store.explaining(), store.transaction():
                    return _Merge(sources, store, tasks, progress, only).run()
            except StoreError as error:
                raise StoreError(str(error).replace(str(new), str(out))) from error


class _Merge:
    """One merge: open files, the new file in a transaction, and what has been found so far."""

    def __init__(
        self,
        sources: Sequence[Store],
        store: Store,
        tasks: dict[str, dict[str, Any]],
        progress: Report | None,
        only: Collection[Key] | None,
    ):
        self.sources, self.store, self.tasks, self.progress = sources, store, tasks, progress
        #: Values of KEY, but for the run, that are copied; None copies all.
        self.only = None if only is None else {key.values for key in only}
        self.criteria = {name: criteria_of(row["criteria"]) for name, row in tasks.items() if row["criteria"]}
        self.sessions: dict[tuple[Any, ...], int] = {}  #: numbers in the new file, by start, versions and machine
        self.suspects: dict[tuple[Key, int], list[int]] = {}  #: runs that are not bit for bit those of the new file

    def run(self) -> Merged:
        """Copy everything, and compare what is there already."""
        write = self.store.connection.execute
        for name, task in self.tasks.items():
            write("INSERT INTO tasks VALUES (?, ?, ?, ?, ?)", (name, *(task[column] for column in _FILLED)))
        told = [_sessions(source) for source in self.sources]
        total = sum(source.connection.execute("SELECT count(*) FROM runs").fetchone()[0] for source in self.sources)
        runs = left = 0
        streams = [_rows(i, source, told[i]) for i, source in enumerate(self.sources)]
        for done, (_, i, row) in enumerate(heapq.merge(*streams, key=lambda one: one[0]), start=1):
            if self._wanted(row[: len(KEY) - 1]):
                runs += self._copy(i, row, told[i])
            else:
                left += 1
            if self.progress and (done % REPORT_ROWS == 0 or done == total):
                self.progress(done, total)
        for i, source in enumerate(self.sources):
            sql = "SELECT task, solver, settings_hash, code, session, median_us, p95_us, ratio FROM costs"
            for name, solver, settings_hash, code, session, *cost in source.connection.execute(sql):
                if self._wanted((name, None, solver, settings_hash, code)):
                    values = (name, solver, settings_hash, code, self._session(told[i], session), *cost)
                    write("INSERT OR IGNORE INTO costs VALUES (?, ?, ?, ?, ?, ?, ?, ?)", values)
            sql = "SELECT task, suite, solver, settings_hash, before, code, runs, compared, session FROM adoptions"
            for *adoption, session in source.connection.execute(sql):
                if self._wanted((*adoption[:4], None)):
                    values = (*adoption, self._session(told[i], session))
                    write("INSERT OR IGNORE INTO adoptions VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", values)
        if found := list(self._conflicts()):
            raise Conflicts(found)
        return Merged(runs, total - runs - left, (*_other_code(self.sources), *_other_versions(self.sources)))

    def _wanted(self, values: Sequence[Any]) -> bool:
        """Return whether what belongs to these values of KEY, of which None is any, is copied."""
        if self.only is None:
            return True
        return any(all(v in (None, k) for v, k in zip(values, key, strict=True)) for key in self.only)

    def _copy(self, i: int, row: tuple[Any, ...], told: dict[int, tuple[Any, ...]]) -> bool:
        """Copy a row of a file, unless there is one of its key already; return whether it was copied."""
        values, history, span = row[: len(RUN_COLUMNS)], row[len(RUN_COLUMNS)], row[len(RUN_COLUMNS) + 1 :]
        run = dict(zip(RUN_COLUMNS, values, strict=True))
        criteria = self.criteria[run["task"]]
        with self.sources[i].reading(f"rows of {run['solver']} on {run['task']}"):
            history_of(history, criteria, run["run"])
        session = self._session(told, run["session"])
        numbers = span if criteria.navigates else None
        if self.store.insert((*values[:_SESSION], session, *values[_SESSION + 1 :]), history, numbers):
            return True
        key = Key(*(run[name] for name in _KEY_FIELDS))
        if not _alike(row, _row(self.store, key, run["run"])):
            self.suspects.setdefault((key, i), []).append(run["run"])
        return False

    def _session(self, told: dict[int, tuple[Any, ...]], number: int | None) -> int | None:
        """Return the number of a session in the new file; sessions that are alike are one."""
        session = told.get(number) if number is not None else None
        if session is None:
            return None
        if session not in self.sessions:
            sql = "INSERT INTO sessions (started, versions, machine) VALUES (?, ?, ?)"
            self.sessions[session] = self.store.connection.execute(sql, session).lastrowid or 0
        return self.sessions[session]

    def _conflicts(self) -> Iterator[str]:
        """Yield a line for each pair of files whose runs of a key differ by more than rounding."""
        for (key, i), runs in self.suspects.items():
            source = self.sources[i]
            by_origin: dict[Path, list[int]] = {}
            for run in runs:
                by_origin.setdefault(self._origin(key, run), []).append(run)
            for origin, some in by_origin.items():
                here, there = (one.results(key, set(some)) for one in (self.store, source))
                words = f"in {origin}", f"in {source.path}"
                found = compare_runs(here.records, there.records, words, tolerance=tolerance(key.solver))
                scores = {text.partition(":")[0] for text in found}
                found += [
                    f"run {run}: history {words[0]} and {words[1]}"
                    for run, one, other in zip(some, here.records.history, there.records.history, strict=True)
                    if f"run {run}" not in scores and not _close(one, other)
                ]
                if found:
                    others = [text.partition(":")[0].removeprefix("run ") for text in found[1 : 1 + MOST_NAMED]]
                    more = f"; also run {', '.join(others)}" if others else ""
                    more += f" and {len(found) - 1 - MOST_NAMED} more" if len(found) > 1 + MOST_NAMED else ""
                    yield f"{here.label} on {key.task}, code {key.code}: {found[0]}{more}"

    def _origin(self, key: Key, run: int) -> Path:
        """Return the first file that has the row of the new file."""
        kept = _row(self.store, key, run)
        return next(one.path for one in self.sources if _alike(kept, _row(one, key, run)))


def _row(store: Store, key: Key, run: int) -> tuple[Any, ...] | None:
    """Return the row of a run as it stands in a file; None if it is not there."""
    sql = f"{_SELECT} WHERE {' AND '.join(f'{name} = ?' for name in KEY)}"
    found: tuple[Any, ...] | None = store.connection.execute(sql, (*key.values, run)).fetchone()
    return found


def _alike(one: tuple[Any, ...] | None, other: tuple[Any, ...] | None) -> bool:
    """Return whether two rows are there and have the same values, but for times and messages."""
    return one is not None and other is not None and all(one[i] == other[i] for i in _SAME)


def _close(one: Array, other: Array) -> bool:
    """Return whether two histories (S, components) differ by rounding alone."""
    size = np.max(np.abs(one), axis=0, where=np.isfinite(one), initial=0.0)
    return np.allclose(one / np.where(size, size, 1.0), other / np.where(size, size, 1.0), HISTORY_TOLERANCE,
                       HISTORY_TOLERANCE, equal_nan=True)  # fmt: skip


def _rows(i: int, source: Store, told: dict[int, tuple[Any, ...]]) -> Iterator[tuple[str, int, tuple[Any, ...]]]:
    """Yield the rows of a file as they were written, each with the start of its session, which never goes back."""
    latest = ""
    with source.explaining():
        for row in source.connection.execute(f"{_SELECT} ORDER BY id"):
            latest = max(latest, told.get(row[_SESSION], ("",))[0])
            yield latest, i, row


def _sessions(source: Store) -> dict[int, tuple[Any, ...]]:
    """Return start, versions and machine of the sessions of a file, by number."""
    with source.explaining():
        found = source.connection.execute("SELECT id, started, versions, machine FROM sessions")
        return {number: session for number, *session in found for session in [tuple(session)]}


def _tasks(sources: Sequence[Store]) -> dict[str, dict[str, Any]]:
    """Return the tasks of all files by name, each column from the first file that has it.

    Raises:
        Conflicts: a task with other criteria, definition, world or bound.
    """
    found: dict[str, dict[str, Any]] = {}
    origin: dict[tuple[str, str], Path] = {}
    conflicts = []
    for source in sources:
        with source.explaining():
            rows = source.connection.execute(f"SELECT task, {', '.join(_FILLED)} FROM tasks ORDER BY rowid").fetchall()
        for name, *values in rows:
            kept = found.setdefault(name, dict.fromkeys(_FILLED))
            for column, value in zip(_FILLED, values, strict=True):
                if kept[column] is None or (column == "bound" and kept[column] == "null" and value is not None):
                    kept[column] = value
                    origin[name, column] = source.path
                elif value not in (None, kept[column]):
                    words = f"in {origin[name, column]}", f"in {source.path}"
                    if text := _changes(column, kept[column], value, words):
                        conflicts.append(f"{name}: {text}; its runs do not compare")
    if conflicts:
        raise Conflicts(conflicts)
    return found


def _changes(column: str, one: str, other: str, words: tuple[str, str]) -> str:
    """Return how a column of a task differs in two files; empty if it does so by rounding alone."""
    if column == "criteria":
        change = criteria_change(criteria_of(one), criteria_of(other), words)
        return change and f"other criteria, {change}"
    if column == "definition":
        before, now = binding(one), binding(other)
        name = next((name for name in before if before[name] != now[name]), "")
        return name and f"another definition, {name} = {before[name]} {words[0]}, {now[name]} {words[1]}"
    if column == "bound":
        bounds = bound_of(one), bound_of(other)
        name = "" if None in bounds else changed(*bounds, BOUND_TOLERANCE)
        return name and f"another bound, in {name}, {words[0]} and {words[1]}"
    return f"another world, digest {one} {words[0]}, {other} {words[1]}"


def _other_code(sources: Sequence[Store]) -> Iterator[str]:
    """Yield a line for each solver whose runs in the files were made with several versions of the code."""
    held: dict[tuple[str, ...], dict[str, list[Path]]] = {}
    for source in sources:
        with source.explaining():
            sql = "SELECT DISTINCT task, solver, settings, code FROM runs"
            for *key, code in source.connection.execute(sql):
                held.setdefault(tuple(key), {}).setdefault(code, []).append(source.path)
    for (task, solver, _), codes in held.items():
        if len(codes) > 1:
            where = ", ".join(f"{code} in {' '.join(map(str, paths))}" for code, paths in codes.items())
            yield f"{solver} on {task}: made with several codes, {where}; tables show the latest"


def _other_versions(sources: Sequence[Store]) -> Iterator[str]:
    """Yield a line for each task of which the files hold several versions."""
    held: dict[str, dict[str, list[Path]]] = {}
    for source in sources:
        with source.explaining():
            for (name,) in source.connection.execute("SELECT DISTINCT task FROM runs"):
                held.setdefault(re.sub(r"-v\d+$", "", name), {}).setdefault(name, []).append(source.path)
    for tasks in held.values():
        if len(tasks) > 1:
            where = ", ".join(f"{name} in {' '.join(map(str, paths))}" for name, paths in tasks.items())
            yield f"several versions of a task, which do not compare: {where}"
