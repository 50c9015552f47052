"""The settings of the pipeline: one value for all its parts, what fills what is not given, and how it is shown."""

import dataclasses
import inspect
import pickle

import gymnasium
import numpy as np
import pytest
from oracles.zoo import settings_of

import sins_env  # noqa: F401
import solvers
from solvers.filters import make_filter, names
from solvers.pipeline.estimator import Aligner, Navigator, Pipeline
from solvers.pipeline.settings import Settings


def test_every_part_has_the_settings_that_the_user_gave():
    made = solvers.make("ckf", model="thesis", bias_frame="nav", feedback="closed", coarse="oba")
    given = {"model": "thesis", "bias_frame": "nav", "feedback": "closed", "coarse": "oba"}
    assert made.settings == Settings(**given)
    assert made.aligner.settings == Settings(**given, coordinates="euler")
    assert made.navigator.settings == Settings(feedback="closed", coarse="oba", coordinates="euler")
    assert not made.aligner.errors.exact
    assert not made.aligner.errors.body_biases


def test_what_is_not_given_is_as_the_filter_asks_else_the_default():
    open_loop, closed = Settings(feedback="open", coordinates="euler"), {"feedback": "closed"}
    assert Aligner(make_filter("ckf")).settings == open_loop
    assert Aligner(make_filter("kf")).settings == dataclasses.replace(open_loop, **closed)
    assert Aligner(make_filter("inekf")).settings == Settings("exact", "body", "closed", "invariant")
    assert Navigator(make_filter("ckf")).settings == Settings(feedback="closed", coordinates="euler")
    assert Navigator(make_filter("gsf_ekf")).settings.coordinates == "invariant"
    assert Navigator(make_filter("gsf_ekf"), coordinates="euler").settings.coordinates == "euler"


def test_the_settings_of_a_solver_are_its_filters_and_the_pipelines():
    found = [p.name for p in solvers.settings("ukf")]
    own = [field.name for field in dataclasses.fields(make_filter("ukf"))]
    assert found == [*own, *inspect.signature(Settings).parameters]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"model": "exakt"}, "unknown model 'exakt'; did you mean 'exact'"),
        ({"bias_frame": "bdy"}, "unknown bias_frame 'bdy'; did you mean 'body'"),
        ({"feedback": "opened"}, "unknown feedback 'opened'; did you mean 'open'"),
        ({"feedback": True}, "unknown feedback True"),
        ({"coordinates": "invarant"}, "did you mean 'invariant'"),
        ({"coarse": "sdv"}, "unknown coarse method 'sdv'; did you mean 'svd'"),
        ({"coarse": ["svd"]}, "unknown coarse method"),
        ({"feedbck": "open"}, "did you mean 'feedback'"),
        (
            {"coordinates": "invariant", "model": "thesis"},
            "model = 'thesis' in invariant coordinates; allowed: 'exact'",
        ),
        ({"coordinates": "invariant", "bias_frame": "nav"}, "bias_frame = 'nav' in invariant coordinates"),
    ],
)
def test_wrong_settings(given, message):
    with pytest.raises(ValueError, match=message):
        Pipeline(make_filter("ckf"), **given)


def test_a_filter_may_not_ask_for_what_does_not_fit():
    with pytest.raises(ValueError, match="in invariant coordinates"):
        solvers.make("inekf", model="thesis")
    with pytest.raises(ValueError, match="model = 'thesis' is of alignment, and a navigator navigates"):
        Navigator(make_filter("ckf"), model="thesis")


@pytest.mark.parametrize(
    ("name", "given", "shown"),
    [
        ("ckf", {}, "Pipeline(CKF())"),
        ("ckf", {"feedback": "closed"}, "Pipeline(CKF(), feedback='closed')"),
        ("gpf", {"particles": 500, "coarse": "oba"}, "Pipeline(GPF(particles=500), coarse='oba')"),
        ("two_pass", {}, "TwoPass()"),
        ("two_pass", {"relinearise_s": 60.0, "model": "thesis"}, "TwoPass(relinearise_s=60.0, model='thesis')"),
        ("coarse_inertial", {}, "CoarseInertial()"),
        ("coarse_inertial", {"method": "two_vector"}, "CoarseInertial(method='two_vector')"),
        ("coarse_oba", {"aided": False}, "CoarseOba(aided=False)"),
        ("coarse_analytic3", {}, "CoarseAnalytic3()"),
    ],
)
def test_an_estimator_is_shown_in_one_short_line(name, given, shown):
    assert repr(solvers.make(name, **given)) == shown


@pytest.mark.parametrize("name", names())
def test_a_filter_shows_what_differs_from_its_defaults(name):
    """And the line makes it again."""
    assert repr(make_filter(name)) == f"{type(make_filter(name)).__name__}()"
    changed = make_filter(name, **settings_of(name))
    assert eval(repr(changed), {type(changed).__name__: type(changed)}) == changed
    assert repr(pickle.loads(pickle.dumps(changed))) == repr(changed)


@pytest.mark.parametrize(
    ("env_id", "kwargs"),
    [
        ("SINS/AlignSway-v0", {"duration": 60.0, "n_sub": 3}),
        ("SINS/NavFlight-v0", {"profile": "lu-gauss", "duration": 10.0}),
    ],
)
def test_inekf_is_ekf_in_invariant_coordinates(env_id, kwargs):
    """Through the whole pipeline, to the bit: answers and covariances; Euler coordinates give others."""
    env = gymnasium.make_vec(env_id, num_envs=2, **kwargs)
    obs, _ = env.reset(seed=3)
    ways = [("inekf", {}), ("ekf", {"coordinates": "invariant", "feedback": "closed"}), ("ekf", {})]
    estimators = [solvers.make(name, **settings) for name, settings in ways]
    for estimator in estimators:
        estimator.reset(env.unwrapped.task, [np.random.default_rng(i) for i in range(2)], 2)
    for _ in range(60):
        same, other, euler = (estimator.step(obs) for estimator in estimators)
        np.testing.assert_array_equal(same, other)
        obs, *_ = env.step(same)
    np.testing.assert_array_equal(estimators[0].covariance(), estimators[1].covariance())
    assert np.abs(euler - same).max() > 1e-6
