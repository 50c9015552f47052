"""Replays of small recordings, for the tests of the environments."""

import gymnasium
import numpy as np

import sins_env  # noqa: F401  registers the ids

REPLAY = "SINS/Replay-v0"
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def make(recording, **settings):
    return gymnasium.make(REPLAY, recording=recording, **_short(settings)).unwrapped


def vector(recording, num_envs, **settings):
    return gymnasium.make_vec(REPLAY, num_envs, recording=recording, **_short(settings))


def _short(settings):
    """A coarse phase that leaves room in a recording of ten seconds; a told start has none."""
    return {"coarse": 0.0 if settings.get("start") == "told" else 0.1, **settings}


def play(env, action=IDENTITY, **reset):
    """Every observation, reward and info of an episode."""
    obs, info = env.reset(**reset)
    observations, rewards, infos = [obs], [], [info]
    over = False
    while not over:
        obs, reward, terminated, over, info = env.step(action)
        assert not np.any(terminated)
        observations.append(obs)
        rewards.append(reward)
        infos.append(info)
        over = bool(np.all(over))
    return observations, rewards, infos


def stacked(observations, key):
    return np.stack([o[key] for o in observations])
