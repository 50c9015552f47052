"""The only loop: what it yields is what a loop by hand gives, wherever the estimator is; its clock is the guard's."""

import itertools
import math

import numpy as np
import pytest
from evaluation import plugins

from sins_env.evaluation import evaluate
from sins_env.evaluation.estimators.guard import EstimatorError, Guard
from sins_env.evaluation.estimators.isolation import Here, Isolated, hosted, limits
from sins_env.evaluation.play.errors import nees
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.tasks.task import solver_rng

PLUGIN = "evaluation.plugins:"


def by_hand(task, estimator, name, runs):
    """Actions and errors (K, R, ...), without anything of the evaluation but the task."""
    env = task.make(len(runs))
    obs, _ = task.reset(env, runs)
    estimator.reset(env.unwrapped.task, [solver_rng(task, name, run) for run in runs], len(runs))
    actions, errors = [], []
    for _ in range(env.unwrapped.task.num_epochs):
        action = estimator.step(obs)
        obs, _, _, _, info = env.step(action)
        actions.append(action)
        errors.append(info["errors"]["phi"])
    return np.array(actions), np.array(errors)


@pytest.mark.parametrize("limit_s", [None, math.inf])
def test_it_is_the_loop_by_hand(short, limit_s):
    runs, name = (4, 1, 2), PLUGIN + "Noisy"
    actions, errors = by_hand(short, plugins.Noisy(), name, runs)
    job = Job(short, name, runs, epoch_timeout_s=limit_s)
    with job.host() as host:
        epochs = list(Loop.of(job, host))
    assert [epoch.k for epoch in epochs] == list(range(1, 201))
    np.testing.assert_array_equal([epoch.action for epoch in epochs], actions)
    np.testing.assert_array_equal([epoch.info["errors"]["phi"] for epoch in epochs], errors)


def test_scores_are_of_these_epochs(short):
    """RMS over the steady state, error at the end, time of convergence and NEES, worked out from the errors by hand."""
    name, runs = PLUGIN + "DeadReckoning", (0, 1, 2)
    _, errors = by_hand(short, plugins.DeadReckoning(), name, runs)
    found = evaluate(short, name, runs, workers=1, cost=False).records
    steady = errors[found.criteria.steady_from - 1 :]
    np.testing.assert_allclose(found.steady_rms, np.sqrt(np.square(steady).mean(axis=0)), rtol=1e-9)
    np.testing.assert_array_equal(found.final, errors[-1])
    P = np.broadcast_to(np.diag(np.radians([1.0, 1.0, 15.0]) ** 2), (3, 3, 3))
    for i, epoch in enumerate(found.criteria.nees_epochs):
        np.testing.assert_array_equal(found.nees[:, i], nees(errors[epoch - 1], P))


def test_it_goes_on_epoch_by_epoch(short):
    job = Job(short, plugins.Vandal, (0,))
    with job.host() as host:
        loop = Loop.of(job, host)
        assert (loop.k, loop.left, loop.task.num_epochs) == (0, 200, 200)
        next(loop)
        assert (loop.k, loop.left) == (1, 199)
        assert not (loop.obs["dtheta"] == 1).any()  # the next one, which nobody has overwritten yet
        assert sum(1 for _ in loop) == 199
        assert next(loop, None) is None
        loop.close()


def test_the_estimator_begins_with_the_first_epoch(short):
    job = Job(short, plugins.BadReset, (0, 1))
    with job.host() as host:
        loop = Loop.of(job, host)
        with pytest.raises(EstimatorError, match="reset raised RuntimeError: no memory left"):
            next(loop)


def test_times_are_by_the_clock_of_the_guard(short):
    """A clock that ticks once each time that somebody looks: one tick for the estimator, one for the environment."""
    ticks = itertools.count()
    env = short.make(2)
    obs, _ = short.reset(env, (0, 1))
    guard = Guard(plugins.Told(), 2, clock=lambda: float(next(ticks)))
    loop = Loop(env, guard, obs, [None, None])
    assert {(epoch.estimator_s, epoch.env_s) for epoch in loop} == {(1.0, 1.0)}
    assert (guard.seconds, guard.steps) == (200.0, 200)


def test_who_has_a_process_of_its_own():
    for near in ("ckf", plugins.Told, "ckff"):  # what is unknown is refused here, at once
        assert limits(near) is None
        assert limits(near, 2.0) == (2.0, 2.0, 60.0)
    for foreign in (PLUGIN + "Told", "solvers.zoo:ckf"):
        assert limits(foreign) == (10.0, 60.0, 60.0)
        assert limits(foreign, 2.0) == (2.0, 2.0, 60.0)
        assert limits(foreign, math.inf) == (math.inf,) * 3
    with hosted("ckf", {}, None) as host:
        assert isinstance(host, Here)
    with hosted(PLUGIN + "OneByOne", {}, math.inf) as host:
        assert isinstance(host, Isolated)
        assert not host.batched


@pytest.mark.parametrize("limit_s", [None, math.inf])
def test_after_an_error_the_estimator_is_made_anew(short, start_of, limit_s):
    """The halves of a batch are played by new estimators: the state of the one that raised is unknown."""
    given = {"settings": {"q": start_of(2)}, "epoch_timeout_s": limit_s}
    found = evaluate(short, PLUGIN + "Once", 4, workers=1, cost=False, **given).records
    assert found.status.tolist() == ["ok", "ok", "raised", "ok"]
    assert found.reason[2] == "step raised ArithmeticError: no square root, at 0.5 s"
