"""An estimator that has no task yet, or has not seen an observation."""

import gymnasium
import numpy as np
import pytest

import sins_env  # noqa: F401
import solvers

WORLDS = {
    "alignment": ("SINS/AlignSway-v0", {}, 3),
    "unknown": ("SINS/AlignSway-v0", {"start": "unknown", "coarse": 2.0}, 3),
    "navigation": ("SINS/NavFlight-v0", {"profile": "lu-gauss"}, 9),
}


@pytest.mark.parametrize("name", ["ckf", "inekf", "two_pass"])
@pytest.mark.parametrize("what", ["step", "covariance"])
def test_without_a_task_it_says_so(name, what):
    made = solvers.make(name)
    with pytest.raises(RuntimeError, match=r"has no task yet; call reset\(task, rng\) first"):
        getattr(made, what)(*([{}] if what == "step" else []))


@pytest.mark.parametrize("name", ["coarse_inertial", "coarse_oba"])
def test_so_does_a_coarse_alignment(name):
    with pytest.raises(RuntimeError, match=r"^Coarse\w+\(\) has no task yet"):
        solvers.make(name).step({})


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("runs", [None, 1, 2])
def test_before_the_first_step_the_covariance_is_the_told_one(world, runs):
    """Of the shape that it has later: a single run has no run axis, a batch of one has."""
    env_id, kwargs, size = WORLDS[world]
    kwargs = {"duration": 4.0, **kwargs}
    env = gymnasium.make(env_id, **kwargs) if runs is None else gymnasium.make_vec(env_id, num_envs=runs, **kwargs)
    obs, _ = env.reset(seed=0)
    task = env.unwrapped.task
    rngs = [np.random.default_rng(i) for i in range(runs or 1)]
    made = solvers.make("ekf")
    made.reset(task, rngs[0] if runs is None else rngs, runs or 1)
    told = made.covariance()
    assert told.shape == (*((runs,) if runs else ()), size, size)
    np.testing.assert_array_equal(told, np.broadcast_to(task.prior.P0[:size, :size], told.shape))
    made.step(obs)
    assert made.covariance().shape == told.shape
    made.reset(task, rngs[0] if runs is None else rngs, runs or 1)
    np.testing.assert_array_equal(made.covariance(), told)
