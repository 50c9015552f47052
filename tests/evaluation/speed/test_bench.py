"""Times of a solver in a process of its own are those of that process, and its CPU time is no waiting."""

import dataclasses
import math
import time

import pytest
from evaluation.plugins import Readings, Told

from sins_env.evaluation.estimators.guard import EstimatorError
from sins_env.evaluation.estimators.isolation import Here, hosted
from sins_env.evaluation.speed import cost
from sins_env.evaluation.speed.bench import fitting, measure
from sins_env.evaluation.speed.timing import Probe

PLUGIN = "evaluation.plugins:"


@pytest.mark.parametrize("limit_s", [None, math.inf])
def test_cpu_time_of_the_estimator(short, limit_s):
    """2 ms of work and 2 ms of sleep each epoch: CPU time has the first, wherever it is spent, and not the second."""
    with hosted(PLUGIN + "Burns", {}, limit_s) as host:
        chain, env, estimator = measure(host, short, batches=(1,), seconds=0.5)
    assert [one.part for one in (chain, env, estimator)] == ["whole chain", "environment", "estimator"]
    assert 2000 <= estimator.epoch_us < 3900
    assert chain.epoch_us > estimator.epoch_us
    assert env.epoch_us < 2000  # nothing of it is counted as the environment's


def test_wall_time_has_the_sleep_too(short):
    with hosted(PLUGIN + "Burns", {}, math.inf) as host:
        probe = Probe(short, host, warm_up=1, clock=time.perf_counter)
        estimator_s, env_s, _ = probe.advance(10)
        probe.close()
    assert (estimator_s >= 4e-3).all()
    assert (env_s > 0).all()
    assert probe.left == 189


def test_blocks_end_where_the_task_does(short):
    probe = Probe(short, Here(Told), 2, warm_up=190)
    estimator_s, env_s, _ = probe.advance(20)
    assert estimator_s.shape == env_s.shape == (10,)
    assert probe.left == 0
    coarse = dataclasses.replace(short, kwargs={**short.kwargs, "start": "unknown", "coarse": 5.0})
    assert (
        Probe(coarse, Here(PLUGIN + "DeadReckoning"), warm_up=20).left == 200 - 50 - 20
    )  # the coarse phase is not timed
    with pytest.raises(ValueError, match=r"runs = 2; allowed: 1, evaluation.plugins:OneByOne is not batched"):
        Probe(short, Here(PLUGIN + "OneByOne"), 2)


def test_fitting(short):
    assert fitting(Here(Told), short, (256, 1, 256)) == ((256, 1), [])
    sizes, remarks = fitting(Here(PLUGIN + "OneByOne"), short, (4, 1))
    assert sizes == (1,)
    assert remarks == ["evaluation.plugins:OneByOne takes one run at a time: 1 run instead of 4"]


def test_each_batch_size_has_a_new_estimator(short):
    speeds = measure(Here(PLUGIN + "Once", {"epoch": 0}), short, batches=(2, 1), seconds=0.05)
    assert [one.runs for one in speeds] == [2, 2, 2, 1, 1, 1]


def test_a_solver_that_ends_its_process(short):
    with hosted(PLUGIN + "Leaves", {}, math.inf) as host, pytest.raises(EstimatorError, match="exit code 7"):
        measure(host, short, batches=(1,))
    assert cost.measure_cost(short, PLUGIN + "Leaves", timeout_s=math.inf) is None


def test_cost_beside_ckf_where_the_solver_is(short, monkeypatch, tmp_path):
    """A clock that counts its readings: a step of ckf takes one, and the way to its process two more, which are not counted."""
    path, asked = tmp_path / "readings", []
    path.touch()
    monkeypatch.setattr(cost, "hosted", lambda *given: (asked.append(given[2]), hosted(*given))[1])

    def measured(solver, limit_s=None, **settings):
        found = cost.measure_cost(short, solver, settings, limit_s, Readings(str(path)))
        return found.ratio, found.median_us

    assert measured("solvers.zoo:ckf") == (1.0, 1e6)
    assert measured("solvers.zoo:ckf", 60.0) == (1.0, 1e6)
    assert asked == [None, math.inf, 60.0, math.inf]
    assert measured(PLUGIN + "Reads", path=str(path), readings=4) == (5.0, 5e6)
    lies = measured(PLUGIN + "Reads", path=str(path), readings=4, lies=True)
    assert lies == (3.0, 3e6)  # by the clock here, which saw the four readings, without the usual way
    assert measured("ckf") == (1.0, 1e6)
