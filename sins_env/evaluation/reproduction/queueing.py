"""One queue for the runs of many evaluations, so that no process waits for the last runs of one of them."""

from __future__ import annotations

from collections.abc import Sequence

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.monte_carlo import DIED, chunks, extent
from sins_env.evaluation.play.executors import runner
from sins_env.evaluation.play.playing import Job, lost_records
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.store.filling import Evaluation
from sins_env.evaluation.store.store import Store


def fill(store: Store, wanted: Sequence[Evaluation], workers: int | None = None) -> None:
    """Make the runs that the file does not hold, and show progress; each portion is stored when it ends.

    Raises:
        KeyboardInterrupt: the user stopped it; the text says what is in the file.
    """
    todo = [(one, missing) for one in wanted if (missing := one.missing(store))]
    if not todo:
        return
    queue = [
        (Job(one.task, one.solver, part, dict(one.settings)), one.key)
        for one, missing in todo
        for part in chunks(missing)
    ]
    jobs, key_of = [job for job, _ in queue], {id(job): key for job, key in queue}
    extents = [extent(one.task, len(missing)) for one, missing in todo]
    total_s, epochs = sum(s for _, s in extents), sum(s / epoch_s for epoch_s, s in extents)
    apart = not all(finding.is_own(solver) for solver in {one.solver for one, _ in todo})
    with runner(None, workers, len(jobs), apart) as where, Bar(f"runs of {len(todo)} evaluations") as bar:
        try:
            for job, found in where.run(jobs, lambda done: bar.update(min(done / epochs, 1.0) * total_s, total_s)):
                store.add(key_of[id(job)], found or lost_records(job, DIED))
        except KeyboardInterrupt as error:
            there = sum(len(one.runs) - len(one.missing(store)) for one in wanted)
            what = f"{there} of {sum(len(one.runs) for one in wanted)} runs are in {store.path}"
            raise KeyboardInterrupt(f"interrupted: {what}; the same command continues") from error
