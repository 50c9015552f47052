"""Verification of stored scores: random rows are run once more and compared.

A row can be verified if its task, solver and code are the present ones and the seed of its suite is given. A task whose
world (digest), definition, criteria or bound has changed is a difference, too, because the tables show what is stored.

A file never decides what is imported, and its settings are a stranger's: a solver with settings plays in a process of its
own, whose memory and calls have limits. A solver by name must be installed. One by path, module:Factory, must be trusted by
the caller in the same words. The version of its code is compared before anything of it is imported.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation import monte_carlo
from sins_env.evaluation.bound import oracle
from sins_env.evaluation.estimators import finding, version
from sins_env.evaluation.estimators.isolation import Limits
from sins_env.evaluation.play.criteria import COMPONENTS, DIVERGED_SIGMAS, PHI, Criteria
from sins_env.evaluation.play.executors import Runner
from sins_env.evaluation.play.fields import NEES_PARTS, Field
from sins_env.evaluation.play.records import FIELDS, Records
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.rows import STORED_NOW, binding, changed, criteria_change, definition_json
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import TASKS, find
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import suite_hash

#: Relative tolerance of a score. In navigation, where batches of other sizes round differently, it is relative to the
#: standard deviation at the start if that is more.
TOLERANCE = 1e-9
#: Factor of the tolerance of a NEES in navigation, whose standard deviations are that much smaller than those at the start.
NEES_SIZE = 1e4
#: Relative tolerance of a bound, whose Riccati equation sums rounding errors of many epochs, and of the oracle, whose errors
#: are small differences of readings and truth.
BOUND_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Verified:
    """Result of a verification."""

    runs: int  #: number of runs that were run again
    differences: tuple[str, ...]  #: a line for each run, or task, that differs from what is stored
    left_out: dict[str, int] = field(default_factory=dict)  #: number of rows that cannot be verified, by reason
    compared: dict[Key, int] = field(default_factory=dict)  #: number of runs that were run again, by key


def verify(
    store: Store,
    keys: Sequence[Key],
    rows: int,
    seed: int | None = None,
    draw: int | None = None,
    *,
    trusted: Collection[str] = (),
    other_code: bool = False,
    where: Runner | None = None,
    progress: monte_carlo.Report | None = None,
) -> Verified:
    """Run up to ``rows`` random rows of these keys again, spread evenly over them, and compare them with the stored ones.

    Args:
        store: results file.
        keys: keys of the runs to choose from.
        rows: number of rows to run.
        seed: seed of a hidden suite; None takes that of each task.
        draw: seed of the choice of rows; None makes another choice every time.
        trusted: solvers as module:Factory that may be imported; those that only the file names are left out.
        other_code: whether rows of another version of the code are compared, too, instead of being left out.
        where: worker processes, or None for this process.
        progress: function called with the number of runs that are done and with their total.
    """
    left_out: dict[str, int] = {}
    changed: dict[str, str] = {}
    candidates: dict[Key, list[int]] = {}
    for key in keys:
        runs = sorted(store.runs_of(key))
        reason = _obstacle(key, seed, trusted, other_code)
        if reason:
            left_out[reason] = left_out.get(reason, 0) + len(runs)
            continue
        if key.task not in changed:
            changed[key.task] = _change(store, key.task)
        candidates[key] = runs
    chosen = _drawn(candidates, rows, draw)
    count = sum(map(len, chosen.values()))
    differences = [text for text in changed.values() if text]
    yardsticks: dict[str, None] = {}  # each task's once
    done = 0
    for key, runs in chosen.items():

        def report(part: float, total: float, before: int = done, here: int = len(runs)) -> None:
            if progress:
                progress(before + here * part / total, count)

        stored = store.results(key, runs)
        if key.solver == oracle.SOLVER:
            luck = oracle.compute(TASKS[key.task], runs, seed)
            lines = (
                compare_runs(stored.records, luck.records, tolerance=tolerance(key.solver))
                if luck
                else ["the task has no oracle now"]
            )
            differences += [f"the oracle of {key.task}, {text}" for text in lines]
            report(1.0, 1.0)
            done += len(runs)
            continue
        settings = json.loads(key.settings)
        limit_s = Limits().first_s if settings and finding.is_own(key.solver) else None
        found = monte_carlo.evaluate(
            key.task, key.solver, runs, seed, settings=settings, executor=where, cost=False,
            workers=None if where else 1, progress=report, epoch_timeout_s=limit_s,
        )  # fmt: skip
        yardsticks |= dict.fromkeys(f"{key.task}: {text}" for text in _yardsticks(stored, found))
        differences += [f"{stored.label} on {key.task}, {text}" for text in compare_runs(stored.records, found.records)]
        done += len(runs)
    return Verified(done, (*yardsticks, *differences), left_out, {key: len(runs) for key, runs in chosen.items()})


def _drawn(candidates: Mapping[Key, Sequence[int]], rows: int, draw: int | None) -> dict[Key, list[int]]:
    """Return up to ``rows`` random runs by key: a second one of a key comes after the first one of every key."""
    rng = np.random.default_rng(draw)
    order = [
        (place, tie, key, run)
        for key, runs in candidates.items()
        for place, (tie, run) in enumerate(zip(rng.random(len(runs)), rng.permutation(runs).tolist(), strict=True))
    ]
    first = sorted(order, key=lambda one: one[:2])[:rows]
    chosen = {key: sorted(run for _, _, of, run in first if of == key) for key in candidates}
    return {key: runs for key, runs in chosen.items() if runs}


def _yardsticks(stored: Results, now: Results) -> Iterator[str]:
    """Yield how the criteria and the bound that the tables are made with differ from those of the task."""
    if text := criteria_change(stored.records.criteria, now.records.criteria):
        yield f"its criteria have changed, {text}"
    before, bound = stored.stored_bound, now.bound
    if before == "ask" or not stored.records.criteria.scored:
        return
    if before is None or bound is None:
        if before is not bound:
            yield f"its bound has changed, {before} stored, {bound} now"
        return
    if name := changed(before, bound, BOUND_TOLERANCE):
        yield f"its bound has changed in {name}, {before} stored, {bound} now"


def may_run(solver: str, trusted: Collection[str] = ()) -> bool:
    """Return whether a solver that a file names may be imported: it is installed by that name, or trusted as a path."""
    return solver in trusted or (":" not in solver and (finding.is_own(solver) or finding.is_foreign(solver)))


def _obstacle(key: Key, seed: int | None, trusted: Collection[str], other_code: bool) -> str:
    """Return why these rows cannot be run again; empty if they can. Nothing is imported to find out."""
    if find(key.task) is None:
        return f"{key.task} is no task of this version; a file of one's own is named with --task FILE"
    own = key.solver == oracle.SOLVER
    if not own and not may_run(key.solver, trusted):
        path = ":" in key.solver
        return (
            f"{key.solver} is named by the file alone, so it is not imported (verify --solver {key.solver}, if it is yours)"
            if path
            else f"no solver {key.solver} here"
        )
    try:
        code = version.code_version(None if own else key.solver)
    except ValueError:
        return f"no solver {key.solver} here"
    if code != key.code and not other_code:
        return f"made with code {key.code}, this is {code} (verify --adopt compares them)"
    if key.suite != suite_hash(TASKS[key.task], seed):
        return f"of suite {key.suite}: --seed must be given, or is another's"
    return ""


def _change(store: Store, name: str) -> str:
    """Return how a task differs from the one under which its runs were made; empty if it does not."""
    before, now = store.digest_of(name), digest(TASKS[name])
    if before not in (None, now):
        return f"{name}: its world has changed, digest {before} stored, {now} now"
    held = store.definition_of(name)
    if held is not None and binding(held) != binding(definition_json(TASKS[name])):
        return f"{name}: its definition has changed"
    return ""


def tolerance(solver: str) -> float:
    """Return the relative tolerance of the scores of a solver, or of the oracle."""
    return BOUND_TOLERANCE if solver == oracle.SOLVER else TOLERANCE


def compare_runs(
    stored: Records, now: Records, words: tuple[str, str] = STORED_NOW, *, tolerance: float = TOLERANCE
) -> list[str]:
    """Return a line for each run that differs, with the first score that does, and why the second run failed if it did.

    ``words`` stand behind the two values; ``tolerance`` is relative. Timing, texts and histories are not compared.

    Raises:
        ValueError: different runs, or another order.
    """
    out = []
    for i, run in enumerate(stored.run):
        if run != now.run[i]:
            raise ValueError(f"run {now.run[i]}; allowed: the same runs in the same order")
        for name, before, after in _differences(stored.row(i), now.row(i), stored.criteria, tolerance):
            why = now.row(i)["reason"]
            out.append(f"run {run}: {name} {before} {words[0]}, {after} {words[1]}" + (f" ({why})" if why else ""))
            break
    return out


def _differences(
    stored: dict[str, Any], now: dict[str, Any], criteria: Criteria, tolerance: float
) -> Iterator[tuple[str, object, object]]:
    """Yield each score that differs, with both values."""
    for one in FIELDS.values():
        if not one.compared:
            continue
        if one.kind != "number":
            if stored[one.name] != now[one.name]:
                yield one.name, stored[one.name], now[one.name]
            continue
        before, after = (np.atleast_1d(run[one.name]) for run in (stored, now))
        sizes = _sizes(one, before, stored, criteria)
        for heading, *values in zip(one.headings, before, after, sizes, strict=False):  # some tasks have no such field
            if not _equal(*values, tolerance=tolerance):
                yield heading, f"{values[0]:.12g}", f"{values[1]:.12g}"


def _sizes(one: Field, before: Array, stored: dict[str, Any], criteria: Criteria) -> Array:
    """Return the size of each part to which the tolerance is relative, if it is more than the part itself."""
    if one.components:
        start = _start(criteria)
        size = start.copy()  # of errors that nearly cancel, as a mean may, it is that of the terms
        size[PHI] = np.maximum(np.nan_to_num(stored["steady_rms"]), start[PHI])
        return size[[COMPONENTS.index(name) for name in one.components]]
    nees = one.parts == NEES_PARTS and criteria.navigates
    return NEES_SIZE * before if nees else np.zeros(one.width)


def _start(criteria: Criteria) -> Array:
    """Return the standard deviations of COMPONENTS at the start of a navigation task; 0 in alignment."""
    if not criteria.navigates:
        return np.zeros(len(COMPONENTS))
    sigma = criteria.limit / DIVERGED_SIGMAS
    return np.concatenate([sigma, sigma[2:3], np.full(2, sigma[:2].max())])


def _equal(stored: float, now: float, size: float, *, tolerance: float) -> bool:
    if (math.isnan(stored) and math.isnan(now)) or stored == now:
        return True
    close = abs(stored - now) <= tolerance * max(abs(stored), abs(now), size)
    return bool(close and math.isfinite(stored) and math.isfinite(now))
