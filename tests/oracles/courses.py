"""Short episodes and what they return, for the tests of the environments."""

import gymnasium
import numpy as np

import sins_env  # noqa: F401  registers the ids

SWAY, STATIC, VEHICLE = "SINS/AlignSway-v0", "SINS/AlignStatic-v0", "SINS/AlignVehicle-v0"
SHORT = {"duration": 2.5}  # more than two chunks of ten epochs
ONE_SECOND_UNKNOWN = {"start": "unknown", "coarse": 0.5, "duration": 1.0}
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def make(env_id=SWAY, **settings):
    return gymnasium.make(env_id, **{**SHORT, **settings}).unwrapped


def vector(num_envs, env_id=SWAY, **settings):
    return gymnasium.make_vec(env_id, num_envs, **{**SHORT, **settings})


def actions_of(rows, steps, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, rows, 4))


def play(env, actions, seed):
    """(obs, reward, over, info) of reset and of every step."""
    obs, info = env.reset(seed=seed)
    course = [(obs, None, False, info)]
    for action in actions:
        obs, reward, terminated, truncated, info = env.step(action)
        assert not np.any(terminated)
        course.append((obs, reward, truncated, info))
    return course


def truths(env, action, steps, seed):
    """The true states at the ends of the first epochs, and before them that at the start; no action changes them."""
    return [info["truth"] for *_, info in play(env, [action] * steps, seed)]


def leaves(nest, path=()):
    """(path, value) of a nest of dicts without its masks."""
    for key, value in nest.items():
        if key.startswith("_"):
            continue
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key), value
