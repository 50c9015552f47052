"""``SINS/TuneNoise-v0``: factor one is the filter as told, factors change what the filter assumes, rewards are its errors."""

import dataclasses
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.learning.tuning import Statistics

TOLD_WRONG = get_task("sway-told-wrong-v0")
TASK = dataclasses.replace(TOLD_WRONG, name="short-wrong", kwargs={**TOLD_WRONG.kwargs, "duration": 6.0, "n_sub": 2})
ID = "SINS/TuneNoise-v0"


def played(env, action, seed):
    obs, _ = env.reset(seed=seed)
    seen, rewards, over = [obs], [], False
    while not over:
        obs, reward, _, over, info = env.step(action)
        seen.append(obs)
        rewards.append(reward)
    return np.array(seen), np.array(rewards), info


def by_hand(seed, scale=None):
    """The errors over thresholds of a run by the plain environment and the plain filter, (K,)."""
    env = gymnasium.make(ID, task=TASK)
    env.reset(seed=seed)
    entropy = env.unwrapped.core.env.unwrapped._rngs[0].bit_generator.seed_seq.entropy
    assert entropy >= 1 << 127  # none of a suite's
    world, solver = TASK.make(1), finding.make("ckf")
    obs, _ = world.reset(seed=[entropy])
    solver.reset(world.unwrapped.task, [np.random.default_rng(0)], 1)
    if scale:
        solver.scale_noise(*scale)
    found = []
    for _ in range(world.unwrapped.task.num_epochs):
        obs, *_, info = world.step(solver.step(obs))
        found.append(min(max(abs(info["errors"]["phi"][0]) / TASK.delta), 10.0))
    return np.array(found)


def test_reward_is_minus_the_error_over_its_threshold():
    """Factor one is the filter as told; another factor is that of ``scale_noise``."""
    env = gymnasium.make(ID, task=TASK)
    _, rewards, info = played(env, np.zeros(2), 4)
    errors = by_hand(4)
    assert np.allclose(rewards, -errors.reshape(6, 10).mean(axis=1), rtol=1e-13)
    assert np.array_equal(info["factors"], [1.0, 1.0])
    _, scaled, info = played(env, np.array([0.5, -2 / 3]), 4)
    assert info["factors"] == pytest.approx([10**1.5, 1e-2])
    assert np.allclose(scaled, -by_hand(4, (10**1.5, 1e-2)).reshape(6, 10).mean(axis=1), rtol=1e-9)
    assert not np.allclose(scaled, rewards, rtol=1e-3)


def test_innovations_tell_a_wrong_noise():
    """R is told a hundred times too large: mean squares are small as told, and of order one with the true R."""
    env = gymnasium.make_vec(ID, num_envs=3, task=TASK)
    m = sum(env.unwrapped.core.sensors.values())
    for action, low, high in ((0.0, -3.0, -0.8), (-2 / 3, -0.7, 0.7)):
        seen, *_ = (played_vector(env, np.tile([0.0, action], (3, 1))),)
        assert low < np.mean(seen[-1][:, m : 2 * m]) < high


def played_vector(env, actions, seed=9):
    obs, _ = env.reset(seed=seed)
    seen, over = [obs], np.zeros(1, dtype=bool)
    while not over.any():
        obs, *_, over, _ = env.step(actions)
        seen.append(obs)
    return seen


def test_rows_are_single_runs_and_begin_again():
    env, single = gymnasium.make_vec(ID, num_envs=2, task=TASK), gymnasium.make(ID, task=TASK)
    actions = np.array([[0.2, -0.5], [-0.3, 0.1]])
    seen = played_vector(env, actions, seed=[7, 8])
    for row in range(2):
        alone, *_ = played(single, actions[row], (7, 8)[row])
        assert np.allclose([one[row] for one in seen], alone, atol=1e-5)
    obs, reward, _, over, _ = env.step(actions)
    assert (reward == 0).all()
    assert not over.any()
    assert (obs[:, -1] == 0).all()


def test_factors_per_sensor():
    task = dataclasses.replace(TASK, name="short-aided", kwargs={**TASK.kwargs, "aids": {"heading": "novatel-2m"}})
    env = gymnasium.make(ID, task=task, per_sensor=True)
    assert list(env.unwrapped.core.sensors) == ["gps", "heading"]
    assert env.action_space.shape == (3,)
    _, first, _ = played(env, np.array([0.0, 0.0, 0.0]), 1)
    _, second, _ = played(env, np.array([0.0, 0.0, 1.0]), 1)
    assert not np.array_equal(first, second)


def test_statistics_of_known_innovations():
    """Against formulas: mean, mean square and the correlation of a first-order process."""
    rng, statistics, x = np.random.default_rng(1), Statistics(1, 2), np.zeros(2)
    for _ in range(400):
        statistics.begin()
        for _ in range(25):
            x = np.array([0.6, 0.0]) * x + rng.normal(size=2) * [0.8, 2.0]
            statistics.add(x[None])
        statistics.end()
    mean, log_square, log_slow, lagged = statistics.values().reshape(4, 2)
    assert lagged == pytest.approx([0.6, 0.0], abs=0.2)  # 250 samples of memory: 3 standard errors
    assert log_slow == pytest.approx(np.log10([1.0, 4.0]), abs=0.2)
    assert log_square == pytest.approx(np.log10([1.0, 4.0]), abs=0.5)
    assert mean == pytest.approx([0.0, 0.0], abs=1.3)
    before = statistics.values()
    statistics.begin()
    statistics.add(np.full((1, 2), np.nan))
    statistics.end()
    assert np.array_equal(statistics.values(), before)


def test_gymnasiums_checker_is_content():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(ID, task=TASK).unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"task": "rlg-car-v0"}, "which plays a recording; allowed: a simulated task"),
        ({"solver": "gsf_imm"}, "allowed: a filter in the pipeline, such as 'ckf' or 'ekf'"),
        ({"interval_s": 0.25}, "allowed: a multiple of the epoch of 0.1 s, up to 360 s"),
        ({"decade": 1.0}, "did you mean 'decades'"),
        ({"solver_settings": {"zero_rate": True, "stillness": True}}, "zero_rate = True"),
    ],
)
def test_what_is_refused(given, text):
    def begin():
        env = gymnasium.make(ID, **given)
        env.reset(seed=0)
        env.step(np.zeros(2))

    with pytest.raises(ValueError, match=r"[aA]llowed: ") as error:
        begin()
    assert text in str(error.value)


def test_scaled_noise_of_the_pipeline():
    """What is no factor is refused, and a reset forgets the factors."""
    solver = finding.make("ekf")
    with pytest.raises(RuntimeError, match="no task yet"):
        solver.scale_noise(2.0)
    world = TASK.make(1)
    obs, _ = world.reset(seed=[1])

    def answers(**factors):
        solver.reset(world.unwrapped.task, [np.random.default_rng(0)], 1)
        if factors:
            solver.scale_noise(**factors)
        return solver.step(obs)

    told = answers()
    assert not np.array_equal(answers(r=4.0), told)
    assert np.array_equal(answers(r={"gps": 4.0}), answers(r=np.full(1, 4.0)))
    assert np.array_equal(answers(), told)
    for bad, text in (({"q": 0.0}, "factor of the noise of Q"), ({"r": {"gp": 1.0}}, "did you mean 'gps'")):
        with pytest.raises(ValueError, match=text):
            answers(**bad)
