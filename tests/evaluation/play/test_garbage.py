"""Whatever an estimator returns or does has a defined outcome, and it is never a good score or the end of the others."""

import decimal
import math
import re

import numpy as np
import pytest
from evaluation import plugins
from evaluation.test_monte_carlo import HERE, assert_same, run

from sins_env.evaluation import evaluate
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.guard import Guard


@pytest.fixture
def healthy(short):
    return run(short, "DeadReckoning", 2).records


class Loud:
    """Would be an array, and raises."""

    def __array__(self, *_, **__):
        raise RuntimeError("no")


#: What step returns at epoch 5 (of two runs), and what is said of it.
REFUSED = {
    "None": (lambda q: None, "None"),
    "text": (lambda q: "1 0 0 0", "a str"),
    "numbers as text": (lambda q: [["1", "0", "0", "0"]] * len(q), "a list of <U1"),
    "complex": (lambda q: q + 0j, "a ndarray of complex128"),
    "bytes": (lambda q: q.tobytes(), "a bytes"),
    "times": (lambda q: q.astype("timedelta64[s]"), "a ndarray of timedelta64[s]"),
    "records": (lambda q: np.zeros((len(q), 4), "f8,f8"), "a ndarray of [('f0', '<f8'), ('f1', '<f8')]"),
    "objects": (lambda q: np.array([[object()] * 4] * len(q)), "a ndarray of object"),
    "a generator": (lambda q: (x for x in q), "a generator"),
    "ragged": (lambda q: [[1.0, 0.0, 0.0, 0.0], [1.0]], "a list"),
    "a mapping": (lambda q: {"q": q}, "a dict"),
    "one run's": (lambda q: q[0], "shape (4,)"),
    "another number of runs": (lambda q: q[:1], "shape (1, 4)"),
    "transposed": (lambda q: q.T, "shape (4, 2)"),
    "one axis more": (lambda q: q[None], "shape (1, 2, 4)"),
    "a scalar": (lambda q: 1.0, "shape ()"),
    "nothing": (lambda q: [], "shape (0,)"),
    "that raises": (lambda q: Loud(), "a Loud"),
}
#: As what is no attitude.
FAILED = {
    "nan": lambda q: q * math.nan,
    "inf": lambda q: q * math.inf,
    "one nan": lambda q: np.where([True, False, False, False], math.nan, q),
    "zero": lambda q: q * 0,
    "None among objects": lambda q: np.where([True, False, False, False], None, q),
}
#: As numbers like any others.
TAKEN = {
    "float32": lambda q: q.astype(np.float32),
    "longdouble": lambda q: q.astype(np.longdouble),
    "a list": lambda q: q.tolist(),
    "objects": lambda q: q.astype(object),
    "decimals": lambda q: np.array([[decimal.Decimal(x) for x in row] for row in q.tolist()]),
    "Fortran order": np.asfortranarray,
    "read only": lambda q: np.broadcast_to(q, q.shape),
    "negative": lambda q: -q,
    "ten times": lambda q: 10 * q,
    "huge": lambda q: 1e150 * q,
    "tiny": lambda q: 1e-300 * q,
    "masked": lambda q: np.ma.masked_array(q, mask=False),
}


class Returns(plugins.DeadReckoning):
    """Returns something else at epoch 5."""

    def __init__(self, what):
        self.what = what

    def step(self, obs):
        q = super().step(obs)
        return self.what(q) if self.k == 5 else q


@pytest.mark.parametrize("name", REFUSED)
def test_refused(short, name):
    what, said = REFUSED[name]
    settings = {"what": lambda q: what(np.repeat(q, 2, axis=0) if name == "transposed" and len(q) == 1 else q)}
    records = run_with(short, settings)
    if name == "another number of runs":  # alone, that is one of one
        assert list(records.status) == ["ok", "ok"]
        return
    assert list(records.status) == ["raised", "raised"]
    assert records.reason[0].startswith("step returned ")
    assert said.replace("(1, 2, 4)", "(1, 1, 4)") in records.reason[0]
    assert records.reason[0].endswith("at 0.5 s")


def run_with(short, settings):
    return evaluate(short, Returns, 2, settings=settings, cost=False, workers=1).records


@pytest.mark.parametrize("name", FAILED)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_failed_epoch(short, healthy, name):
    records = run_with(short, {"what": FAILED[name]})
    assert list(records.status) == ["diverged", "diverged"]
    assert set(records.reason) == {"non-finite or zero action at 0.5 s"}
    np.testing.assert_array_equal(records.final, healthy.final)


@pytest.mark.parametrize("name", TAKEN)
def test_taken(short, healthy, name):
    assert_same(run_with(short, {"what": TAKEN[name]}), healthy, rtol=1e-5)


def test_a_vandal_spoils_nothing_but_its_own_runs(short, healthy):
    """Overwrites every observation, the task and its own returned buffer, and has NumPy raise on underflow."""
    vandal = run(short, "Vandal", 2).records
    assert_same(vandal, healthy, but=("step_s", "nees"))
    assert np.geterr()["under"] == "ignore"
    one = run(short, "Vandal", 2, settings={"batched": False}).records
    assert_same(one, healthy, but=("step_s", "nees"))


@pytest.mark.parametrize("name", ["covariance", "health"])
def test_a_property_that_raises(short, name):
    (reason,) = run(short, "BadProperty", 1, settings={"name": name}).records.reason
    assert reason.startswith(f"{name} raised ArithmeticError: no {name}")


def test_an_exception_of_its_own_making(short):
    (reason,) = run(short, "RaisesBase", 1).records.reason
    assert reason == "step raised Base: beyond Exception, at 0.1 s"


@pytest.mark.parametrize("batched", [None, "yes", 1, np.ones(2)])
def test_batched_must_be_a_bool(batched):
    message = f"batched is {batched!r}; allowed: True or False"
    with pytest.raises(ValueError, match=re.escape(message)):
        finding.make(HERE + "At", {"batched": batched})


class OneBuffer(plugins.DeadReckoning):
    """Answers with the same arrays, which it fills again."""

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        self.answer, self.P = np.empty((num_runs, 4)), np.empty((num_runs, 3, 3))

    def step(self, obs):
        self.answer[...] = super().step(obs)
        return self.answer

    def covariance(self):
        self.P[...] = self.k * np.eye(3)
        return self.P


def test_an_answer_is_the_callers_own(short):
    """What an estimator does to its arrays later changes nothing that it has answered."""
    env = short.make(2)
    obs, _ = short.reset(env, (0, 1))
    guard = Guard(OneBuffer(), 2)
    guard.reset(env.unwrapped.task, [None, None])
    answers = [(guard.step(obs), guard.covariance()) for _ in range(2)]
    assert (answers[0][0] != answers[1][0]).any()
    np.testing.assert_array_equal(answers[0][1], np.tile(np.eye(3), (2, 1, 1)))
