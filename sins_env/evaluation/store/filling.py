"""Filling of a results file: the runs of many evaluations that it does not have yet are one queue of jobs.

No worker waits for the last runs of one evaluation, and an interrupted command continues where it was.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from sins_env.evaluation.bound import bounds, oracle
from sins_env.evaluation.estimators import version
from sins_env.evaluation.play.cluster import ClusterError
from sins_env.evaluation.play.executors import runner
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.play.queue import chunks, played
from sins_env.evaluation.score.verdicts import LEAST_INTERVAL
from sins_env.evaluation.speed.cost import cost_of
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.task import EvaluationTask, suite_hash

ORACLE_CHUNK = 64  #: number of runs of the oracle that are played together and stored when they end


class Evaluation(NamedTuple):
    """Runs of one solver on one task, with their key in a results file."""

    task: EvaluationTask
    solver: str
    settings: Mapping[str, Any]
    runs: tuple[int, ...]
    key: Key

    @classmethod
    def of(
        cls, task: EvaluationTask, solver: str, settings: Mapping[str, Any], runs: Iterable[int], seed: int | None
    ) -> Evaluation:
        """Make an evaluation with the key of the suite and of the present code.

        Raises:
            ValueError: an unknown solver, or a setting that JSON does not have.
        """
        key = Key.of(task.name, suite_hash(task, seed), solver, dict(settings), version.code_version(solver))
        return cls(task, solver, settings, tuple(runs), key)

    def missing(self, store: Store) -> list[int]:
        """Return the numbers of the runs that the file does not have."""
        return sorted(set(self.runs) - store.runs_of(self.key))


def fill(
    store: Store,
    wanted: Sequence[Evaluation],
    seed: int | None = None,
    *,
    timed: Sequence[Evaluation] = (),
    executor: str = "processes",
    workers: int | None = None,
    chunk: int | None = None,
    epoch_timeout_s: float | None = None,
    resume: str = "the same command continues",
    title: str = "",
    oracles: Container[str] | None = None,
) -> None:
    """Make the missing runs in one queue and with progress; each chunk is stored when it ends.

    The oracle follows in the same runs, from which boards take the luck out of the ratio to the bound.

    Args:
        store: results file.
        wanted: evaluations to complete.
        seed: seed of the suite; None takes that of each task.
        timed: evaluations whose cost is measured after all runs, unless the file has it. It is not measured if a run was
            lost, because such a solver ends the process it is in.
        executor: "processes", "dask", or the address of a Dask scheduler that runs elsewhere.
        workers: number of processes; None takes one per core.
        chunk: runs per batch.
        epoch_timeout_s: longest time of one call of a solver, s; None is no limit.
        resume: advice on how to continue after Ctrl-C, in words.
        title: label of the progress bar; empty says what is evaluated.
        oracles: names of the tasks in whose runs the oracle follows; None takes all.

    Raises:
        KeyboardInterrupt: Ctrl-C; the message tells how many runs the file has.
        ClusterError: a cluster elsewhere that fails; the message tells that, too.
    """

    def job(one: Evaluation, runs: tuple[int, ...]) -> Job:
        return Job(one.task, one.solver, runs, dict(one.settings), seed, epoch_timeout_s)

    todo = [(one, missing) for one in wanted if (missing := one.missing(store))]
    queue = [(one, job(one, part)) for one, missing in todo for part in chunks(missing, chunk)]
    followed = [one for one in wanted if oracles is None or one.task.name in oracles]
    lucky = list(_oracles_missing(store, followed, seed))
    if not queue and not lucky and not any(_cost_missing(store, one) for one in timed):
        return
    key_of = {id(job): one.key for one, job in queue}
    titles = [f"{one.solver} on {one.task.name}" for one, _ in todo]
    label = titles[0] if len(titles) == 1 else f"{len(titles)} evaluations" if titles else "oracle and costs"
    try:
        with (
            runner(executor, workers, max(len(queue), 1)) as where,
            Bar(title or label) as bar,
        ):
            for done, records in played([job for _, job in queue], where, bar.update):
                store.add(key_of[id(done)], records)
            for task, key, runs in lucky:
                for part in chunks(runs, ORACLE_CHUNK):
                    bar.update(note=f"oracle of {task.name}")
                    if found := oracle.compute(task, part, seed):
                        store.add(key, found.records)
            for one in timed:
                if _cost_missing(store, one):
                    bar.update(note=f"cost of {one.solver}")
                    if cost := cost_of(job(one, one.runs[:1]), where):
                        store.add_cost(one.key, cost)
    except (KeyboardInterrupt, ClusterError) as error:
        there = sum(len(one.runs) - len(one.missing(store)) for one in wanted)
        what = f"{there} of {sum(len(one.runs) for one in wanted)} runs are in {store.path}"
        raise type(error)(f"{error if isinstance(error, ClusterError) else 'interrupted'}: {what}; {resume}") from error


def _oracles_missing(
    store: Store, wanted: Sequence[Evaluation], seed: int | None
) -> Iterator[tuple[EvaluationTask, Key, list[int]]]:
    """Yield each task that has a bound and enough runs for intervals, with the runs of the oracle that the file lacks."""
    runs: dict[str, set[int]] = {}
    tasks = {one.task.name: one.task for one in wanted}
    for one in wanted:
        runs.setdefault(one.task.name, set()).update(one.runs)
    for name, task in tasks.items():
        if len(runs[name]) >= LEAST_INTERVAL and bounds.find(task) is not None:
            key = Key.of(name, suite_hash(task, seed), oracle.SOLVER, {}, version.code_version(None))
            if missing := sorted(runs[name] - store.runs_of(key)):
                yield task, key, missing


def _cost_missing(store: Store, one: Evaluation) -> bool:
    found = store.results(one.key, whole=False)
    return found.cost is None and not (found.records.status == "lost").any()
