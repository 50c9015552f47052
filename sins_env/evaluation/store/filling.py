"""Filling a results file: of many evaluations what it does not hold yet, with one pool of workers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from sins_env.evaluation import monte_carlo
from sins_env.evaluation.estimators import finding, version
from sins_env.evaluation.play.executors import runner
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.task import EvaluationTask, suite_hash


class Evaluation(NamedTuple):
    """Runs of one solver on one task, and where they are in a results file."""

    task: EvaluationTask
    solver: str
    settings: Mapping[str, Any]
    runs: tuple[int, ...]
    key: Key

    @classmethod
    def of(
        cls, task: EvaluationTask, solver: str, settings: Mapping[str, Any], runs: Iterable[int], seed: int | None
    ) -> Evaluation:
        key = Key.of(task.name, suite_hash(task, seed), solver, dict(settings), version.code_version(solver))
        return cls(task, solver, settings, tuple(runs), key)

    def missing(self, store: Store) -> list[int]:
        """The runs that the file does not hold."""
        return sorted(set(self.runs) - store.runs_of(self.key))


def fill(
    store: Store,
    wanted: Sequence[Evaluation],
    seed: int | None = None,
    *,
    executor: str = "processes",
    workers: int | None = None,
    chunk: int | None = None,
    epoch_timeout_s: float | None = None,
    cost: bool = True,
    resume: str = "--resume continues",
) -> None:
    """Make the runs that are missing, with progress; each chunk is stored as it ends.

    Raises:
        KeyboardInterrupt: says what is in the file; ``resume`` is how to go on.
    """
    todo = [(one, one.missing(store)) for one in wanted]
    count = sum(len(missing) for _, missing in todo)
    if not count:
        return
    apart = not all(finding.is_own(one.solver) for one in wanted)
    with runner(executor, workers, count, apart) as where:
        for i, (one, missing) in enumerate(todo, start=1):
            if not missing:
                continue
            try:
                with Bar(f"{one.solver} on {one.task.name} ({i}/{len(todo)})") as bar:
                    results = monte_carlo.evaluate(
                        one.task,
                        one.solver,
                        missing,
                        seed,
                        settings=one.settings,
                        executor=where,
                        chunk=chunk,
                        epoch_timeout_s=epoch_timeout_s,
                        cost=cost,
                        progress=bar.update,
                        on_records=lambda records, key=one.key: store.add(key, records),  # type: ignore[misc]
                    )
            except KeyboardInterrupt as error:
                what = f"{len(store.runs_of(one.key))} runs of {one.solver} on {one.task.name} are in {store.path}"
                raise KeyboardInterrupt(f"interrupted: {what}; {resume}") from error
            if results.cost:
                store.add_cost(one.key, results.cost)
