"""check_estimator passes what keeps the contract and names what does not."""

import math

import pytest
from evaluation import plugins

from sins_env.evaluation import check_estimator
from sins_env.evaluation.estimators.guard import EstimatorError

PLUGIN = "evaluation.plugins:"


class NoReturn:
    batched = False

    def reset(self, task, rng, num_runs=1):
        pass

    def step(self, obs):
        pass


class LooksForGyro(NoReturn):
    def step(self, obs):
        return obs["gyro"]


class ResetTakesTask(NoReturn):
    def reset(self, task):
        pass


class LeavesByTheDoor(NoReturn):
    def step(self, obs):
        raise SystemExit(3)


class Single(plugins.DeadReckoning):
    """In a batch its answers are away by what float32 rounds to."""

    def step(self, obs):
        q = super().step(obs)
        return q + 2.4e-7 * (q.ndim > 1)


class BareFilter:
    """What a filter of solvers.filters has, and no more."""

    def __init__(self, gain=1.0):
        self.init = self.step = self.estimate = None


def failed(factory, **settings):
    return {check.name: check.detail for check in check_estimator(factory, settings) if check.passed is False}


@pytest.mark.parametrize(
    "factory", [plugins.DeadReckoning, plugins.OneByOne, plugins.Noisy, "evaluation.plugins:with_setting"]
)
def test_good(factory):
    assert failed(factory) == {}


@pytest.mark.parametrize(
    ("factory", "name", "detail"),
    [
        (plugins.ChangesObservations, "leaves observations and task", "dtheta of observation 1"),
        (plugins.ChangesTask, "leaves observations and task", "start in the task"),
        (plugins.GlobalRandom, "draws from its rng only", "global random state"),
        (plugins.NotReset, "reset begins anew", "differ by"),
        (plugins.WallClock, "the same rng gives the same result", "differ by"),
        (plugins.Neighbourly, "neighbours", "differ by"),
        (plugins.NeedsFixes, "without fixes", "no attitude"),
        (plugins.NeedsStart, "without a told attitude", "AttributeError"),
        (plugins.Unpicklable, "pickled", "lambda"),
        (plugins.NegativeCovariance, "covariance", "not positive"),
        (plugins.BadCovariance, "covariance", "shape (4, 4)"),
        (
            plugins.KeepsAxis,
            "one run: actions of shape (4,)",
            "shape (1, 4); allowed: (4,), at epoch 1; let step",
        ),
        (plugins.BadReset, "one run: actions", "reset raised RuntimeError: no memory left (plugins.py, line "),
        (LooksForGyro, "one run: actions", "line 26); an observation has t, dtheta, dvel, gps_vel, gps_pos, gps_valid"),
        (ResetTakesTask, "one run: actions", "allowed: reset(self, task, rng, num_runs=1) and step(self, obs)"),
        (LeavesByTheDoor, "one run: actions", "step raised SystemExit: 3 (test_check.py, line "),
        (NoReturn, "one run: actions", "step returned None; allowed: shape (4,), at epoch 1"),
    ],
)
@pytest.mark.filterwarnings("ignore:(divide|invalid)")
def test_bad(factory, name, detail):
    found = failed(factory)
    hits = [text for check, text in found.items() if name in check]
    assert hits, found
    assert detail in hits[0]


def test_only_what_is_wrong_is_named():
    assert len(failed(plugins.GlobalRandom)) == 1
    assert len(failed(plugins.NeedsStart)) == 1
    assert len(failed(plugins.NegativeCovariance)) == 1
    assert len(failed(NoReturn)) == 1


def test_no_estimator():
    with pytest.raises(ValueError, match="without batched, reset, step"):
        check_estimator(plugins.Nothing)


@pytest.mark.parametrize(
    ("factory", "advice"),
    [
        (plugins.KeepsAxis, "let step return q_nb, scalar first"),
        (plugins.Neighbourly, "its own row"),
        (plugins.WallClock, "draw from the rng of reset, and use no clock"),
        (plugins.NotReset, "set all that step changes in reset"),
        (plugins.ChangesObservations, "copy what you change"),
        (plugins.GlobalRandom, "draw from the rng that is given to reset"),
        (plugins.NeedsFixes, "obs['gps_valid'] is 1"),
        (plugins.NeedsStart, "task.start is None there"),
        (plugins.Unpicklable, "keep lambdas"),
        (plugins.NegativeCovariance, "or leave covariance out"),
    ],
)
@pytest.mark.filterwarnings("ignore:(divide|invalid)")
def test_each_failure_says_what_to_do(factory, advice):
    assert any(advice in detail for detail in failed(factory).values())


def test_tolerance():
    """A network in float32 keeps the contract but for its rounding."""
    (detail,) = failed(Single).values()
    assert "run 0 alone and in a batch differ by 2.4e-07, first at epoch 1; allowed: 1e-09; " in detail
    assert "--tolerance 1e-6" in detail
    found = check_estimator(Single, tolerance=1e-6)
    assert not [check for check in found if check.passed is False]
    assert {check.detail for check in found if check.detail.startswith("to ")} == {"to 1e-06"}
    for bad in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"tolerance = .*; allowed: a positive number"):
            check_estimator(plugins.Told, tolerance=bad)


def test_a_bare_filter_is_to_be_wrapped():
    with pytest.raises(ValueError, match=r"is a bare filter; wrap it: Pipeline\(BareFilter\(gain=2.0\)\)"):
        check_estimator(BareFilter, {"gain": 2.0})
    with pytest.raises(ValueError, match=r"wrap it: Pipeline\(CKF\(\)\), with Pipeline of solvers"):
        check_estimator("solvers.filters.sigma.ckf:CKF")
    found = check_estimator("evaluation.contract.wrapped:soft_ckf")
    assert {check.passed for check in found} == {True, None}


def test_apart_the_checks_are_the_same():
    seen = []
    there = check_estimator(PLUGIN + "GlobalRandom", on_check=seen.append)
    assert there == seen == check_estimator(plugins.GlobalRandom)
    with pytest.raises(ValueError, match="allowed: not negative"):
        check_estimator(PLUGIN + "with_setting", {"gain": -1})
    local = type("Local", (plugins.Told,), {})
    with pytest.raises(ValueError, match="Local' cannot be checked in a process of its own"):
        check_estimator(local, apart=True)


def test_an_estimator_that_ends_the_process_of_the_checks():
    """What was found before is told all the same."""
    seen = []
    with pytest.raises(EstimatorError, match=r"Leaves ended its process in the middle of the checks \(exit code 7\)"):
        check_estimator(PLUGIN + "Leaves", on_check=seen.append)
    assert [check.passed for check in seen] == [True]
