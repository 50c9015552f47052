"""check_estimator passes what keeps the contract and names what does not."""

import pytest
from evaluation import plugins

from sins_env.evaluation import check_estimator


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
        (plugins.KeepsAxis, "one run: actions of shape (4,)", "shape (1, 4) at epoch 1; allowed: (4,)"),
        (plugins.BadReset, "one run: actions", "RuntimeError: no memory left (plugins.py, line "),
        (LooksForGyro, "one run: actions", "line 21); an observation has t, dtheta, dvel, gps_vel, gps_pos, gps_valid"),
        (ResetTakesTask, "one run: actions", "allowed: reset(self, task, rng, num_runs=1) and step(self, obs)"),
        (NoReturn, "one run: actions", "step returned None at epoch 1; allowed: an array of shape (4,)"),
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
