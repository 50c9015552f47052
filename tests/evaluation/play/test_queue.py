"""Jobs of several tasks and solvers in one queue: what is played is handed on as it ends, and progress is in simulated seconds."""

import dataclasses

import numpy as np
import pytest

from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.playing import run_job
from sins_env.evaluation.play.pool import Processes
from sins_env.evaluation.play.queue import DIED, extent, played

PLUGIN = "evaluation.plugins:"


@pytest.fixture
def longer(short):
    """30 s of it, in epochs of 0.05 s."""
    return dataclasses.replace(short, name="longer-v0", kwargs={**short.kwargs, "duration": 30.0, "epoch": 0.05})


class Backwards:
    """Runs the last job first, and loses those of a solver."""

    def run(self, jobs, progress):
        done = 0
        for job in reversed(jobs):
            records = None if job.solver.endswith("Lost") else run_job(job)
            done += len(job.runs) * round(extent(job.task, 1)[1] / extent(job.task, 1)[0])
            progress(done)
            yield job, records


def test_records_as_jobs_end(short, longer):
    jobs = [Job(short, PLUGIN + "Told", (0, 1)), Job(longer, PLUGIN + "Lost", (3,)), Job(longer, PLUGIN + "Told", (2,))]
    seen = []
    found = list(played(jobs, Backwards(), lambda *now: seen.append(now)))
    assert [job for job, _ in found] == jobs[::-1]
    assert [records.run.tolist() for _, records in found] == [[2], [3], [0, 1]]
    lost = found[1][1]
    assert (lost.status[0], lost.reason[0]) == ("lost", DIED)
    total = 2 * 20.0 + 2 * 30.0
    assert {all_s for _, all_s in seen} == {total}
    assert seen[-1] == (total, total)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_no_jobs(short):
    assert list(played([], Backwards(), lambda *now: None)) == []


def test_workers_share_what_is_left(short):
    """Two processes, four jobs of two solvers: whatever the order, each has its own records."""
    jobs = [Job(short, PLUGIN + name, (run,)) for run in (0, 1) for name in ("DeadReckoning", "Noisy")]
    with Processes(2) as where:
        found = {(job.solver, job.runs): records for job, records in played(jobs, where)}
    assert len(found) == 4
    for job in jobs:
        alone = run_job(job)
        np.testing.assert_array_equal(found[job.solver, job.runs].final, alone.final)
