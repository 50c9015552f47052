"""One queue fills a results file: of all evaluations what is missing, each portion stored as it ends, costs in the end."""

import os

import numpy as np
import pytest

from sins_env.evaluation.bound import oracle
from sins_env.evaluation.play.executors import InProcess
from sins_env.evaluation.score import losses
from sins_env.evaluation.store import filling
from sins_env.evaluation.store.filling import Evaluation, fill
from sins_env.evaluation.store.merging import merge
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.store.verify import verify

PLUGIN = "evaluation.plugins:"


@pytest.fixture
def store(tmp_path, short):
    with Store(tmp_path / "r.sqlite") as opened:
        opened.add_task(short)
        yield opened


@pytest.fixture
def queues(monkeypatch):
    """The queues that were run, as solvers and runs."""
    seen = []
    run = InProcess.run

    def kept(self, jobs, progress):
        seen.append([(job.solver.removeprefix(PLUGIN), job.runs) for job in jobs])
        return run(self, jobs, progress)

    monkeypatch.setattr(InProcess, "run", kept)
    return seen


def wanted(short, *names, runs=4):
    return [Evaluation.of(short, PLUGIN + name, {}, range(runs), None) for name in names]


def test_one_queue_of_what_is_missing(short, store, queues):
    both = wanted(short, "Told", "DeadReckoning")
    fill(store, wanted(short, "Told", runs=1), workers=1)
    fill(store, both, workers=1, chunk=2)
    assert queues[1] == [("Told", (1, 2)), ("Told", (3,)), ("DeadReckoning", (0, 1)), ("DeadReckoning", (2, 3))]
    assert [store.runs_of(one.key) for one in both] == [{0, 1, 2, 3}] * 2
    fill(store, both, workers=1)
    assert len(queues) == 2  # nothing is left


def test_costs_are_measured_once_and_in_the_end(short, store, queues, monkeypatch):
    asked = []

    def cost_of(job, where):
        asked.append((job.solver, [len(store.runs_of(one.key)) for one in both]))
        return (1.0, 2.0, None) if job.solver.endswith("Told") else None

    monkeypatch.setattr(filling, "cost_of", cost_of)
    both = wanted(short, "Told", "DeadReckoning")
    fill(store, both, workers=1, timed=both)
    assert asked == [(PLUGIN + "Told", [4, 4]), (PLUGIN + "DeadReckoning", [4, 4])]
    assert store.results(both[0].key).cost == (1.0, 2.0, None)
    asked.clear()
    fill(store, both, workers=1, timed=both[:1])
    assert (asked, len(queues)) == ([], 1)
    fill(store, both, workers=1, timed=both)  # raised before, or was interrupted
    assert [solver for solver, _ in asked] == [PLUGIN + "DeadReckoning"]


def test_no_cost_of_a_solver_that_lost_a_run(short, store, queues, monkeypatch):
    monkeypatch.setattr(InProcess, "run", lambda self, jobs, progress: ((job, None) for job in jobs))
    monkeypatch.setattr(filling, "cost_of", None)  # is not called
    one = wanted(short, "Told")
    fill(store, one, workers=1, timed=one)
    assert set(store.results(one[0].key).records.status) == {"lost"}


def test_ctrl_c_says_what_is_there(short, store, queues, monkeypatch):
    add = Store.add

    def interrupted(self, key, records):
        if key.solver.endswith("Reckoning"):
            raise KeyboardInterrupt
        add(self, key, records)

    monkeypatch.setattr(Store, "add", interrupted)
    with pytest.raises(KeyboardInterrupt, match=r"interrupted: 4 of 8 runs are in .*r\.sqlite; try again"):
        fill(store, wanted(short, "Told", "DeadReckoning"), workers=1, resume="try again")


def test_a_foreign_solver_may_end_its_process(short, store, monkeypatch):
    """That is not this one, and not a worker: its own runs have failed, and those of its neighbour have not."""
    monkeypatch.setattr(os, "_exit", lambda code: pytest.fail("it plays in this process"))
    both = [*wanted(short, "Leaves", runs=2), Evaluation.of(short, "ckf", {}, range(2), None)]
    fill(store, both, workers=1)
    foreign, own = (set(store.results(one.key).records.status) for one in both)
    assert foreign == {"raised"}
    assert own <= {"ok", "diverged"}


# ---- the oracle ----


def test_the_oracle_plays_what_it_lacks_and_boards_take_its_luck_out(short, store, tmp_path):
    """From 20 runs on; it is no solver of the file, but it is merged and verified."""
    (few,), (many,), (more,) = (wanted(short, "Told", runs=runs) for runs in (19, 20, 22))
    fill(store, [few], workers=1)
    assert store.keys(oracles=True) == [few.key]
    assert store.results(few.key).oracle is None
    for one in (many, more):
        fill(store, [one], workers=1)
        assert store.keys() == [few.key]
        (key,) = store.keys(solvers=[oracle.SOLVER], oracles=True)
        assert store.runs_of(key) == set(one.runs)
    found, expected = store.results(more.key), oracle.compute(short, 22)
    luck = expected.steady[:, 2]
    np.testing.assert_allclose(found.entry.oracle, luck, rtol=1e-9)
    value, interval = losses.over_bound(losses.capped(found.entry.error, found.measure.cap), luck, found.measure.bound)
    assert (found.verdict.x_bound, *found.verdict.x_bound_ci) == pytest.approx((value, *interval), rel=1e-9)
    assert found.verdict.adjusted
    part = store.results(more.key, range(10, 20), whole=False)
    np.testing.assert_allclose(part.entry.oracle, luck[10:20], rtol=1e-9)
    assert store.results(more.key).oracle.history.shape[1] == len(expected.records.criteria.history_t)
    merge([store.path], tmp_path / "merged.sqlite")
    tamper = "UPDATE runs SET steady_rms_u = {} * steady_rms_u WHERE run = 21 AND solver = '" + oracle.SOLVER + "'"
    store.connection.execute(tamper.format(1 + 3e-8))  # rounding of small differences
    assert verify(store, [key], 22).differences == ()
    store.connection.execute(tamper.format(1 + 3e-6))
    (line,) = verify(store, [key], 22).differences
    assert line.startswith("the oracle of short-v0, run 21: steady_rms_u")
    with Store(tmp_path / "merged.sqlite", read_only=True) as db:
        assert verify(db, db.keys(solvers=[oracle.SOLVER], oracles=True), 22).differences == ()
